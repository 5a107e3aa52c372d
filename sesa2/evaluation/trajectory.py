"""Where the markers were, and when: what an estimate and the truth are both made of."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sesa2.errors import Sesa2Error
from sesa2.shape.rotations import FloatArray, slerp

# Two samples lost in a row are bridged, more are a gap: at the arm's 5 m/s² a straight line over 3 × 32 ms is
# 6 mm off at worst, 1 % of the arm.
LONGEST_STEP = 3.0


class EvaluationError(Sesa2Error):
    """Recordings that cannot be compared."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Marker positions over one trial.

    Attributes
    ----------
    times : (n,)
        s, strictly increasing, any origin.
    positions : (n, m, 3)
        x y z, m, in one frame. NaN in all three components: the marker was not seen then.
    names
        the m markers.
    orientations : (n, m, 4) or None
        of the links that the markers are on, x y z w, in the same frame; None where they are not known.
    """

    times: FloatArray
    positions: FloatArray
    names: tuple[str, ...]
    orientations: FloatArray | None = None

    def __post_init__(self) -> None:
        times = np.array(self.times, dtype=float)
        positions = np.array(self.positions, dtype=float)
        names = tuple(self.names)
        if len(set(names)) != len(names) or not names:
            raise EvaluationError(f'marker names {list(names)}, expected at least one, all different')
        if times.ndim != 1 or positions.shape != (len(times), len(names), 3):
            raise EvaluationError(
                f'times {times.shape} and positions {positions.shape}, '
                f'expected (n,) and (n, {len(names)}, 3) for markers {", ".join(names)}'
            )
        if not len(times):
            raise EvaluationError('no samples')
        if not np.isfinite(times).all():
            raise EvaluationError(f'times[{np.argmin(np.isfinite(times))}] is not a finite number')
        backwards = np.flatnonzero(np.diff(times) <= 0.0)
        if len(backwards):
            i = backwards[0]
            raise EvaluationError(f'times[{i + 1}] = {times[i + 1]} s is not after times[{i}] = {times[i]} s')
        nan = np.isnan(positions)
        if np.isinf(positions).any() or (nan.any(axis=2) != nan.all(axis=2)).any():
            i, m, _ = np.argwhere(np.isinf(positions) | (nan & ~nan.all(axis=2, keepdims=True)))[0]
            raise EvaluationError(
                f'{names[m]} at sample {i} is {positions[i, m]}, expected three finite numbers, or three NaN'
            )
        if self.orientations is not None and self.orientations.shape != (*positions.shape[:2], 4):
            raise EvaluationError(
                f'orientations {self.orientations.shape}, expected {(*positions.shape[:2], 4)} as of the positions'
            )
        times.setflags(write=False)
        positions.setflags(write=False)
        object.__setattr__(self, 'times', times)
        object.__setattr__(self, 'positions', positions)
        object.__setattr__(self, 'names', names)

    @property
    def seen(self) -> np.ndarray:
        """Which markers were seen: (n, m), bool."""
        return ~np.isnan(self.positions[..., 0])

    @property
    def duration(self) -> float:
        """From the first to the last sample, s."""
        return float(self.times[-1] - self.times[0])

    @property
    def period(self) -> float:
        """Usual time from one sample to the next, s: the 90th percentile.

        Not the median: messages can come in bursts (the predecessor sent eight a sweep), and then the steps
        within a burst outnumber the steps between them.
        """
        return float(np.quantile(np.diff(self.times), 0.9)) if len(self.times) > 1 else 0.0

    def select(self, names: tuple[str, ...]) -> 'Trajectory':
        """The same trial with these markers only, in this order.

        Raises
        ------
        EvaluationError
            one of them is not there.
        """
        missing = [name for name in names if name not in self.names]
        if missing:
            raise EvaluationError(f'no marker {", ".join(missing)}; there are {", ".join(self.names)}')
        which = [self.names.index(n) for n in names]
        turned = None if self.orientations is None else self.orientations[:, which]
        return Trajectory(self.times, self.positions[:, which], names, turned)

    def turned_at(self, times: ArrayLike) -> FloatArray | None:
        """Orientations at other times, (k, m, 4), by slerp; held before the first and after the last sample."""
        if self.orientations is None:
            return None
        if len(self.times) == 1:
            return np.repeat(self.orientations, len(np.asarray(times)), axis=0)
        i = np.clip(np.searchsorted(self.times, times, side='right') - 1, 0, len(self.times) - 2)
        weight = np.clip((np.asarray(times) - self.times[i]) / (self.times[i + 1] - self.times[i]), 0.0, 1.0)
        return slerp(self.orientations[i], self.orientations[i + 1], weight[:, None])

    def at(self, times: ArrayLike) -> FloatArray:
        """Positions at other times, interpolated linearly (thesis 4.5.4).

        Parameters
        ----------
        times : (k,)
            s.

        Returns
        -------
        (k, m, 3), m; NaN before the first and after the last sample in which the marker was seen, and between two
        that are more than `LONGEST_STEP` sample periods apart.
        """
        times = np.asarray(times, dtype=float)
        out = np.full((len(times), len(self.names), 3), np.nan)
        longest = LONGEST_STEP * self.period * (1.0 + 1e-9)
        for m, seen in enumerate(self.seen.T):
            t, p = self.times[seen], self.positions[seen, m]
            if len(t) < 2:
                continue
            i = np.clip(np.searchsorted(t, times, side='right') - 1, 0, len(t) - 2)
            step = t[i + 1] - t[i]
            weight = (times - t[i]) / step
            valid = (weight >= 0.0) & (weight <= 1.0) & (step <= longest) | (weight == 0.0) | (weight == 1.0)
            i, weight = i[valid], weight[valid, None]
            out[valid, m] = (1.0 - weight) * p[i] + weight * p[i + 1]
        return out
