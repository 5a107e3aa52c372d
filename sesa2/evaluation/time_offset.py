"""The time between two clocks, from the motion that both recordings saw.

At a lag τ the agreement of the two recordings is the best that any rotation between their frames and any
translation per marker can make of it: with the positions x and y about their means over the overlap,
ρ(τ) = max over R of Σ y(t + τ) · R x(t) / |x| |y|. That needs no registration, no speeds (which amplify noise) and
no common origin. All lags together cost a few FFTs (thesis 4.5.4: cross-correlation); the best one is then refined
between the samples.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sesa2.evaluation.registration import horn_matrix
from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.shape.rotations import FloatArray

GRID = 0.05  # s; an arm moved by hand does not swing within two steps of it
MAX_GRID_SAMPLES = 100_000
MIN_OVERLAP = 2.0  # s
MIN_SAMPLES = 20
MIN_MOTION = 5e-3  # m, rms about the mean

# Recordings of different motions were seen to agree (ρ up to 0.98 over a few seconds), but then about as well at other
# offsets too, with half the evidence or more; the true offset of a motion that does not repeat itself had 3.7 to 200
# times that of any other.
DECISIVE = 3.0
MIN_CORRELATION = 0.6  # even then
# A motion that repeats itself is never decisive; it is believed if most of the recordings agree closely.
MIN_CORRELATION_REPEATED = 0.95
MIN_OVERLAP_REPEATED = 0.5  # of the shorter recording
RIVAL_DISTANCE = 1.0  # s; nearer peaks are the same one, with noise on it

# A mirror image is told from errors by how much more of the motion it explains: of what is left unexplained, it leaves
# less than half, and that is more of the variance than an arm that moves in a plane has across it.
MIRROR_LEAVES = 0.5
MIRROR_EXPLAINS = 0.03

RESOLUTION = 1e-6  # s
# Of the estimate, to refine the offset with: 1 mm of noise at 0.2 m/s leaves 50 µs with so many, and more take longer.
MAX_REFINED = 10_000


class MirroredTruthError(EvaluationError):
    """The truth is a mirror image of the estimate.

    Parameters
    ----------
    mirrored, correlation
        ρ of the estimate with the mirrored truth, and with the truth as it is.

    Attributes
    ----------
    finding
        what was found, without what to do.
    """

    def __init__(self, mirrored: float, correlation: float):
        self.mirrored = mirrored
        self.finding = (
            f'the truth is a mirror image of the estimate (correlation {mirrored:.3f} mirrored, '
            f'{correlation:.3f} as it is): its axes are left-handed, such as y and z swapped'
        )
        super().__init__(
            f'{self.finding}. Export it with right-handed axes, or --register rigid scores it mirrored'
        )


@dataclass(frozen=True)
class TimeOffset:
    """Truth time = estimate time + `seconds`.

    Attributes
    ----------
    seconds
        the offset, s. Negative: the estimate's stamps are late.
    correlation
        ρ at that offset, 1 for the same motion; None if the offset was given, not found.
    rival
        another offset that fits almost as well, s; None if there is none. Motion that repeats itself makes them.
    """

    seconds: float
    correlation: float | None = None
    rival: float | None = None


def find_time_offset(estimate: Trajectory, truth: Trajectory) -> TimeOffset:
    """Find the offset between the clocks of two recordings of the same motion.

    Parameters
    ----------
    estimate, truth
        the same markers in the same order; rates, clocks and frames may differ.

    Returns
    -------
    The offset.

    Raises
    ------
    EvaluationError
        a recording is too short or does not move, or no offset makes them agree; a `MirroredTruthError` where one
        makes the truth's mirror image agree far better.
    """
    for what, trajectory in (('estimate', estimate), ('truth', truth)):
        _refuse_short(what, trajectory)
        _refuse_still(what, trajectory)
    duration = max(estimate.duration, truth.duration)
    step = max(GRID, estimate.period, truth.period, duration / MAX_GRID_SAMPLES)

    lags, overlap, correlation, mirrored = _correlate(_on_grid(estimate, step), _on_grid(truth, step), step)
    offsets = truth.times[0] - estimate.times[0] + step * lags
    # The log-likelihood ratio of "the same motion" against "any motion": a long overlap that agrees well beats
    # a short one that agrees by chance.
    evidence, evidence_mirrored = (
        -overlap * np.log1p(-np.minimum(rho**2, 1.0 - 1e-9)) for rho in (correlation, mirrored)
    )
    best = int(np.argmax(evidence))
    refuse_mirrored(float(mirrored[np.argmax(evidence_mirrored)]), float(correlation[best]))
    rival = _rival(offsets, evidence, best)
    if rival is None:
        believed = correlation[best] >= MIN_CORRELATION
    else:
        enough = MIN_OVERLAP_REPEATED * min(estimate.duration, truth.duration)
        believed = correlation[best] >= MIN_CORRELATION_REPEATED and overlap[best] >= enough
    if not believed:
        as_well = '' if rival is None else f', and {correlation[rival]:.2f} at {offsets[rival]:+.3f} s'
        raise EvaluationError(
            f'no overlap in time, or not the same motion: no offset makes the two recordings agree. Best correlation '
            f'{correlation[best]:.2f} over {overlap[best]:.1f} s at {offsets[best]:+.3f} s{as_well}. Estimate: '
            f'{estimate.duration:.1f} s from {estimate.times[0]:.3f} s; truth: {truth.duration:.1f} s from '
            f'{truth.times[0]:.3f} s. Give the offset if they do belong together'
        )

    stride = -(-len(estimate.times) // MAX_REFINED)

    def agreement(offset: float) -> float:
        # The truth is the one to interpolate: interpolation smooths, and smoothing the estimate's noise
        # would draw the offset to wherever its samples fall halfway between the truth's.
        x, y = estimate.positions[::stride], truth.at(estimate.times[::stride] + offset)
        return correlations(x, y)[0]

    coarse = float(offsets[best])
    offset = _maximise(agreement, coarse - 2.0 * step, coarse + 2.0 * step)
    return TimeOffset(offset, agreement(offset), None if rival is None else float(offsets[rival]))


def refuse_mirrored(mirrored: float, correlation: float) -> None:
    """Raise a `MirroredTruthError` where the mirrored truth agrees far better than the truth as it is."""
    left, left_mirrored = 1.0 - correlation * abs(correlation), 1.0 - mirrored * abs(mirrored)
    if (
        left_mirrored < MIRROR_LEAVES * left
        and left - left_mirrored > MIRROR_EXPLAINS
        and mirrored > MIN_CORRELATION
    ):
        raise MirroredTruthError(mirrored, correlation)


def _refuse_short(what: str, trajectory: Trajectory) -> None:
    if trajectory.duration < MIN_OVERLAP or len(trajectory.times) < MIN_SAMPLES:
        raise EvaluationError(
            f'the {what} is too short to find a time offset: {len(trajectory.times)} samples in '
            f'{trajectory.duration:.2f} s, expected at least {MIN_SAMPLES} in {MIN_OVERLAP:g} s'
            + ('. Give the offset instead' if len(trajectory.times) > 2 else '')
        )


def _refuse_still(what: str, trajectory: Trajectory) -> None:
    p = trajectory.positions
    with np.errstate(invalid='ignore'):
        about_mean = p - np.nansum(p, axis=0) / trajectory.seen.sum(axis=0)[:, None]
    motion = np.sqrt(np.nansum(about_mean**2) / max(trajectory.seen.sum(), 1))
    if motion < MIN_MOTION:
        raise EvaluationError(
            f'the {what} does not move: {1e3 * motion:.2f} mm rms about the mean, expected at least '
            f'{1e3 * MIN_MOTION:g} mm to find a time offset. Move the arm, or give the offset'
        )


def _on_grid(trajectory: Trajectory, step: float) -> FloatArray:
    n = int(trajectory.duration / step) + 1
    return trajectory.at(trajectory.times[0] + step * np.arange(n))


def _correlate(
    x: FloatArray, y: FloatArray, step: float
) -> tuple[np.ndarray, FloatArray, FloatArray, FloatArray]:
    """Agreement of y[i + l] with x[i] at every lag l, over the samples that both have then.

    Parameters
    ----------
    x, y
        (nx, m, 3) and (ny, m, 3), m; NaN where not seen.
    step
        of the grid, s.

    Returns
    -------
    lags (k,), in samples; the overlap there (k,), s, mean over the markers; ρ (k,); ρ with −y (k,).
    """
    n_lags = len(x) + len(y) - 1
    size = 1 << (n_lags - 1).bit_length()

    def spectrum(signal: FloatArray) -> np.ndarray:
        return np.fft.rfft(signal, size, axis=0)

    def correlate(a: np.ndarray, b: np.ndarray) -> FloatArray:
        both = np.fft.irfft(np.conj(a) * b, size, axis=0)
        return np.concatenate((both[size - len(x) + 1 :], both[: len(y)]))

    count = np.zeros(n_lags)
    energy_x, energy_y = np.zeros(n_lags), np.zeros(n_lags)
    covariance = np.zeros((n_lags, 3, 3))
    for m in range(x.shape[1]):
        seen_x, x_m = _centred(x[:, m])
        seen_y, y_m = _centred(y[:, m])
        one_x, one_y, sx, sy = spectrum(seen_x), spectrum(seen_y), spectrum(x_m), spectrum(y_m)
        n = np.maximum(correlate(one_x, one_y), 0.0)
        sum_x, sum_y = correlate(sx, one_y[:, None]), correlate(one_x[:, None], sy)
        per_n = 1.0 / np.maximum(n, 0.5)
        count += n
        energy_x += correlate(spectrum((x_m**2).sum(axis=1)), one_y) - per_n * (sum_x**2).sum(axis=1)
        energy_y += correlate(one_x, spectrum((y_m**2).sum(axis=1))) - per_n * (sum_y**2).sum(axis=1)
        covariance += correlate(sx[:, :, None], sy[:, None, :])
        covariance -= per_n[:, None, None] * sum_x[:, :, None] * sum_y[:, None, :]

    still = count * MIN_MOTION**2
    overlap = count * step / x.shape[1]
    usable = (overlap >= MIN_OVERLAP) & (energy_x > still) & (energy_y > still)
    if not usable.any():
        raise EvaluationError(
            f'no time offset lets estimate and truth overlap by {MIN_OVERLAP:g} s with at least '
            f'{1e3 * MIN_MOTION:g} mm rms of motion in both'
        )
    # The matrix of −y is the negative one: its largest eigenvalue is the smallest one here.
    products = np.linalg.eigvalsh(horn_matrix(covariance[usable]))
    size_of_both = np.sqrt(energy_x[usable] * energy_y[usable])
    lags = np.arange(-len(x) + 1, len(y))[usable]
    return lags, overlap[usable], products[:, -1] / size_of_both, -products[:, 0] / size_of_both


def _centred(p: FloatArray) -> tuple[FloatArray, FloatArray]:
    """One marker as (seen or not, position about the mean and zero where not seen)."""
    seen = ~np.isnan(p[:, 0])
    out = np.zeros_like(p)
    if seen.any():
        out[seen] = p[seen] - p[seen].mean(axis=0)
    return seen.astype(float), out


def correlations(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """ρ of two series of positions, (n, m, 3), over what both have seen; and that of x with the mirror image of y."""
    energy_x = energy_y = 0.0
    covariance = np.zeros((3, 3))
    for m in range(x.shape[1]):
        both = ~(np.isnan(x[:, m, 0]) | np.isnan(y[:, m, 0]))
        if both.any():
            a, b = x[both, m], y[both, m]
            a, b = a - a.mean(axis=0), b - b.mean(axis=0)
            energy_x += float((a**2).sum())
            energy_y += float((b**2).sum())
            covariance += a.T @ b
    if energy_x * energy_y == 0.0:
        return 0.0, 0.0
    products = np.linalg.eigvalsh(horn_matrix(covariance)) / np.sqrt(energy_x * energy_y)
    return float(products[-1]), float(-products[0])


def _maximise(f: Callable[[float], float], low: float, high: float) -> float:
    """Golden section: the place of the one maximum of f between low and high."""
    ratio = 0.5 * (np.sqrt(5.0) - 1.0)
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    fa, fb = f(a), f(b)
    while high - low > RESOLUTION:
        if fa > fb:
            high, b, fb = b, a, fa
            a = high - ratio * (high - low)
            fa = f(a)
        else:
            low, a, fa = a, b, fb
            b = low + ratio * (high - low)
            fb = f(b)
    return float(0.5 * (low + high))


def _rival(offsets: FloatArray, evidence: FloatArray, best: int) -> int | None:
    """The strongest other peak, unless the best one is decisively stronger."""
    peaks = np.flatnonzero((evidence[1:-1] >= evidence[:-2]) & (evidence[1:-1] > evidence[2:])) + 1
    peaks = peaks[np.abs(offsets[peaks] - offsets[best]) > RIVAL_DISTANCE]
    peaks = peaks[DECISIVE * evidence[peaks] > evidence[best]]
    return int(peaks[np.argmax(evidence[peaks])]) if len(peaks) else None
