"""Velocities of joints, from one result to the next."""

import numpy as np

from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

# After so long without a result nothing is said of what was in between.
GAP_NS = NS
_TURN = 0.5 / np.pi


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
        last_ns, last = self._last or (int(stamps_ns[0]), joints[0])
        self._last = (int(stamps_ns[-1]), joints[-1].copy())
        if len(joints) == 1:  # as below, at a fifth of the time
            step_ns = int(stamps_ns[0]) - last_ns
            per_second = NS / step_ns if 0 < step_ns <= GAP_NS else np.nan
            return _steps(joints, last, per_second)
        steps = np.diff(stamps_ns, prepend=last_ns)
        known = np.where((steps > 0) & (steps <= GAP_NS), steps, np.nan)
        return _steps(joints, np.concatenate([last[None], joints[:-1]]), (NS / known)[:, None, None])


def _steps(joints: FloatArray, before: FloatArray, per_second: float | FloatArray) -> FloatArray:
    """From before, each angle the short way, times a factor."""
    steps = joints - before
    steps *= _TURN
    turns = steps[..., :3]
    turns -= np.rint(turns)
    steps *= per_second / _TURN
    return steps
