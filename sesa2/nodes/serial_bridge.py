"""The serial bridge: what the boards send becomes topics; the chips get their saved offsets; the links are kept up."""

import functools
import time
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from pathlib import Path
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from sensor_msgs.msg import Imu, MagneticField
from sesa2_msgs.msg import ImuCalibration
from std_srvs.srv import Trigger

from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.link.board_client import Board
from sesa2.link.board_link import BoardLink
from sesa2.link.packets import Data, MagneticFields, RawData, State
from sesa2.link.requests import FusionMode
from sesa2.link.session import LinkSettings
from sesa2.link.status import Event, ImuStatus, Level
from sesa2.messages.field_messages import FieldMessages
from sesa2.messages.imu_messages import ImuMessages
from sesa2.messages.topic_names import imu_calibration, imu_fields, imu_frame, imu_topics
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.hand_over import HandOver
from sesa2.ros.link_diagnostics import LinkDiagnostics
from sesa2.ros.parameters import declare_configuration
from sesa2.ros.qos import LATCHED, STREAM
from sesa2.ros.spinning import run_alone
from sesa2.sensing.imu.addresses import address_of, ids_by_board
from sesa2.sensing.imu.bno055.offsets import Offsets, OffsetsError, load_offsets, offsets_are_there
from sesa2.sensing.imu.bno055.scores import SYSTEM_PATIENCE, Scores
from sesa2.time import NS

# Eight chips take 40 ms each; one that changes its mode lets the board say "busy" meanwhile.
_OFFSETS_PATIENCE_S = 5.0


