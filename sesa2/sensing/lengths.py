"""From the lengths of backbones to those of the segments they run through, and to the bends that they tell."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.arm import GeometryError
from sesa2.shape.rotations import FloatArray

# A segment's length is told where errors of the backbones come through at most so many times as large (two opposite
# each other: 0.7 times; three within 90°: 3 times).
_AMPLIFICATION = 10.0
# Of what is zero but for rounding, where the largest entries are 1.
_ZERO = 1e-9

# Why an arm that stretches gives no result.
NO_LENGTHS = 'the length of a segment was not known (absent, too old or not positive)'


class SegmentReadings(NamedTuple):
    """What backbones say of the segments.

    Attributes
    ----------
    lengths : batch + (n_segments,)
        present length of each segment on the axis, m; NaN where a backbone that tells it was not measured.
    bends : batch + (n_segments, 2)
        bend_x, bend_y, rad; NaN where the backbones do not tell it, or one of them was not measured.
    """

    lengths: FloatArray
    bends: FloatArray


class BackboneLengths:
    """Backbones that run along an arm, and whose lengths are measured.

    Beside the axis at radius d and angle φ, from x towards y, a segment of length L and bend (bend_x, bend_y) is
    L − d (bend_x cos φ + bend_y sin φ) long, however its curvature is distributed, if it does not twist
    (Hughes et al.; `bend_x` > 0 turns the tip towards +x). A backbone is the sum of this over the segments that it runs
    through. On the axis it says their length and nothing else: that is preferred, the least squares of the others only
    say what is left. Three about one segment so have L = mean l, bend = −2/(3 d) Σ l (cos φ, sin φ).

    Each list of one entry stands for all backbones. What does not depend on the measurement is computed once.

    Parameters
    ----------
    n_segments
        number of segments.
    n_backbones
        number of backbones, n.
    segments, starts
        segment that each backbone ends and begins with, counted from 1.
    angles, radii
        rad, m.
    scales, offsets
        length = scale × measured + offset, m.

    Raises
    ------
    GeometryError
        there is no backbone, or a list is not as long as it should be; an entry is out of its range.

    Attributes
    ----------
    mean_radii
        of each segment, m, mean distance from its axis of the backbones that tell both its length and its bend; 0
        where none do, or where one on the axis tells its length.
    """

    def __init__(
        self,
        n_segments: int,
        n_backbones: int,
        segments: Sequence[int] = (1,),
        starts: Sequence[int] = (1,),
        angles: Sequence[float] = (0.0,),
        radii: Sequence[float] = (0.0,),
        scales: Sequence[float] = (1.0,),
        offsets: Sequence[float] = (0.0,),
    ):
        n, m = n_backbones, n_segments
        if n < 1:
            raise GeometryError('no backbone whose length is measured, expected at least one')
        last, first = _each('segments', segments, n), _each('starts', starts, n)
        d, phi = _each('radii', radii, n), _each('angles', angles, n)
        self._scales, self._offsets = _each('scales', scales, n), _each('offsets', offsets, n)
        for i in range(n):
            if not 1 <= first[i] <= last[i] <= m:
                raise GeometryError(
                    f'backbone {i} runs from segment {first[i]:g} through {last[i]:g}, expected 1 to {m}, in this order'
                )
            if not d[i] >= 0.0:
                raise GeometryError(f'radii[{i}] = {d[i]} m, expected at least 0')
        self.n_segments, self.n_backbones = m, n
        self.radii = d
        self._runs = last, first, phi, d
        through = (np.arange(1, m + 1) >= first[:, None]) & (np.arange(1, m + 1) <= last[:, None])
        # Radii are taken against the largest, so that all unknowns have one unit and rounding one scale.
        largest = d.max() or 1.0
        aside = -np.stack([d * np.cos(phi), d * np.sin(phi)], axis=-1) / largest
        system = np.concatenate([through[:, None], through[:, None] * aside[:, :, None]], axis=1)
        system = system.transpose(0, 2, 1).reshape(n, 3 * m)  # per segment length, bend_x, bend_y
        solution, untold = _solve(system, on_axis=d == 0.0)
        solution[np.abs(solution) < _ZERO] = 0.0
        amplification = np.linalg.norm(solution, axis=1)
        told = (np.abs(untold) < _ZERO).all(axis=0) & (amplification < _AMPLIFICATION)
        told_length, self._told_bend = told.reshape(m, 3)[:, 0], told.reshape(m, 3)[:, 1:].all(axis=-1)
        by_segment = solution.reshape(m, 3, n)
        by_segment[:, 1:] /= largest
        self.length_weights, self._bend_weights = by_segment[:, 0], by_segment[:, 1:].reshape(2 * m, n)
        self.through = through
        self.untold = tuple(int(k) + 1 for k in np.flatnonzero(~told_length))
        self._system = system.reshape(n, m, 3) * [1.0, largest, largest]
        on_axis = (through & (d == 0.0)[:, None]).any(axis=0)
        self.mean_radii = tuple(
            float(d[through[:, k]].mean()) if self._told_bend[k] and not on_axis[k] else 0.0 for k in range(m)
        )

    def calibrated(self, measured: ArrayLike) -> FloatArray:
        """Lengths of the backbones from what is said of them: scale × measured + offset.

        Parameters
        ----------
        measured : batch + (n,)
            in the order of the configuration, m; NaN where there is none.

        Returns
        -------
        batch + (n,), m.
        """
        return self._scales * np.asarray(measured, dtype=float) + self._offsets

    def read(self, measured: ArrayLike) -> SegmentReadings:
        """What measured lengths say of the segments.

        Parameters
        ----------
        measured : batch + (n,)
            lengths as they are said, before scale and offset, m; NaN: not measured.

        Returns
        -------
        Length and bend of each segment.

        Raises
        ------
        GeometryError
            not n lengths.
        """
        said = np.asarray(measured, dtype=float)
        if said.shape[-1:] != (self.n_backbones,):
            raise GeometryError(f'lengths of shape {said.shape}, expected (..., {self.n_backbones})')
        lengths = self.calibrated(said)
        bends = _weighted(self._bend_weights, lengths).reshape(*said.shape[:-1], self.n_segments, 2)
        bends[..., ~self._told_bend, :] = np.nan
        return SegmentReadings(_weighted(self.length_weights, lengths), bends)

    def backbones(self, lengths: ArrayLike, bends: ArrayLike) -> FloatArray:
        """The other way: lengths of the backbones of an arm whose segments have these lengths and bends.

        Parameters
        ----------
        lengths : batch + (n_segments,)
            on the axis, m.
        bends : batch + (n_segments, 2)
            rad.

        Returns
        -------
        batch + (n,), m, as they are: scale and offset are not undone.
        """
        lengths = np.asarray(lengths, dtype=float)
        own = np.concatenate([lengths[..., None], np.asarray(bends, dtype=float)], axis=-1)
        return own.reshape(*lengths.shape[:-1], -1) @ self._system.reshape(self.n_backbones, -1).T

    def uncalibrated(self, lengths: ArrayLike) -> FloatArray:
        """What is said of backbones of these lengths, (..., n), m: the inverse of `calibrated`."""
        return np.asarray((np.asarray(lengths, dtype=float) - self._offsets) / self._scales)

    def chosen(self, which: Sequence[int]) -> 'BackboneLengths':
        """Some of the backbones, by their places among all; as they are, without scale and offset."""
        last, first, phi, d = (values[list(which)] for values in self._runs)
        return BackboneLengths(self.n_segments, len(which), last, first, phi, d)  # type: ignore[arg-type]

    @property
    def drives(self) -> bool:
        """Whether they are just enough to drive the arm: three a segment, which tell its length and its bend."""
        return self.n_backbones == 3 * self.n_segments and not self.untold and bool(self._told_bend.all())


def outside_stretch(lengths: ArrayLike, rest: ArrayLike, stretch: Sequence[float]) -> np.ndarray:
    """Which segments are shorter or longer than they should ever be; nothing is clipped.

    Parameters
    ----------
    lengths : (..., n_segments)
        m; NaN counts as inside.
    rest : (n_segments,)
        lengths at rest, m.
    stretch : (2,)
        smallest and largest length over that at rest.

    Returns
    -------
    (..., n_segments), bool.
    """
    ratio = np.asarray(lengths, dtype=float) / np.asarray(rest, dtype=float)
    return np.asarray((ratio < stretch[0]) | (ratio > stretch[1]))


def outside_in_words(segment: int) -> str:
    """That a segment, by its index, was `outside_stretch`, for people."""
    return f'segment {segment + 1}: length outside segments.stretch, used as it is'


def _each(name: str, values: Sequence[float], n: int) -> FloatArray:
    if len(values) not in (1, n):
        raise GeometryError(f'{name} has {len(values)} entries, expected 1 or {n}')
    return np.broadcast_to(np.asarray(values, dtype=float), (n,))


def _solve(system: FloatArray, on_axis: np.ndarray) -> tuple[FloatArray, FloatArray]:
    """Least squares of the rows on the axis; of the others, in what these leave open.

    Returns
    -------
    The solution's weights, (unknowns, rows), and directions in which it is open, (k, unknowns).
    """
    axis, others = system[on_axis], system[~on_axis]
    weights = np.zeros(system.shape[::-1])
    weights[:, on_axis] = np.linalg.pinv(axis, rcond=_ZERO) if len(axis) else 0.0
    open_to_axis = _null_space(axis)
    left = others @ open_to_axis
    identity = np.eye(len(system))[~on_axis]
    if left.size:
        weights = weights + open_to_axis @ np.linalg.pinv(left, rcond=_ZERO) @ (identity - others @ weights)
    return weights, (open_to_axis @ _null_space(left)).T


def _null_space(rows: FloatArray) -> FloatArray:
    """Orthonormal columns, (unknowns, k), that all rows leave at zero."""
    if not rows.size:
        return np.eye(rows.shape[1])
    _, values, directions = np.linalg.svd(rows)
    return directions[int(np.count_nonzero(values > _ZERO * values[0])) :].T


def _weighted(weights: FloatArray, lengths: FloatArray) -> FloatArray:
    """Weighted sums, (..., n) to (..., k); NaN where an entry that has a weight is NaN."""
    absent = np.isnan(lengths)
    if not absent.any():
        return np.asarray(lengths @ weights.T)
    sums = np.where(absent, 0.0, lengths) @ weights.T
    sums[absent @ (weights != 0.0).T] = np.nan
    return np.asarray(sums)
