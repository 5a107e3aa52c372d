"""The calibration node: keeps the chips' offsets, or their accelerometers' calibrations, and says what to do next."""

import functools
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from sensor_msgs.msg import Imu
from sesa2_msgs.msg import ImuCalibration
from std_srvs.srv import Trigger

from sesa2.configuration import ConfigurationError, Mistake
from sesa2.errors import Sesa2Error
from sesa2.messages.imu_messages import ACCELERATION, ANGULAR_VELOCITY, is_inertial, read_imu_values
from sesa2.messages.topic_names import imu_calibration, imu_name, imu_topics
from sesa2.partial_files import sweep_partials
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.diagnostics import ERROR, OK, WARN, Diagnostics, Part
from sesa2.ros.parameters import declare_configuration
from sesa2.ros.qos import STREAM
from sesa2.ros.spinning import run_alone
from sesa2.sensing.imu.bno055.offsets import (
    Offsets,
    OffsetsError,
    Vector,
    load_offsets,
    offsets_are_there,
    save_accelerometer,
    save_offsets,
)
from sesa2.sensing.imu.bno055.scores import SYSTEM_PATIENCE, Scores
from sesa2.sensing.imu.pose_guide import PoseGuide
from sesa2.time import NS


class CalibrationNode(ConfinedNode):
    """Saves an IMU's offsets the moment its scores are complete, and those of all when asked.

    Calibrating, the system score may stay low: then what the bridge reads is saved too, and nothing more is asked for.
    Without fusion in the chips (RAW) there are no scores: it leads through the six poses of their accelerometers.

    Attributes
    ----------
    saved
        ids whose offsets were saved since the start.
    calibrated
        ids whose accelerometers' calibrations were.
    steps
        for each IMU heard, what to do next.
    """

    def __init__(self, **options: Any):
        super().__init__('calibration', automatically_declare_parameters_from_overrides=True, **options)
        self.configuration = declare_configuration(self)
        if not self.configuration.calibration.file:
            raise ConfigurationError(
                [Mistake('calibration.file', 'is empty, expected the file to keep offsets in')], 'calibration'
            )
        self._file = Path(self.configuration.calibration.file)
        self._check_file()
        self._fusion = self.configuration.serial.fusion
        imus = self.configuration.imus
        self._ids = imus.all_ids
        self.saved: dict[int, Offsets] = {}
        self.calibrated: set[int] = set()
        self._guides = {i: PoseGuide() for i in self._ids}
        raw, topics = self._fusion == 'RAW', imu_topics(self.configuration)
        self.steps: dict[int, str] = {}
        self._offsets: dict[int, Offsets] = {}
        self._complete: dict[int, bool] = {}
        self._done: set[int] = set()  # saved when they were complete: whatever their scores do then
        self._failure = ''
        # Not what was said before: it may be of chips that another bridge served. The present one repeats itself.
        self._subscriptions_of_imus = [
            self.create_subscription(Imu, topics[i], functools.partial(self._take_raw, i), STREAM, raw=True)
            if raw
            else self.create_subscription(
                ImuCalibration, imu_calibration(i), functools.partial(self._take, i), STREAM
            )
            for i in self._ids
        ]
        self._service = self.create_service(Trigger, '~/save', self._save_all)
        self._diagnostics = Diagnostics(self, 'calibration file', self._report)

    def _check_file(self) -> None:
        """Refuse a file that could not be kept, before somebody calibrates for it."""
        there = offsets_are_there(self._file)
        folder = self._file.resolve().parent
        if not os.access(folder, os.W_OK | os.X_OK):
            why = 'may not be written into' if folder.is_dir() else 'is not there'
            raise OffsetsError(f'{self._file}: offsets cannot be saved: the folder {folder} {why}')
        if there:
            load_offsets(self._file, ())  # refuses also a file of another program, which would be lost
            sweep_partials(self._file.resolve())

    def _take(self, imu: int, message: ImuCalibration) -> None:
        scores = Scores(message.sys, message.gyro, message.accel, message.mag)
        full, complete = scores.sensors_complete(self._fusion), scores.complete(self._fusion)
        calibrates = self.configuration.run.mode == 'calibrate'
        step = 'calibrated' if imu in self._done else scores.next_step(self._fusion)
        if calibrates and full and not complete and imu not in self._done:
            step += f'; should its system score stay low, its offsets are saved after {SYSTEM_PATIENCE:g} s'
        self._tell_step(imu, step, quietly=imu in self._done)
        self._complete[imu] = complete or (calibrates and full)
        if not message.offsets_valid:
            return
        self._offsets[imu] = Offsets(
            _vector(message.accel_offset),
            _vector(message.mag_offset),
            _vector(message.gyro_offset),
            message.accel_radius,
            message.mag_radius,
        )
        if self._complete[imu] and self.saved.get(imu) != self._offsets[imu]:
            try:
                self._save(imu)
                self._done.add(imu)
                if not complete:
                    self.get_logger().warning(
                        f'IMU {imu}: its system score is {scores.sys} of 3; gyroscope, accelerometer and magnetometer, '
                        'whose offsets were saved, are calibrated'
                    )
            except Sesa2Error as error:
                self._failure = str(error)
                self.get_logger().error(self._failure)

    def _take_raw(self, imu: int, data: bytes) -> None:
        stamp_ns, values = read_imu_values(data)
        if not is_inertial(values):
            return
        guide = self._guides[imu]
        new = guide.add(stamp_ns / NS, np.array(values[ANGULAR_VELOCITY]), np.array(values[ACCELERATION]))
        self._tell_step(imu, guide.next_step)
        if not new or not guide.complete:
            return
        try:
            save_accelerometer(self._file, imu, guide.fit().calibration)
        except Sesa2Error as error:
            self._failure = f'IMU {imu}: {error}'
            self.get_logger().error(f'{self._failure}; once more, from the start')
            self._guides[imu] = PoseGuide()
            return
        self.calibrated.add(imu)
        self._failure = ''
        self.get_logger().info(f"IMU {imu}: its accelerometer's calibration is saved in {self._file}")

    def _tell_step(self, imu: int, step: str, *, quietly: bool = False) -> None:
        if self.steps.get(imu) != step:
            self.steps[imu] = step
            if not quietly:
                self.get_logger().info(f'IMU {imu}: {step}')

    def _save(self, imu: int) -> None:
        save_offsets(self._file, imu, self._offsets[imu])
        self.saved[imu] = self._offsets[imu]
        self._failure = ''
        self.get_logger().info(f'IMU {imu}: offsets saved in {self._file}')

    def _save_all(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """`~/save`: what was last read from the chips, complete or not."""
        del request
        response.success = bool(self._offsets)
        if not self._offsets:
            response.message = 'no offsets have been read yet; call serial_bridge/read_offsets first'
            return response
        try:
            for imu in self._offsets:
                self._save(imu)
        except Sesa2Error as error:
            response.success, response.message = False, str(error)
            return response
        partly = [i for i in sorted(self._offsets) if not self._complete[i]]
        unknown = [i for i in self._ids if i not in self._offsets]
        response.message = f'saved IMUs {", ".join(map(str, sorted(self._offsets)))} in {self._file}'
        if partly:
            response.message += f'; not calibrated to the end: {", ".join(map(str, partly))}'
        if unknown:
            response.message += f'; not read yet: {", ".join(map(str, unknown))}'
        return response

    @property
    def result(self) -> str:
        """Of which IMUs the offsets were saved, and of which not."""
        done = self.calibrated if self._fusion == 'RAW' else set(self.saved)
        saved = ', '.join(str(i) for i in self._ids if i in done) or 'none'
        absent = ', '.join(str(i) for i in self._ids if i not in done)
        what = 'accelerometers calibrated' if self._fusion == 'RAW' else 'offsets saved of'
        return f'{what}: {saved}' + (f'; not of: {absent}' if absent else '')

    def _report(self) -> list[Part]:
        parts: list[Part] = []
        for imu in self._ids:
            kept = imu in self.saved or imu in self.calibrated
            saved = 'saved' if kept else 'not saved'
            step = self.steps.get(imu, 'nothing heard')
            values = {'saved': saved}
            if self._fusion == 'RAW':
                values['poses'] = str(len(self._guides[imu].poses))
            parts.append((imu_name(imu), OK if kept else WARN, f'{step}; {saved}', values))
        if self._failure:
            parts.append((str(self._file), ERROR, self._failure, {}))
        return parts


def _vector(values: Iterable[int]) -> Vector:
    x, y, z = map(int, values)
    return x, y, z


def main() -> int:
    """`ros2 run sesa2 calibration`."""
    return run_alone(CalibrationNode)


if __name__ == '__main__':
    raise SystemExit(main())
