"""An arm that stretches: the backbone of the arm at rest, each of its segments made as long as it is now."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.backbone import Backbone
from sesa2.shape.layout import Layout
from sesa2.shape.rotations import FloatArray


class Stretching:
    """What of an arm's stretch does not depend on what is measured.

    Parameters
    ----------
    layout
        with segments.
    """

    def __init__(self, layout: Layout):
        self._ends = layout.segment_ends
        self._rest = np.diff(self._ends)
        self._cached = lru_cache(maxsize=16)(self._precompute)

    def stretch(self, backbone: Backbone, lengths: ArrayLike) -> 'StretchedBackbone':
        """Give the segments of a backbone their present lengths.

        Parameters
        ----------
        backbone
            of the arm at rest.
        lengths : batch + (n_segments,)
            m.
        """
        lengths = np.asarray(lengths, dtype=float)
        return StretchedBackbone(backbone, lengths, lengths / self._rest, self._cached)

    def pieces(self, ends: FloatArray) -> FloatArray:
        """Share of each segment that lies in each piece of the arm.

        Parameters
        ----------
        ends : (n + 1,)
            material arc lengths at which the pieces begin and end, m.

        Returns
        -------
        (n_segments, n): lengths of the segments @ it are those of the pieces.
        """
        shares = np.clip((ends - self._ends[:-1, None]) / self._rest[:, None], 0.0, 1.0)
        return np.diff(shares, axis=-1)

    def _precompute(self, key: bytes) -> tuple[np.ndarray, FloatArray]:
        """Segment of each place, (n,), and the places with the inner ends of the segments behind them."""
        s, inner = np.frombuffer(key), self._ends[1:-1]
        return np.searchsorted(inner, s, side='left'), np.concatenate([s, inner])


class StretchedBackbone(Backbone):
    """A backbone whose segments are stretched evenly along it.

    Arc length stays that of the material, and cross-sections turn as they do at rest. With λ the stretch of a segment
    and P the position at rest, p(s) = ∫ λ dP. So with E the ends of the segments p(s) = λₖ P(s) + Σᵢ (λᵢ − λᵢ₊₁) Eᵢ,
    the sum over the segments before the k-th, in which s lies.

    Attributes
    ----------
    lengths : batch + (n_segments,)
        see Backbone.
    """

    def __init__(
        self,
        rest: Backbone,
        lengths: FloatArray,
        stretch: FloatArray,
        at: Callable[[bytes], tuple[np.ndarray, FloatArray]],
    ):
        self._rest, self.lengths = rest, lengths
        self._stretch, self._at = stretch, at
        self.fallen_back = rest.fallen_back

    def positions(self, s: ArrayLike) -> FloatArray:
        """See Backbone."""
        section, places = self._at(np.ascontiguousarray(s, dtype=float).tobytes())
        points = self._rest.positions(places)
        n = len(section)
        stretched = self._stretch.take(section, axis=-1)[..., None] * points[..., :n, :]
        if n == len(places):  # one segment
            return stretched
        steps = -np.diff(self._stretch)[..., None] * points[..., n:, :]
        shifts = np.zeros((*steps.shape[:-2], steps.shape[-2] + 1, 3))
        np.cumsum(steps, axis=-2, out=shifts[..., 1:, :])
        return stretched + shifts.take(section, axis=-2)

    def orientations(self, s: ArrayLike) -> FloatArray:
        """See Backbone."""
        return self._rest.orientations(s)
