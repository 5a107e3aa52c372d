"""What a similarity and a clock's rate would change: diagnostics of a trial, never applied to its figures."""

from typing import NamedTuple

import numpy as np

from sesa2.evaluation.clock_rate import WINDOW, clock_step, velocities
from sesa2.evaluation.registration import fit_registration, least_squares_step
from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.shape.rotations import FloatArray, from_rotation_vector, multiply, rotate, to_rotation_vector

MAX_FITTED = 10_000  # samples: an hour has windows of 11 s with 30
# A clock's rate is told where it is so much, from the first to the last sample, and so many standard deviations.
DRIFT = 0.025  # s
DRIFT_TELLS = 5.0
_WELL_TOLD = 1e-3  # s/s
_BENDS = 2.0  # expected of `bends`
_WINDOWS, _FEWEST_WINDOWS = 8, 5
_ROUNDS = 4
_MIN_SAMPLES = 30
_MIN_TOLD = 1e-3  # of the best told direction


class Similarity(NamedTuple):
    """p_truth(t) = (scale + bends · d) R p_estimate(t′) + t; truth time = (1 + clock_rate) · estimate time + const.

    d is how much nearer to the base a marker is than on the straight arm, as a share. Models with few IMUs miss some of
    what an arm bends between them, and are too long then; wrong lengths are as wrong when it is straight.

    Attributes
    ----------
    rotation : (4,)
        R, x y z w.
    translation : (3,)
        m.
    scale
        of the estimate, 1 where lengths agree.
    scale_std
        its standard deviation; infinite where there are too few samples to tell.
    bends
        what is added to the scale where the arm bends, per d.
    clock_rate
        by how much the truth's clock is faster than the estimate's, s/s.
    clock_rate_std
        standard deviation of `clock_rate`; infinite where the trial is too short to tell it.
    shift
        of the truth's clock, s, in the middle of the trial, besides the time offset.
    middle
        truth time there, s.
    seconds
        that both recordings have in common.
    left
        median error after it, m.
    """

    rotation: FloatArray
    translation: FloatArray
    scale: float
    scale_std: float
    bends: float
    clock_rate: float
    clock_rate_std: float
    shift: float
    middle: float
    seconds: float
    left: float

    def estimate_times(self, times: FloatArray, time_offset: float) -> FloatArray:
        """Times of the estimate's clock at times of the truth's, s."""
        return times - time_offset - self.shift - self.clock_rate * (times - self.middle)

    @property
    def turn(self) -> FloatArray:
        """R as a rotation vector, (3,), rad."""
        return to_rotation_vector(self.rotation)

    @property
    def clock_told_from(self) -> float:
        """The least rate of the truth's clock that is told, s/s; infinite where the trial is too short."""
        return max(DRIFT / max(self.seconds, DRIFT), DRIFT_TELLS * self.clock_rate_std)

    def told(self) -> str:
        """Scale and clock rate, for people."""
        scale, least = f'scale {self.scale:.4f}', self.clock_told_from
        if np.isfinite(self.scale_std):
            scale += f' ± {self.scale_std:.4f}'
        if np.isinf(least):
            return f'{scale} would fit best; the trial is too short to tell the clock rate'
        rate = f'clock rate {1e6 * self.clock_rate:+.0f} ± {1e6 * self.clock_rate_std:.0f} ppm'
        short = f' (too short a trial to tell less than {1e6 * least:.0f} ppm)' if least > _WELL_TOLD else ''
        return f'{scale}, {rate} would fit best{short}'


