"""Over which points the tip is led to a target, so that racks slip little in common."""

import numpy as np

from sesa2.control.reach import Reach, Reached
from sesa2.shape.rotations import FloatArray

# Less than that the lengths need not change for, m; and as near as this a point on the way counts as passed, m.
_LENGTH = 0.005
_PASSED = 0.008
# It is passed in any case so long after the reference could be there, s: what cannot be reached stops nobody.
_PATIENCE_S = 2.0


class TipPath:
    """Straight to the target, or unbent: straighten, change the length, bend.

    What racks slip in common the IMUs cannot see, so that it stays as an error of length. They slip the more the more
    the arm is bent, so a length that changes while the arm is straight is known better.

    Parameters
    ----------
    unbent
        whether lengths change only where the arm is straight.
    reach
        of the arm.
    speed
        at which the tip is led, m/s.
    """

    def __init__(self, unbent: bool, reach: Reach, speed: float):
        self._unbent, self._reach, self._speed = unbent, reach, speed
        self.begin()

    def begin(self) -> None:
        """Forget where it led."""
        self._reached: Reached | None = None
        self._ahead: list[FloatArray] = []
        self._left_s = 0.0

    def point(self, reached: Reached, tip: FloatArray, command: FloatArray, dt: float) -> FloatArray:
        """Where the tip is to be led now, (3,), m in B.

        Parameters
        ----------
        reached
            the target, as near as it can be.
        tip : (3,)
            where it is estimated, m in B.
        command : (3 m,)
            coordinates that are commanded, rad and m.
        dt
            since the last time, s.
        """
        if not self._unbent:
            return reached.point
        if reached is not self._reached:
            self._reached, self._ahead = reached, self._by_way_of(reached.coordinates, command)
            self._set_out(tip)
        if self._ahead:
            self._left_s -= dt
            if np.linalg.norm(tip - self._ahead[0]) < _PASSED or self._left_s < 0.0:
                del self._ahead[0]
                self._set_out(tip)
        return self._ahead[0] if self._ahead else reached.point

    def _by_way_of(self, wanted: FloatArray, command: FloatArray) -> list[FloatArray]:
        if np.abs(wanted[2::3] - command[2::3]).max() < _LENGTH:
            return []
        points = []
        for lengths in (command[2::3], wanted[2::3]):
            straight = np.zeros(len(wanted))
            straight[2::3] = lengths
            points.append(self._reach.tip(self._reach.within(straight)))
        return points

    def _set_out(self, tip: FloatArray) -> None:
        if self._ahead:
            self._left_s = float(np.linalg.norm(self._ahead[0] - tip)) / self._speed + _PATIENCE_S
