"""Segments of any length that bend in one plane each, but not evenly: the true shape of the simulated arm."""

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import ArrayLike

from sesa2.shape.arm import Arm
from sesa2.shape.rotations import FloatArray, multiply, rotate

# For 180° in one segment this leaves 1e-12 of its length.
_NODES = 10


class UnevenSegments:
    """Poses of places on segments that stand on one another; without twist.

    Up to the fraction v of a segment, the curve has turned by θ φ(v), θ = |bend|, the same about one axis:
    φ = v + a v (1 − v) + c (v − 3 v² + 2 v³). Its curvature is θ/L [1 + a (1 − 2 v) + c (1 − 6 v + 6 v²)]: `a` is
    affine and `c` bends both ends more than the middle. Neither changes how the tip is turned.

    Parameters
    ----------
    segment_lengths : (m,)
        at rest, m.
    affine, hollow : (m,)
        a and c.
    places : (n,)
        material arc lengths, 0 to the sum of the lengths at rest, m.

    Raises
    ------
    GeometryError
        a place is not on the arm.
    """

    def __init__(self, segment_lengths: ArrayLike, affine: ArrayLike, hollow: ArrayLike, places: ArrayLike):
        rest, s = np.asarray(segment_lengths, dtype=float), np.asarray(places, dtype=float)
        m = len(rest)
        ends = np.array([0.0, *np.cumsum(rest)])
        Arm(float(ends[-1])).check_on_arm(s)
        section = np.searchsorted(ends[1:-1], s, side='left')
        self._n = len(s)
        self._section = np.concatenate([section, np.arange(m - 1)])  # ends of all but the last stand behind
        fraction = np.concatenate([(s - ends[section]) / rest[section], np.ones(m - 1)])
        a, c = (
            np.broadcast_to(np.asarray(v, dtype=float), (m,))[self._section, None] for v in (affine, hollow)
        )
        roots, weights = leggauss(_NODES)
        # The last column is the place itself, the others are the nodes of the integral up to it.
        v = fraction[:, None] * np.append(0.5 * (1.0 + roots), 1.0)
        self._turned = v + a * v * (1.0 - v) + c * v * (1.0 - v) * (1.0 - 2.0 * v)
        self._weights = 0.5 * fraction[:, None] * weights

    def poses(self, bends: FloatArray, lengths: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions and orientations in the frame of the base.

        Parameters
        ----------
        bends : batch + (m, 2)
            bend_x, bend_y of each segment, rad; bend_x > 0 turns its tip towards +x.
        lengths : batch + (m,)
            present length of each segment, m.

        Returns
        -------
        positions : batch + (n, 3)
            m.
        orientations : batch + (n, 4)
            q_BL, x y z w.
        """
        theta = np.hypot(bends[..., 0], bends[..., 1])
        straight = theta == 0.0
        along = bends / np.where(straight, 1.0, theta)[..., None]
        section = self._section
        u, length = along[..., section, :], lengths[..., section]
        angle = theta[..., section, None] * self._turned
        position, orientation = np.empty((*angle.shape[:-1], 3)), np.zeros((*angle.shape[:-1], 4))
        sideways = length * np.sum(self._weights * np.sin(angle[..., :-1]), axis=-1)
        position[..., :2] = sideways[..., None] * u
        position[..., 2] = length * np.sum(self._weights * np.cos(angle[..., :-1]), axis=-1)
        half = 0.5 * angle[..., -1]
        sine = np.sin(half)
        orientation[..., 0], orientation[..., 1] = -sine * u[..., 1], sine * u[..., 0]
        orientation[..., 3] = np.cos(half)
        n = self._n
        start, turn = position[..., n:, :], orientation[..., n:, :]
        position, orientation = position[..., :n, :], orientation[..., :n, :]
        # From the tip down: each joint carries all that stands on it.
        for k in reversed(range(len(self._section) - n)):
            beyond = section[:n] > k
            base, q = start[..., k, None, :], turn[..., k, None, :]
            position[..., beyond, :] = base + rotate(q, position[..., beyond, :])
            orientation[..., beyond, :] = multiply(q, orientation[..., beyond, :])
        return position, orientation