def fit_similarity(
    estimate: Trajectory, truth: Trajectory, time_offset: float, arc_lengths: FloatArray
) -> Similarity | None:
    """Least squares over all samples that both have, by Gauss–Newton; the clocks by windows (`clock_rate`).

    Parameters
    ----------
    estimate, truth
        the same markers.
    time_offset
        truth time − estimate time, s.
    arc_lengths : (m,)
        of the markers, m.

    Returns
    -------
    The similarity; None where the motion does not tell it.
    """
    stride = -(-len(truth.times) // MAX_FITTED)
    times, y = truth.times[::stride], truth.positions[::stride]
    x = estimate.at(times - time_offset)
    known = ~np.isnan(x[..., 0] + y[..., 0])
    some = known.any(axis=1)
    if known.sum() < _MIN_SAMPLES:
        return None
    began, ended = times[some][[0, -1]]
    middle = float(0.5 * (began + ended))
    try:
        start = fit_registration('rigid', x, y)
    except EvaluationError:
        return None
    q, t, factors = start.rotation, start.translation, np.array([1.0, 0.0])  # scale, bends
    shift, rate, rate_std = 0.0, 0.0, np.inf
    velocity = velocities(times, y)
    # Of a short trial, shorter ones.
    width = max(min(WINDOW, (ended - began) / _WINDOWS), 1e-9)
    window = ((times - began) // width).astype(int)
    for _ in range(_ROUNDS):
        x = estimate.at(times - time_offset - shift - rate * (times - middle))
        known = ~np.isnan(x[..., 0] + y[..., 0])
        of = np.stack([np.ones(known.shape), 1.0 - np.linalg.norm(x, axis=2) / arc_lengths], axis=2)
        turned, size = rotate(q, x[known]), (of @ factors)[..., None]
        reached = size[known] * turned
        residual = y[known] - reached - t
        A = np.zeros((len(reached), 3, 8))
        vx, vy, vz = reached.T
        A[:, 0, 1], A[:, 0, 2], A[:, 1, 2] = vz, -vy, vx
        A[:, 1, 0], A[:, 2, 0], A[:, 2, 1] = -vz, vy, -vx
        A[:, :, 3:6] = np.eye(3)
        A[:, :, 6:] = turned[:, :, None] * of[known][:, None]
        which = np.unique(np.broadcast_to(window[:, None], known.shape)[known], return_inverse=True)[1]
        # An arm that hardly bends does not tell what bending does: then it is nothing.
        expected = np.sqrt(np.mean(residual**2) * residual.size / (which.max() + 1)) / _BENDS * np.eye(8)[7:]
        rows = np.concatenate([A.reshape(-1, 8), expected])
        step = least_squares_step(rows, np.append(residual.ravel(), -expected[0, 7] * factors[1]), _MIN_TOLD)
        q = multiply(from_rotation_vector(step[:3]), q)
        t = t + step[3:6]
        factors = factors + np.clip(step[6:], -0.3, 0.3)
        clocks = clock_step(times, middle, size * rotate(q, x) + t, y, velocity)
        shift, rate, rate_std = shift + clocks.shift, rate + clocks.rate, clocks.rate_std
    left = float(np.median(np.linalg.norm(residual, axis=1)))  # before the last step
    scale_std = _std_by_windows(rows, A, residual - A @ step, which)[6]
    return Similarity(
        q,
        t,
        float(factors[0]),
        scale_std,
        float(factors[1]),
        rate,
        rate_std,
        shift,
        middle,
        float(ended - began),
        left,
    )


def _std_by_windows(rows: FloatArray, A: FloatArray, left: FloatArray, window: np.ndarray) -> FloatArray:
    """Standard deviations of least squares whose residuals are alike within a window: the sandwich of its sums.

    Liang and Zeger 1986, "Longitudinal data analysis using generalized linear models".
    """
    inverse = np.linalg.pinv(rows.T @ rows, rcond=_MIN_TOLD**2, hermitian=True)
    sums = np.zeros((window.max() + 1, A.shape[-1]))
    np.add.at(sums, window, np.einsum('nij,ni->nj', A, left))
    n = len(sums)
    spread = inverse @ (sums.T @ sums) @ inverse * n / max(n - A.shape[-1] / 2.0, 1.0)
    if n < _FEWEST_WINDOWS:
        return np.full(A.shape[-1], np.inf)
    deviations: FloatArray = np.sqrt(np.maximum(np.diag(spread), 0.0))
    return deviations
