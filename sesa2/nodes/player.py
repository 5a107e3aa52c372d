"""The player: a recording as topics again, at the pace at which it was recorded or another."""

import threading
import time
from collections.abc import Iterator
from typing import Any

from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState, MagneticField

from sesa2.bags.reading import BesideMessage, ImuRecording, Sample
from sesa2.bags.recording import open_recording
from sesa2.configuration import ConfigurationError, Mistake
from sesa2.errors import Sesa2Error
from sesa2.estimation.time_steps import BACK_NS
from sesa2.messages.topic_names import (
    BACKBONE_LENGTHS,
    CLOCK,
    imu_data,
    imu_field,
    imu_fields,
    imu_topics,
    magnetometer_field,
)
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.diagnostics import OK, Diagnostics, Part
from sesa2.ros.parameters import declare_configuration
from sesa2.ros.qos import STREAM
from sesa2.ros.spinning import run_alone
from sesa2.time import NS

_LISTENERS_PATIENCE_S = 3.0
# What was published last is on its way to the estimator for a moment.
_LINGER_S = 0.5
# What was measured beside the first and the last sample, and may be needed with it.
_BESIDE_NS = NS // 2
_CLOCK_PERIOD_NS = 10_000_000


class Player(ConfinedNode):
    """Publishes samples as they were measured, with the measurement's own stamps.

    Attributes
    ----------
    finished, failure
        whether the recording has ended and was not to be looped; why it could not be played on.
    """

    def __init__(self, **options: Any):
        super().__init__('player', automatically_declare_parameters_from_overrides=True, **options)
        self.configuration = declare_configuration(self)
        self._run = self.configuration.run
        if not self._run.bag:
            raise ConfigurationError([Mistake('run.bag', 'is empty, expected a recording to play')], 'player')
        self._recording = open_recording(self._run.bag)
        self._imus = ImuRecording(self._recording, self.configuration)
        self._imus.check_lengths()
        for warning in self._imus.warnings:
            self.get_logger().warning(warning)
        topics = imu_topics(self.configuration)
        self._publishers_of_imus = {
            i: self.create_publisher(Imu, topics.get(i) or imu_data(i), STREAM) for i in self._imus.counts
        }
        fields = imu_fields(self.configuration)
        self._publishers_of_fields = {
            i: self.create_publisher(MagneticField, fields.get(i) or imu_field(i), STREAM)
            for i in self._imus.field_ids
        }
        self._publisher_of_lengths = (
            self.create_publisher(JointState, BACKBONE_LENGTHS, STREAM) if self._imus.lengths_topic else None
        )
        magnetometers = self._imus.magnetometers
        self._publishers_of_magnetometers = {
            i: self.create_publisher(MagneticField, magnetometer_field(i), STREAM)
            for i in (magnetometers.counts if magnetometers else ())
        }
        imus = self.configuration.imus
        listened_to = [
            self._publishers_of_imus,
            *([self._publishers_of_fields] if imus.fusion == '9d' else []),
        ]
        self._awaited = [p for publishers in listened_to for i, p in publishers.items() if i in imus.used_ids]
        self._awaited += [self._publisher_of_lengths] if self._publisher_of_lengths else []
        section = self.configuration.magnetometers
        self._awaited += [
            p
            for i, p in self._publishers_of_magnetometers.items()
            if i in section.ids and i not in section.masked and self.configuration.models_of('fields')
        ]
        self._clock_publisher = self.create_publisher(Clock, CLOCK, 10) if self._run.clock else None
        self._clock_ns = 0
        self.n_played = self._rounds = 0
        self._stop = threading.Event()
        self._diagnostics = Diagnostics(self, self._run.bag, self._report)
        self._thread = threading.Thread(target=self._play, name='player', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the playing and its thread."""
        self._stop.set()
        self._thread.join()
        self._recording.close()

    def _play(self) -> None:
        try:
            self._wait_for_listeners()
            while not self._stop.is_set():
                if not self._play_once() and not self._stop.is_set():
                    self.fail(Sesa2Error(f'{self._run.bag}: nothing to play after {self._run.start:g} s'))
                self._rounds += 1
                if self.failure or not self._run.loop:
                    break
            for problem in (*self._recording.problems, *self._imus.stamps.problems):
                self.get_logger().warning(problem)
            self._stop.wait(_LINGER_S)
        except Exception as error:
            self.fail(error)
        finally:
            self._ended = True

    def _wait_for_listeners(self) -> None:
        """A listener that is not known yet would miss the beginning."""
        deadline = time.monotonic() + _LISTENERS_PATIENCE_S
        while time.monotonic() < deadline and not all(p.get_subscription_count() for p in self._awaited):
            if self._stop.wait(0.02):
                return

    def _play_once(self) -> int:
        """Play the recording once; the number of samples."""
        n = 0
        beside = self._beside()
        message = next(beside, None)
        last_ns = 0
        for sample, wait_s in self._paced():
            while message and not n and message.log_ns < sample.log_ns - _BESIDE_NS:  # before the start
                message = next(beside, None)
            if wait_s > 0.0 and self._stop.wait(wait_s):
                return n
            while message and message.log_ns <= sample.log_ns:
                self._publish_beside(message)
                message = next(beside, None)
            self._paced_publishers[sample.id].publish(sample.data)
            self._publish_clock(sample.stamp_ns)
            n += 1
            self.n_played += 1
            last_ns = sample.log_ns
        while message and message.log_ns <= last_ns + _BESIDE_NS:
            self._publish_beside(message)
            message = next(beside, None)
        return n

    @property
    def _paced_publishers(self) -> dict[int, Publisher]:
        """Of the IMUs; where there are none, of the magnetometers. What is measured beside them follows them."""
        return self._publishers_of_imus or self._publishers_of_magnetometers

    def _beside(self) -> Iterator[BesideMessage]:
        """Magnetic fields and lengths, read apart from what is paced."""
        of_magnets = self._publishers_of_magnetometers if self._publishers_of_imus else {}
        if self._imus.field_ids or self._publisher_of_lengths or of_magnets:
            with open_recording(self._run.bag) as recording:
                yield from ImuRecording(recording, self.configuration).beside()

    def _publish_beside(self, message: BesideMessage) -> None:
        if message.magnetometer is not None:
            self._publishers_of_magnetometers[message.magnetometer].publish(message.data)
        elif message.id is not None:
            self._publishers_of_fields[message.id].publish(message.data)
        elif self._publisher_of_lengths:
            self._publisher_of_lengths.publish(message.data)

    def _paced(self) -> Iterator[tuple[Sample, float]]:
        """Each sample after the start, and how long to wait before it, s."""
        first_ns: int | None = None
        newest_ns = 0
        skip_ns = round(self._run.start * NS)
        began = time.monotonic()
        paced = self._imus.samples() if self._publishers_of_imus else self._imus.field_samples()
        for sample in paced:
            if first_ns is None:
                first_ns = newest_ns = sample.stamp_ns + skip_ns
            elif sample.stamp_ns < newest_ns - BACK_NS and not skip_ns:
                first_ns = newest_ns = sample.stamp_ns  # a new beginning, as of a bag that was looped
                began = time.monotonic()
            if sample.stamp_ns >= first_ns:
                skip_ns = 0
            if not skip_ns:
                newest_ns = max(newest_ns, sample.stamp_ns)
                elapsed_s = (sample.stamp_ns - first_ns) / NS
                yield sample, began + elapsed_s / self._run.rate - time.monotonic()

    def _publish_clock(self, stamp_ns: int) -> None:
        if self._clock_publisher and abs(stamp_ns - self._clock_ns) >= _CLOCK_PERIOD_NS:
            self._clock_ns = stamp_ns
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(stamp_ns, NS)
            self._clock_publisher.publish(message)

    def _report(self) -> list[Part]:
        text = 'finished' if self.finished else 'playing'
        return [('bag', OK, text, {'samples': self.n_played, 'rounds': self._rounds})]


def main() -> int:
    """`ros2 run sesa2 player`."""
    return run_alone(Player)


if __name__ == '__main__':
    raise SystemExit(main())
