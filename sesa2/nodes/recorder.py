"""The recorder: what the IMUs measure and the estimator publishes goes into a bag as it arrives."""

import functools
import time
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseArray, PoseStamped
from nav_msgs.msg import Path
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, JointState, MagneticField
from sesa2_msgs.msg import ImuCalibration
from std_msgs.msg import String

from sesa2.bags.stream_gaps import StreamGaps
from sesa2.bags.writing import record
from sesa2.configuration import ConfigurationError, Mistake, files
from sesa2.errors import Sesa2Error
from sesa2.messages.field_messages import FIELD_TYPE
from sesa2.messages.header_bytes import read_stamp
from sesa2.messages.imu_messages import without_acceleration
from sesa2.messages.length_messages import LENGTHS_TYPE
from sesa2.messages.results import TYPES
from sesa2.messages.topic_names import (
    BACKBONE_LENGTHS,
    CONFIGURATION,
    imu_calibration,
    imu_fields,
    imu_topics,
    magnetometer_field,
    of_model,
)
from sesa2.messages.truth_messages import TRUTH_TYPES
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.diagnostics import ERROR, OK, WARN, Diagnostics, Part
from sesa2.ros.parameters import declare_configuration
from sesa2.ros.qos import ANY_BURSTS, BURSTS, EVERY_LATCHED
from sesa2.ros.spinning import run_alone

# Half a second is the most that a kill may cost, and a little.
_FLUSH_PERIOD_S = 0.4
# A message of so many bytes begins with a stamp.
_STAMPED = 12
_NAMED = 3
_RESULTS = {
    'joint_states': JointState,
    'coordinates': JointState,
    'markers': PoseArray,
    'tip': PoseStamped,
    'shape': Path,
}


class Recorder(ConfinedNode):
    """Writes messages as the bytes in which they arrive; the configuration is the first.

    Attributes
    ----------
    path
        the bag.
    n_messages
        written so far.
    n_damaged
        of these, orientations that are cut short.
    failure, finished
        why it cannot write on (a full disk); whether it has ended for good.
    """

    def __init__(self, **options: Any):
        super().__init__('recorder', automatically_declare_parameters_from_overrides=True, **options)
        self.configuration = c = declare_configuration(self)
        if not c.record.file:
            raise ConfigurationError(
                [Mistake('record.file', 'is empty, expected a bag to write')], 'recorder'
            )
        self.n_messages = self.n_damaged = 0
        self._stripped: set[int] = set()  # topics whose acceleration is not wanted
        self._gaps: dict[str, StreamGaps] = {}
        self._bag = record(c.record.file)
        self.path = self._bag.path
        self._write(
            self._bag.add_topic(self._absolute(CONFIGURATION), 'std_msgs/msg/String', latched=True),
            bytes(serialize_message(String(data=files.dump(c)))),
        )
        self._bag.flush()
        qos = ANY_BURSTS if c.run.source == 'external' else BURSTS
        for i, topic in imu_topics(c).items():
            if c.record.imu:
                self._subscribe(Imu, 'sensor_msgs/msg/Imu', topic, qos)
                if c.imus.fusion == '9d':
                    self._subscribe(MagneticField, FIELD_TYPE, imu_fields(c)[i], qos)
            self._subscribe(
                ImuCalibration, 'sesa2_msgs/msg/ImuCalibration', imu_calibration(i), EVERY_LATCHED
            )
        for i in c.magnetometers.ids if c.record.imu else ():
            self._subscribe(MagneticField, FIELD_TYPE, magnetometer_field(i), qos)
        if c.record.imu and c.has_lengths:
            self._subscribe(JointState, LENGTHS_TYPE, BACKBONE_LENGTHS, qos)
        if c.has_plant or c.has_field_source:
            for topic, type_name in TRUTH_TYPES.items():
                kind = _RESULTS.get(topic.rpartition('/')[2], JointState)
                self._subscribe(kind, type_name, topic, BURSTS)
        if c.record.results:
            for model in c.models:
                for kind, cls in _RESULTS.items():
                    if kind == 'coordinates' and not c.create_model(model).coordinate_names:
                        continue
                    self._subscribe(cls, TYPES[kind], of_model(model, kind), BURSTS)
        self._timer = self.create_timer(_FLUSH_PERIOD_S, self._flush)
        self._diagnostics = Diagnostics(self, str(self.path), self._report)
        self.get_logger().info(f'recording into {self.path}')

    def close(self) -> None:
        """Make the bag whole."""
        self._bag.close()
        if lack := self.lack:
            self.get_logger().warning(f'{self.path}: {lack}')

    @property
    def lack(self) -> str:
        """Which topics have gaps, by their stamps: never sent, lost, or too many at once; empty where none has."""
        found = [(gaps.n_missing, topic) for topic, gaps in self._gaps.items() if gaps.n_missing]
        most = ', '.join(f'{topic} {n}' for n, topic in sorted(found, reverse=True)[:_NAMED])
        more = f' and {len(found) - _NAMED} more topics' if len(found) > _NAMED else ''
        return f'messages missing by the stamps: {most}{more}' if found else ''

    def _absolute(self, topic: str) -> str:
        return self.resolve_topic_name(topic)

    def _subscribe(self, kind: type, type_name: str, topic: str, qos: Any) -> None:
        number = self._bag.add_topic(self._absolute(topic), type_name, latched=qos is EVERY_LATCHED)
        c = self.configuration
        # What is fused on the host is wanted when the recording is replayed.
        if kind is Imu and not c.record.acceleration and c.imus.fusion == 'none':
            self._stripped.add(number)
        write = functools.partial(self._write, number)
        if qos is not EVERY_LATCHED:
            self._gaps[topic] = StreamGaps()
            write = functools.partial(self._write_stream, number, self._gaps[topic])
        self.create_subscription(kind, topic, write, qos, raw=True)

    def _write_stream(self, number: int, gaps: StreamGaps, data: bytes) -> None:
        if len(data) >= _STAMPED:
            gaps.take(read_stamp(data))
        self._write(number, data)

    def _write(self, number: int, data: bytes) -> None:
        if number in self._stripped:
            try:
                data = without_acceleration(data)
            except Sesa2Error:  # as it is: whoever reads the bag counts it too
                self.n_damaged += 1
        if self._guard(lambda: self._bag.write(number, time.time_ns(), data)):
            self.n_messages += 1

    def _flush(self) -> None:
        self._guard(self._bag.flush)

    def _guard(self, action: Callable[[], None]) -> bool:
        """Do something to the bag, unless it has failed; whether that went well."""
        if self.finished:
            return False
        try:
            action()
        except Sesa2Error as error:
            self.fail(error)
        return not self.finished

    def _report(self) -> list[Part]:
        level, text = (ERROR, str(self.failure)) if self.failure else (OK, f'recording into {self.path}')
        if self.n_damaged and not self.failure:
            level, text = (
                WARN,
                f'{text}; {self.n_damaged} messages of IMUs are cut short, recorded as they came',
            )
        if (lack := self.lack) and not self.failure:
            level, text = WARN, f'{text}; {lack}'
        return [('bag', level, text, {'messages': self.n_messages, 'damaged': self.n_damaged})]


def main() -> int:
    """`ros2 run sesa2 recorder`."""
    return run_alone(Recorder)


if __name__ == '__main__':
    raise SystemExit(main())
