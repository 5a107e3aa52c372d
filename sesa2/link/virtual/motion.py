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
_CYCLE_S = _STRAIGHT_S + 3 * _MOTION_S
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
        steps = rotations.from_rotation_vector(self._bends(t[..., np.newaxis]))
        q = np.empty_like(steps)
        previous = self._base
        for k in range(len(self._bend)):
            previous = q[..., k, :] = rotations.multiply(previous, steps[..., k, :])
        return q

    def _bends(self, t: FloatArray) -> FloatArray:
        """Rotation vector of each section in the frame of its start, rad, shape t.shape[:-1] + (n_imu, 3)."""
        u = self._middle
        phase = t % _CYCLE_S - _STRAIGHT_S
        oscillate = _window(phase) * np.sin(2 * pi * t / 8)
        buckle = _window(phase - _MOTION_S) * np.sin(2 * pi * t / 10) ** 2 * np.cos(2 * pi * u)
        circle = _window(phase - 2 * _MOTION_S) * (1.4 * u - 0.4)  # bent back near the base: a question mark
        direction = 2 * pi * t / 4 + 0.6 * u
        bends = np.zeros((*np.broadcast_shapes(t.shape, u.shape), 3))
        bends[..., 0] = self._bend * (buckle - circle * np.sin(direction))
        bends[..., 1] = self._bend * (oscillate + circle * np.cos(direction))
        return bends


def _window(phase: FloatArray) -> FloatArray:
    """1 during a motion, fading smoothly to 0 at both of its ends."""
    x = np.clip(np.minimum(phase, _MOTION_S - phase) / _FADE_S, 0.0, 1.0)
    return x * x * (3 - 2 * x)
