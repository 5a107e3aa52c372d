"""Velocities of joints, from one result to the next."""

import numpy as np

from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

# After so long without a result nothing is said of what was in between.
GAP_NS = NS


class JointVelocities:
    """The difference to the result before, over that of their stamps: what a joint did on average since then.

    It looks back only, so that a replay says what was said live. Unknown, nan, is that of the first result, and of one
    that is not after the one before, or more than a second.
    """

    def __init__(self) -> None:
        self._last: tuple[int, FloatArray] | None = None

    def of(self, stamps_ns: np.ndarray, joints: FloatArray) -> FloatArray:
        """Velocities of results that follow those before.

        Parameters
        ----------
        stamps_ns : (n,)
            of the results, ns, at least one.
        joints : (n, k, 3 or 4)
            angles of three revolute joints, rad, which turn the short way, so that ±π is no jump; then the length of a
            prismatic one, m.

        Returns
        -------
        The same shape, rad/s and m/s.
        """
        last_ns, last = self._last or (stamps_ns[0], joints[0])
        self._last = (stamps_ns[-1], joints[-1].copy())
        moved = np.empty(joints.shape)
        np.subtract(joints[0], last, out=moved[0])
        np.subtract(joints[1:], joints[:-1], out=moved[1:])
        turns = moved[..., :3]
        turns -= 2.0 * np.pi * np.rint(turns / (2.0 * np.pi))
        steps = np.diff(stamps_ns, prepend=last_ns)
        seconds = np.where((steps > 0) & (steps <= GAP_NS), steps / NS, np.nan)
        moved /= seconds[:, None, None]
        return moved
