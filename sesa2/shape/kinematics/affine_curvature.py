"""Segments whose curvature varies linearly along them, in any direction, without twist."""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from sesa2.shape.kinematics.coordinates import Kinematics
from sesa2.shape.kinematics.segment_chain import Places, Segments
from sesa2.shape.rotations import FloatArray, conjugate, cross, multiply, to_matrix

# Terms of the frame's power series about the segment's middle, and Gauss nodes of the integrals over it: found by
# measuring. With slopes as large as the bend they leave 4e-15 (rad, or of the length) for 90° per axis, 7e-13 for 180°
# and 4e-9 for 360°.
_TERMS = 24
_NODES = 18
_GAUSS, _WEIGHTS = legendre.leggauss(_NODES)
_X = 0.5 * _GAUSS
_AT_NODES = np.vander(_X, _TERMS, increasing=True)


def _integrals_up_to(fraction: FloatArray) -> FloatArray:
    """Weights of the nodes in integrals from a segment's base up to fractions (n,) of it; (n, nodes).

    The integrand's Legendre series, which the nodes give, is integrated term by term.
    """
    degree = np.arange(_NODES)
    series = (degree + 0.5) * legendre.legvander(_GAUSS, _NODES - 1) * _WEIGHTS[:, None]
    place = legendre.legvander(2.0 * fraction - 1.0, _NODES)
    terms = np.empty((len(fraction), _NODES))
    terms[:, 0] = 2.0 * fraction
    terms[:, 1:] = (place[:, 2:] - place[:, :-2]) / (2.0 * degree[1:] + 1.0)
    return 0.5 * terms @ series.T


_UP_TO_NODES = _integrals_up_to(_X + 0.5)


class Rows(NamedTuple):
    """Linear maps from all segments to places.

    Attributes
    ----------
    powers : (n, m · terms)
        from the series' coefficients to the frame.
    integrals : (n, m · nodes)
        from an integrand at the nodes to its integral from the base of the segment.
    """

    powers: FloatArray
    integrals: FloatArray


class LinearCurvatureSegments(Segments[Rows]):
    """Segments along which the frame turns at the rate Ω = (−κ_y, κ_x, 0) in its own axes, κ linear.

    In complex numbers k = κ_x + i κ_y, u = x + i y and g = w + i z of the quaternion the frame obeys u′ = ½ i k g and
    g′ = ½ i k* u. It is summed as a power series about the segment's middle, where κ is bend0, so that nothing is
    singular anywhere, straight included. Positions are integrals of the tangent. By a coordinate c the frame turns at
    w = ∫ R ∂Ω/∂c and the position changes by the length times ∫ w × t.
    """

    def __init__(self, own: FloatArray):
        self._lengths = own[..., 4]
        mean, slope = np.moveaxis(np.ascontiguousarray(own[..., :4]).view(complex), -1, 0)
        rates = 0.5j * np.stack([np.stack([k, k.conj()]) for k in (mean, slope)])
        terms = np.empty((_TERMS, 2, *mean.shape), dtype=complex)
        terms[0, 0], terms[0, 1] = 0.0, 1.0
        terms[1] = rates[0] * terms[0, ::-1]
        for k in range(2, _TERMS):
            terms[k] = (rates[0] * terms[k - 1, ::-1] + rates[1] * terms[k - 2, ::-1]) / k
        series = np.empty((*mean.shape, _TERMS, 4))
        u, g = np.moveaxis(terms, 0, -1)
        series[..., 0], series[..., 1], series[..., 2], series[..., 3] = u.real, u.imag, g.imag, g.real
        base = (-0.5) ** np.arange(_TERMS) @ series
        self._series = multiply(conjugate(base)[..., None, :], series)

    @cached_property
    def _frames(self) -> FloatArray:
        """At the nodes, batch + (m, nodes, 3, 3)."""
        return to_matrix(_AT_NODES @ self._series)

    def poses(self, places: Places[Rows]) -> tuple[FloatArray, FloatArray]:
        """See Segments."""
        rows = places.kept
        length = self._lengths.take(places.section, axis=-1)[..., None]
        tangents = self._frames[..., 2]
        position = length * (rows.integrals @ _all_segments(tangents))
        return position, rows.powers @ _all_segments(self._series)

    def rates(self, places: Places[Rows]) -> FloatArray:
        """See Segments."""
        rows = places.kept
        frames = self._frames
        integrands = np.empty((*frames.shape[:-2], 3, 9))
        turning, carried, tangent = integrands[..., :4], integrands[..., 4:8], frames[..., 2]
        turning[..., 0] = frames[..., 1]
        turning[..., 1] = -frames[..., 0]
        turning[..., 2:] = _X[:, None, None] * turning[..., :2]
        flat = turning.reshape(*turning.shape[:-2], 12)
        turned = (_UP_TO_NODES @ flat).reshape(turning.shape)
        np.copyto(carried, np.swapaxes(cross(np.swapaxes(turned, -1, -2), tangent[..., None, :]), -1, -2))
        integrands[..., 8] = tangent
        flat = integrands.reshape(*integrands.shape[:-2], 27)
        integrals = rows.integrals @ _all_segments(flat)
        integrals = integrals.reshape(*integrals.shape[:-1], 3, 9)
        out = np.zeros((*integrals.shape[:-2], 6, 5))
        length = self._lengths.take(places.section, axis=-1)[..., None, None]
        out[..., :3, :4] = length * integrals[..., 4:8]
        out[..., :3, 4] = integrals[..., 8]
        out[..., 3:, :4] = integrals[..., :4]
        return out


class AffineCurvature(Kinematics[Rows]):
    """Curvature that varies linearly: per segment `bend_x0`, `bend_y0`, `bend_x1`, `bend_y1` (rad) and `length` (m).

    At the fraction v of a segment the curvature times the segment's length is bend0 + bend1 (v − ½), as a vector whose
    x part turns towards +x. So bend0 is the mean, the same as the bend of `pcc` where bend1 = 0, and bend1 is the
    curvature at the tip less that at the base. A planar segment's ends differ by the angle bend0, whatever bend1.
    Baaij et al. (A.2) start from the base instead, θ = κ₀ v + κ₁ v²/2 in one plane: κ₁ = bend1, κ₀ = bend0 − bend1 / 2.

    Where bend0 and bend1 are not parallel, the curve leaves the plane. Its frame has no torsional strain: it never
    turns about its own tangent.
    """

    name = 'affine'
    segment_coordinates = ('bend_x0', 'bend_y0', 'bend_x1', 'bend_y1', 'length')

    def _segments(self, own: FloatArray) -> LinearCurvatureSegments:
        return LinearCurvatureSegments(own)

    def _precompute(self, section: np.ndarray, fraction: FloatArray) -> Rows:
        m = len(self.segment_lengths)
        powers = np.vander(fraction - 0.5, _TERMS, increasing=True)
        return Rows(_blocks(section, m, powers), _blocks(section, m, _integrals_up_to(fraction)))


def _blocks(section: np.ndarray, m: int, rows: FloatArray) -> FloatArray:
    """Rows (n, k) for one segment each, as rows (n, m k) for all of them."""
    blocks = np.zeros((len(rows), m, rows.shape[1]))
    blocks[np.arange(len(rows)), section] = rows
    return blocks.reshape(len(rows), -1)


def _all_segments(values: FloatArray) -> FloatArray:
    """Batch + (m, k, c) as batch + (m k, c)."""
    *batch, m, k, c = values.shape
    return values.reshape(*batch, m * k, c)