class SerialBridge(ConfinedNode):
    """Publishes each IMU's orientation and calibration, or its raw measurements, as the chip has them.

    Each board has a link with a thread of its own, from which its IMUs are also published.

    Parameters
    ----------
    hand_over
        what also takes what is measured to another node of this process.

    Attributes
    ----------
    links
        to each board, in the order of the ports.
    """

    def __init__(self, hand_over: HandOver | None = None, **options: Any):
        super().__init__('serial_bridge', automatically_declare_parameters_from_overrides=True, **options)
        self.configuration = declare_configuration(self)
        c = self.configuration
        self._ids = tuple(sorted(c.imus.all_ids))
        self._saved = self._load(c)
        topics = imu_topics(c)
        self._imu_messages = {i: ImuMessages(imu_frame(c, i)) for i in self._ids}
        self._data_publishers = {i: self.create_publisher(Imu, topics[i], STREAM) for i in self._ids}
        self._field_messages = {i: FieldMessages(imu_frame(c, i)) for i in self._ids}
        magnetometer = c.imus.fusion == '9d'
        self._field_publishers = {
            i: self.create_publisher(MagneticField, imu_fields(c)[i], STREAM)
            for i in self._ids
            if magnetometer
        }
        self._hand_over = hand_over
        self._full_names = {
            publisher: publisher.topic_name
            for publisher in (*self._data_publishers.values(), *self._field_publishers.values())
        }
        self._calibration_publishers = {
            i: self.create_publisher(ImuCalibration, imu_calibration(i), LATCHED) for i in self._ids
        }
        self._offsets: dict[int, Offsets] = {}
        self._scores: dict[int, Scores] = {}
        self._full_since: dict[int, float] = {}  # since when the sensors' scores are complete
        self._learnt: dict[
            int, bool
        ] = {}  # whose offsets were read for the file, and whether with all scores
        ids = ids_by_board(self._ids)
        self.links: list[BoardLink] = []
        for board, port in enumerate(c.serial.all_ports):
            settings = LinkSettings(
                port=port,
                ids=ids[board],
                baud=c.serial.baud,
                rate_hz=c.serial.rate_hz,
                fusion=FusionMode[c.serial.fusion],
                acceleration=c.serial.acceleration,
                magnetometer=magnetometer,
            )
            self.links.append(BoardLink(settings, self, self._saved))
        names = [f'link {board}' for board in range(len(self.links))] if len(self.links) > 1 else ['link']
        self._diagnostics = [
            LinkDiagnostics(self, link, name) for link, name in zip(self.links, names, strict=True)
        ]
        self._service = self.create_service(Trigger, '~/read_offsets', self._read_all)
        self._timer = self.create_timer(1.0, self._publish_calibrations)
        for link in self.links:
            link.start()

    @property
    def connected(self) -> bool:
        """Whether all boards stream, as far as is known."""
        return all(link.session.connected for link in self.links)

    @property
    def failure(self) -> Sesa2Error | None:
        """Why a link could not be made at the start, or why the last one has ended; None while any can be kept."""
        if super().failure:
            return super().failure
        over = all(link.finished for link in self.links)
        return next((link.failure for link in self.links if link.failure and (over or not link.was_up)), None)

    @property
    def finished(self) -> bool:
        """Whether there is nothing more to come from any board, or never was from one."""
        return self.failure is not None or all(link.finished for link in self.links)

    def imus(self) -> dict[int, ImuStatus]:
        """How each IMU was in the latest sweep of its board."""
        return {i: imu for link in self.links for i, imu in link.session.imus().items()}

    def close(self) -> None:
        """End the links and their threads."""
        for link in self.links:
            link.session.stop()
        for link in self.links:
            link.close()

    def _load(self, c: Configuration) -> dict[int, Offsets]:
        """The saved offsets; a calibration that makes a new file may begin without one."""
        path = Path(c.calibration.file)
        if not c.calibration.file or c.serial.fusion == 'RAW':  # without fusion the chips use none
            return {}
        if not offsets_are_there(path):
            if c.run.mode == 'calibrate':
                return {}
            raise OffsetsError(f'calibration file {path} is not there; the mode calibrate makes one')
        calibration = load_offsets(path, self._ids)
        if calibration.missing:
            missing = ', '.join(map(str, calibration.missing))
            self.get_logger().warning(f'{path} has no offsets of IMU {missing}: not calibrated')
        return calibration.offsets

    # Called by the links, each in its own thread

    def on_sweep(
        self, data: Data | RawData, stamps_ns: list[int], accelerations: NDArray[np.float64] | None
    ) -> None:
        """Publish a sweep of a board."""
        if isinstance(data, RawData):
            self._publish_raw(data, stamps_ns)
            return
        self._publish(data, stamps_ns, accelerations)
        for i, scores in zip(data.sweep.ids, data.scores, strict=True):
            if self._scores.get(i) != scores:
                self._take_scores(i, Scores(*scores))

    def on_magnetic_fields(self, fields: MagneticFields, stamps_ns: list[int]) -> None:
        """Publish the magnetic fields of a sweep of a board."""
        said = []
        for i, stamp_ns, field in zip(fields.sweep.ids, stamps_ns, fields.fields, strict=True):
            if np.isfinite(field).all():
                [message] = self._field_messages[i].make_fields(np.array([stamp_ns]), field[np.newaxis])
                said.append((self._field_publishers[i], message.tobytes()))
        self._say(said)

    def on_offsets(self, imu_id: int, offsets: Offsets) -> None:
        """Publish what was read from a chip."""
        self._offsets[imu_id] = offsets
        self._publish_calibration(imu_id)

    def on_event(self, event: Event) -> None:
        """Tell the user."""
        log = self.get_logger()
        # rclpy wants each severity to have a line of its own.
        if event.level is Level.INFO:
            log.info(event.message)
        elif event.level is Level.WARN:
            log.warning(event.message)
        else:
            log.error(event.message)

    def _publish(self, data: Data, stamps_ns: list[int], accelerations: NDArray[np.float64] | None) -> None:
        said = []
        rows = zip(data.sweep.ids, stamps_ns, data.orientations.tolist(), data.states, strict=True)
        for k, (i, stamp_ns, orientation, state) in enumerate(rows):
            if state is not State.RUN or not any(orientation):
                continue  # all zero is no rotation: the chip has not measured
            acceleration = None if accelerations is None else accelerations[k]
            if acceleration is not None and not np.isfinite(acceleration).all():
                acceleration = None
            message = self._imu_messages[i].make(stamp_ns, orientation, acceleration)
            said.append((self._data_publishers[i], message))
        self._say(said)

    def _publish_raw(self, data: RawData, stamps_ns: list[int]) -> None:
        said = []
        rows = zip(data.sweep.ids, stamps_ns, data.angular_velocities, data.accelerations, strict=True)
        for i, stamp_ns, velocity, acceleration in rows:
            if np.isfinite(velocity).all() and np.isfinite(acceleration).all():
                [message] = self._imu_messages[i].make_raw(
                    np.array([stamp_ns]), velocity[np.newaxis], acceleration[np.newaxis]
                )
                said.append((self._data_publishers[i], message.tobytes()))
        self._say(said)

    def _say(self, messages: list[tuple[Publisher, bytes]]) -> None:
        """Publish what a sweep has measured; who waits for it in this process gets it at once."""
        if self._hand_over:
            self._hand_over.send([(self._full_names[publisher], data) for publisher, data in messages])
        for publisher, data in messages:
            publisher.publish(data)

    def _take_scores(self, imu: int, scores: Scores) -> None:
        self._scores[imu] = scores
        # The fusion has moved on: what was read before is not what it uses at these scores.
        self._offsets.pop(imu, None)
        if scores.sensors_complete(self.configuration.serial.fusion):
            self._full_since.setdefault(imu, time.monotonic())
        else:
            self._full_since.pop(imu, None)
        self._learn_when_ready(imu)
        self._publish_calibration(imu)

    def _learn_when_ready(self, imu: int) -> None:
        """Once with all scores; before that, once without the system's, should it stay low.

        Not again when scores come back: reading takes the chip out of its fusion, and then they come and go.
        """
        since, learnt = self._full_since.get(imu), self._learnt.get(imu)
        if self.configuration.run.mode != 'calibrate' or since is None or learnt:
            return
        complete = self._scores[imu].complete(self.configuration.serial.fusion)
        if complete or (learnt is None and time.monotonic() - since > SYSTEM_PATIENCE):
            self._learnt[imu] = complete
            self._submit(imu, self._learn).add_done_callback(functools.partial(self._tell_failure, imu))

    def _submit(self, imu: int, job: Callable[[int, Board], Any]) -> 'Future[Any]':
        """Have the thread of an IMU's board do something with it."""
        return self.links[address_of(imu).board].session.submit(functools.partial(job, imu))

    def _read(self, imu: int, board: Board) -> Offsets:
        """Read a chip's offsets and publish them."""
        offsets = board.read_offsets(imu)
        self.on_offsets(imu, offsets)
        return offsets

    def _learn(self, imu: int, board: Board) -> None:
        """Read a chip's offsets, and have the board give it these again after a comeback."""
        offsets = self._read(imu, board)
        board.write_offsets(imu, offsets)
        self._saved[imu] = offsets

    def _tell_failure(self, imu: int, future: 'Future[None]') -> None:
        if error := future.exception():
            self._learnt.pop(imu, None)
            self.on_event(Event(Level.WARN, str(error)))

    # Called by the executor

    def _read_all(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """`~/read_offsets`: read the offsets of every chip and publish them."""
        del request
        deadline = time.monotonic() + _OFFSETS_PATIENCE_S
        reading = {i: self._submit(i, self._read) for i in self._ids}
        failed = []
        for i, future in reading.items():
            try:
                future.result(max(0.0, deadline - time.monotonic()))
            except FutureTimeoutError:  # of its own kind until Python 3.11
                failed.append(f'IMU {i}: no answer within {_OFFSETS_PATIENCE_S:g} s')
            except Sesa2Error as error:
                failed.append(f'IMU {i}: {error}')
        response.success = not failed
        response.message = '; '.join(failed) or f'read the offsets of {len(self._ids)} IMUs'
        return response

    def _publish_calibrations(self) -> None:
        for i in list(self._scores):
            self._learn_when_ready(i)
            self._publish_calibration(i)

    def _publish_calibration(self, imu: int) -> None:
        now_ns = time.time_ns()
        message = ImuCalibration(id=imu)
        message.header.frame_id = imu_frame(self.configuration, imu)
        message.header.stamp = Time(sec=now_ns // NS, nanosec=now_ns % NS)
        if scores := self._scores.get(imu):
            message.sys, message.gyro, message.accel, message.mag = scores
        if offsets := self._offsets.get(imu):
            message.offsets_valid = True
            message.accel_offset = np.array(offsets.accel_offset, np.int16)
            message.mag_offset = np.array(offsets.mag_offset, np.int16)
            message.gyro_offset = np.array(offsets.gyro_offset, np.int16)
            message.accel_radius, message.mag_radius = offsets.accel_radius, offsets.mag_radius
        self._calibration_publishers[imu].publish(message)


def main() -> int:
    """`ros2 run sesa2 serial_bridge`."""
    return run_alone(SerialBridge)


if __name__ == '__main__':
    raise SystemExit(main())
