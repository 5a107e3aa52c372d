"""Segments of constant curvature without twist: arcs of circles, straight among them, in closed form."""

from math import factorial

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.arm import GeometryError
from sesa2.shape.kinematics.coordinates import Kinematics
from sesa2.shape.kinematics.segment_chain import Places, Segments
from sesa2.shape.rotations import FloatArray

# Below a turn of 1 rad two quotients are summed as series in θ²; eight terms leave less than 1e-17. At the border both
# ways agree to the last digits, so that no jump is seen there.
_ORDERS = np.arange(8)
_FIRST = np.array([(-1.0) ** k / factorial(2 * k + 3) for k in _ORDERS])
_SECOND = np.array([(-1.0) ** (k + 1) * (k + 1) / factorial(2 * k + 4) for k in _ORDERS])


class ArcSegments(Segments[FloatArray]):
    """Arcs. With a, b the bend up to a place and ℓ the length up to it, θ² = a² + b² (Hughes et al. eq. 1 and 2,
    Baaij et al. A.1, both corrected):

    p = ℓ [C a, C b, A], the frame turned by (−b, a, 0), A = sin θ / θ, C = (1 − cos θ) / θ².
    """

    def __init__(self, own: FloatArray):
        self._own = own

    def _up_to(self, places: Places[FloatArray]) -> tuple[FloatArray, ...]:
        """Fraction, a, b, ℓ, θ², σ = sin(θ/2) / (θ/2) and cos(θ/2), from which A and C come without cancellation."""
        fraction = places.kept
        a, b, length = fraction * np.moveaxis(self._own.take(places.section, axis=-2), -1, 0)
        square = a * a + b * b
        half = 0.5 * np.sqrt(square)
        sigma = np.sin(half) / np.where(half == 0.0, 1.0, half)
        return fraction, a, b, length, square, np.where(half == 0.0, 1.0, sigma), np.cos(half)

    def poses(self, places: Places[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """See Segments."""
        _, a, b, length, _, sigma, cosine = self._up_to(places)
        half_sigma = 0.5 * sigma
        position, orientation = np.empty((*a.shape, 3)), np.zeros((*a.shape, 4))
        scale = length * sigma
        position[..., 0] = scale * half_sigma * a
        position[..., 1] = scale * half_sigma * b
        position[..., 2] = scale * cosine
        orientation[..., 0] = -half_sigma * b
        orientation[..., 1] = half_sigma * a
        orientation[..., 3] = cosine
        return position, orientation

    def rates(self, places: Places[FloatArray]) -> FloatArray:
        """See Segments.

        By θ², A changes by (D − C)/2 and C by E, with D = (1 − A)/θ² and E = (A − 2 C)/(2 θ²). The turn is that of the
        exponential map's left Jacobian, I + C [φ]ₓ + D [φ]ₓ² of φ = (−b, a, 0).
        """
        fraction, a, b, length, square, sigma, cosine = self._up_to(places)
        A, C = sigma * cosine, 0.5 * sigma * sigma
        D, E = _quotients(square, A, C)
        out = np.zeros((*a.shape, 6, 3))
        stretch = fraction * length
        Ca, Cb, Db, ab = C * a, C * b, D * b, a * b
        out[..., 0, 0] = stretch * (C + 2.0 * E * a * a)
        out[..., 0, 1] = out[..., 1, 0] = stretch * (2.0 * E * ab)
        out[..., 1, 1] = stretch * (C + 2.0 * E * b * b)
        lowering = stretch * (D - C)
        out[..., 2, 0] = lowering * a
        out[..., 2, 1] = lowering * b
        out[..., 0, 2] = fraction * Ca
        out[..., 1, 2] = fraction * Cb
        out[..., 2, 2] = fraction * A
        mixed = fraction * D * ab
        out[..., 3, 0] = -mixed
        out[..., 4, 0] = fraction * (1.0 - Db * b)
        out[..., 5, 0] = -fraction * Cb
        out[..., 3, 1] = fraction * (D * a * a - 1.0)
        out[..., 4, 1] = mixed
        out[..., 5, 1] = fraction * Ca
        return out


class ConstantCurvature(Kinematics[FloatArray]):
    """Piecewise constant curvature: per segment `bend_x`, `bend_y` (rad) and `length` (m).

    bend_x > 0 turns the segment's tip towards +x. The bend's magnitude is the angle between the segment's ends; there
    is no twist, and straight is no singularity.
    """

    name = 'pcc'
    segment_coordinates = ('bend_x', 'bend_y', 'length')

    def _segments(self, own: FloatArray) -> ArcSegments:
        return ArcSegments(own)

    def _precompute(self, section: np.ndarray, fraction: FloatArray) -> FloatArray:  # noqa: ARG002
        return fraction


def arc_to(tip: ArrayLike) -> FloatArray:
    """The one arc that leaves the origin along z and ends at a point; its turn is below 2π.

    The chord makes half the turn's angle with z, so that θ = 2 atan2(r, z) with r² = x² + y²; the bend is θ (x, y) / r
    and the length θ |p|² / (2 r).

    Parameters
    ----------
    tip : (..., 3)
        points in the frame of the segment's base, m. Below the base is allowed: the arc turns by more than π.

    Returns
    -------
    (..., 3): bend_x, bend_y, rad, and length, m.

    Raises
    ------
    GeometryError
        a point is not finite, is the origin or is straight behind it: no arc or none in particular ends there.
    """
    tip = np.asarray(tip, dtype=float)
    if tip.shape[-1:] != (3,):
        raise GeometryError(f'points of shape {tip.shape}, expected (..., 3)')
    x, y, z = np.moveaxis(tip, -1, 0)
    r = np.hypot(x, y)
    chord = np.hypot(r, z)
    straight = r == 0.0
    out = np.empty(tip.shape)
    with np.errstate(all='ignore'):
        turn = np.where(straight, 2.0 / z, 2.0 * np.arctan2(r, z) / r)
        out[..., 0] = turn * x
        out[..., 1] = turn * y
        out[..., 2] = 0.5 * turn * chord * chord
    lost = ~np.isfinite(out).all(axis=-1) | ~(out[..., 2] > 0.0)
    if lost.any():
        raise GeometryError(
            f'no arc from the origin along z ends at {tip[lost][0].tolist()} m, expected a finite point '
            'other than the origin and not straight behind it'
        )
    return out


def _quotients(square: FloatArray, A: FloatArray, C: FloatArray) -> tuple[FloatArray, FloatArray]:
    """D and E of ArcSegments.rates."""
    small = square < 1.0
    safe = np.where(small, 1.0, square)
    D, E = (1.0 - A) / safe, (A - 2.0 * C) / (2.0 * safe)
    if small.any():
        powers = np.vander(square[small], len(_ORDERS), increasing=True)
        D[small], E[small] = powers @ _FIRST, powers @ _SECOND
    return D, E
