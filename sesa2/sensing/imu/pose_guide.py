"""Leads through the six poses of an accelerometer's calibration while samples come in."""

from collections import deque

import numpy as np

from sesa2.sensing.imu.accelerometer_calibration import SIDES, PoseFit, calibrate_accelerometer, side_up
from sesa2.sensing.imu.still_poses import SHORTEST_S, still_poses
from sesa2.shape.rotations import FloatArray

_WATCHED_S = 2.0
_LOOK_S = 0.25
_DONE = 'calibrated'


class PoseGuide:
    """Of one IMU.

    Attributes
    ----------
    poses
        by the side that was up, what was measured: of the last time where it was held more than once.
    """

    def __init__(self) -> None:
        self.poses: dict[str, FloatArray] = {}
        self._samples: deque[tuple[float, FloatArray, FloatArray]] = deque()
        self._looked_s = -np.inf

    @property
    def complete(self) -> bool:
        """Whether every side has been up."""
        return len(self.poses) == len(SIDES)

    @property
    def next_step(self) -> str:
        """What to do now."""
        if self.complete:
            return _DONE
        missing = ', '.join(side for side in SIDES if side not in self.poses)
        return f'hold it still for 2 s with each of these sides up: {missing} (accelerometer)'

    def add(self, time: float, angular_velocity: FloatArray, acceleration: FloatArray) -> bool:
        """Take a sample, its time in s; whether it ended a pose that was not there yet."""
        if self._samples and not 0.0 < time - self._samples[-1][0] < SHORTEST_S:
            self._samples.clear()
            self._looked_s = -np.inf
        self._samples.append((time, angular_velocity, acceleration))
        while time - self._samples[0][0] > _WATCHED_S:
            self._samples.popleft()
        if time - self._looked_s < _LOOK_S:
            return False
        self._looked_s = time
        t, w, a = (np.array(column) for column in zip(*self._samples, strict=True))
        held = [pose for pose in still_poses(t, a, w) if pose.end == t[-1]]
        if not held:
            return False
        side = side_up(held[0].acceleration)
        new = side not in self.poses
        self.poses[side] = held[0].acceleration
        return new

    def fit(self) -> PoseFit:
        """The calibration by the poses so far.

        Raises
        ------
        AccelerometerError
            a side is missing, or the poses make no sense.
        """
        return calibrate_accelerometer(list(self.poses.values()))
