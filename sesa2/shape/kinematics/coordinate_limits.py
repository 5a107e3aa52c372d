"""How far the coordinates of an arm's segments can go."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.arm import GeometryError
from sesa2.shape.kinematics.coordinates import Kinematics
from sesa2.shape.rotations import FloatArray


class CoordinateLimits:
    """The workspace: bends within a circle, lengths within a stretch.

    The second bend of `affine`, tip less base, may be twice the first: then one end is straight.

    Parameters
    ----------
    kinematics
        whose coordinates they are.
    bend_max
        largest |bend| of a segment, rad.
    stretch : (2,)
        least and largest length of a segment, in parts of that at rest.

    Attributes
    ----------
    kinematics
        as given.
    scales : (n_coordinates,)
        how much of a coordinate is much: the largest bend, rad, and the span of lengths, m.

    Raises
    ------
    GeometryError
        bend_max is not positive, or the stretch is not of two ascending positive numbers.
    """

    def __init__(self, kinematics: Kinematics[Any], bend_max: float, stretch: ArrayLike):
        least, most = np.asarray(stretch, dtype=float)
        if not (np.isfinite(bend_max) and bend_max > 0.0):
            raise GeometryError(f'bend_max = {bend_max} rad, expected a positive number')
        if not (0.0 < least <= most < np.inf):
            raise GeometryError(
                f'stretch = {[least, most]}, expected two positive numbers, the second not less'
            )
        self.kinematics = kinematics
        names = kinematics.segment_coordinates
        each = len(names)
        starts = each * np.arange(len(kinematics.segment_lengths))[:, None]
        x = [i for i, name in enumerate(names) if name.startswith('bend_x')]
        largest = np.array([2.0 * bend_max if names[i].endswith('1') else bend_max for i in x])
        self._x = (starts + x).ravel()
        self._y = self._x + 1
        self._largest = np.tile(largest, len(starts))
        self._lengths = (starts + names.index('length')).ravel()
        self._least, self._most = least * kinematics.segment_lengths, most * kinematics.segment_lengths
        self.scales = np.empty(kinematics.n_coordinates)
        self.scales[self._x] = self.scales[self._y] = self._largest
        # A length that cannot change still needs a scale that is not 0.
        self.scales[self._lengths] = np.maximum(self._most - self._least, 1e-6 * kinematics.segment_lengths)
        self.scales.setflags(write=False)

    def clip(self, q: FloatArray) -> FloatArray:
        """The nearest coordinates within the limits, batch + (n_coordinates,); a bend keeps its direction."""
        out = np.array(q, dtype=float)
        x, y = out[..., self._x], out[..., self._y]
        size = np.sqrt(x * x + y * y)
        if (size > self._largest).any():
            shrink = self._largest / np.maximum(size, self._largest)
            out[..., self._x], out[..., self._y] = shrink * x, shrink * y
        out[..., self._lengths] = np.clip(out[..., self._lengths], self._least, self._most)
        return out

    def outward(self, q: FloatArray) -> FloatArray | None:
        """Which way out it is at the limits that coordinates (n, n_coordinates) are at.

        Returns
        -------
        (n, n_limits, n_coordinates), unit vectors in coordinates over `scales`, zero for limits that are not reached;
        None where none is.
        """
        x, y, lengths = q[:, self._x], q[:, self._y], q[:, self._lengths]
        size, near = np.sqrt(x * x + y * y), 1e-9
        bent = size >= self._largest * (1.0 - near)
        short, long = lengths <= self._least * (1.0 + near), lengths >= self._most * (1.0 - near)
        if not (bent.any() or short.any() or long.any()):
            return None
        n_bends = len(self._x)
        out = np.zeros((len(q), n_bends + len(self._lengths), q.shape[1]))
        bends, rest = np.arange(n_bends), np.arange(n_bends, out.shape[1])
        size = np.where(bent, size, np.inf)
        out[:, bends, self._x], out[:, bends, self._y] = x / size, y / size
        out[:, rest, self._lengths] = 1.0 * long - 1.0 * short
        return out

    def draw(self, n: int, rng: np.random.Generator) -> FloatArray:
        """Coordinates of n random shapes within the limits, (n, n_coordinates); a third of their bends are at them."""
        out = np.empty((n, len(self.scales)))
        size = self._largest * np.sqrt(np.minimum(1.5 * rng.random((n, len(self._x))), 1.0))
        angle = 2.0 * np.pi * rng.random(size.shape)
        out[:, self._x], out[:, self._y] = size * np.cos(angle), size * np.sin(angle)
        out[:, self._lengths] = rng.uniform(self._least, self._most, (n, len(self._lengths)))
        return out
