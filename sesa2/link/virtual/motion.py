"""How the virtual arm moves: the three motions of the thesis's experiment (section 5.2), one after another."""

from collections.abc import Callable
from math import pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sesa2.shape import rotations

FloatArray = NDArray[np.float64]

Motion = Callable[[FloatArray], FloatArray]
"""Takes times t, s, of any shape; gives q_WL of the IMUs, shape t.shape + (n_imu, 4), x y z w."""

_STRAIGHT_S = 3.0
_MOTION_S = 10.0
_STARTS = _STRAIGHT_S + _MOTION_S * np.arange(3)
_CYCLE_S = _STRAIGHT_S + _MOTION_S * 3
_FADE_S = 1.5
_BEND = 2.4  # rad over the whole arm, enough for the tip to reach below the base
_LARGEST_BEND = 0.45 * pi  # rad between neighbouring IMUs


class ArmMotion:
    """Three seconds straight, then ten each of oscillating, buckling and circling, over and over.

    Between neighbouring IMUs (base included) the arm is an arc: constant curvature, no twist. So `pcc_exact` on these
    orientations is the arm itself.

    Parameters
    ----------
    positions
        Arc lengths of the IMUs, m, ascending, shape (n_imu,).
    base_orientation
        q_WB, x y z w.
    """

    def __init__(self, positions: ArrayLike, base_orientation: ArrayLike = (0.0, 0.0, 0.0, 1.0)) -> None:
        ends = np.asarray(positions, float)
        lengths = np.diff(ends, prepend=0.0)
        self._base = np.asarray(base_orientation, float)
        self._middle = (ends - lengths / 2) / ends[-1]
        fraction = lengths / ends[-1]
        # Few IMUs leave long sections: these bend less, to stay where slerp has one short way.
        self._bend = fraction * min(_BEND, _LARGEST_BEND / fraction.max())

    def __call__(self, t: ArrayLike) -> FloatArray:
        """Orientations at times t, s: q_WL, shape t.shape + (n_imu, 4)."""
        t = np.asarray(t, float)
        q = rotations.from_rotation_vector(self._bends(t))
        q[..., 0, :] = rotations.multiply(self._base, q[..., 0, :])
        # Products of all the first k by doubling: after each turn, 2, 4, 8… factors are in.
        done = 1
        while done < q.shape[-2]:
            q[..., done:, :] = rotations.multiply(q[..., :-done, :], q[..., done:, :])
            done *= 2
        return q

    def _bends(self, t: FloatArray) -> FloatArray:
        """Rotation vector of each section in the frame of its start, rad, shape t.shape + (n_imu, 3)."""
        u = self._middle
        t = t[..., np.newaxis]
        oscillate, buckle, circle = np.moveaxis(_windows(t), -1, 0)[..., np.newaxis]
        oscillate = oscillate * np.sin(2 * pi * t / 8)
        buckle = buckle * np.sin(2 * pi * t / 10) ** 2 * np.cos(2 * pi * u)
        circle = circle * (1.4 * u - 0.4)  # bent back near the base: a question mark
        direction = 2 * pi * t / 4 + 0.6 * u
        bends = np.zeros((*direction.shape, 3))
        bends[..., 0] = self._bend * (buckle - circle * np.sin(direction))
        bends[..., 1] = self._bend * (oscillate + circle * np.cos(direction))
        return bends


def _windows(t: FloatArray) -> FloatArray:
    """Share of each of the three motions at times t, shape (..., 1), to (..., 3): 1, but fading to 0 at both ends."""
    since = t % _CYCLE_S - _STARTS
    x = np.minimum(since, _MOTION_S - since) / _FADE_S
    x = np.minimum(np.maximum(x, 0.0), 1.0)
    return x * x * (3 - 2 * x)
