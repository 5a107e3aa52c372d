"""How fast the truth's clock runs against the estimate's, and how well a trial tells it.

Shapes and frames err too, and slowly: a heading that wanders while the arm circles looks like a clock that drifts. So
each window of some seconds has a rotation, a scale and a translation for each marker of its own, and tells the time
between the clocks by what these leave: by where the arm turns back, not by where it is. How far the windows scatter
about a straight line says how well they tell.
"""

from typing import NamedTuple

import numpy as np

from sesa2.shape.rotations import FloatArray

WINDOW = 4.0  # s
_MIN_SAMPLES = 30  # of a window
_MIN_WINDOWS = 5
_VELOCITY_OVER = 0.1  # s, to either side: noise of 1 mm is 7 mm/s then
_MIN_TOLD = 1e-6  # of the best told direction of a window


class ClockStep(NamedTuple):
    """By what two clocks differ, as far as a first guess left it.

    Attributes
    ----------
    shift
        of the truth's clock in the middle of the trial, s.
    rate
        by how much it is faster, s/s.
    rate_std
        standard deviation of `rate`; infinite where there are too few windows.
    """

    shift: float = 0.0
    rate: float = 0.0
    rate_std: float = np.inf


def velocities(times: FloatArray, positions: FloatArray) -> FloatArray:
    """Velocities of markers, smoothed over what tells motion from noise.

    Parameters
    ----------
    times : (n,)
        s, increasing.
    positions : (n, m, 3)
        m; NaN where not seen.

    Returns
    -------
    (n, m, 3), m/s; NaN at the ends and beside what was not seen.
    """
    early = np.searchsorted(times, times - _VELOCITY_OVER)
    late = np.searchsorted(times, times + _VELOCITY_OVER, side='right') - 1
    alone = early == late
    early, late = np.maximum(early - alone, 0), np.minimum(late + alone, len(times) - 1)
    took = times[late] - times[early]
    v: FloatArray = (positions[late] - positions[early]) / np.where(took > 0.0, took, np.nan)[:, None, None]
    return v


def clock_step(
    times: FloatArray, middle: float, estimate: FloatArray, truth: FloatArray, velocity: FloatArray
) -> ClockStep:
    """Time between two clocks, by windows.

    Parameters
    ----------
    times : (n,)
        of the truth, s, increasing.
    middle
        of the trial, s.
    estimate, truth : (n, m, 3)
        the same markers in about the same frame, by a first guess of the clocks, m; NaN where not known.
    velocity : (n, m, 3)
        of the truth, m/s: its noise is not the estimate's, which would make steps too small.
    """
    known = ~np.isnan(estimate[..., 0] + truth[..., 0] + velocity[..., 0])
    some = np.flatnonzero(known.any(axis=1))
    if not len(some):
        return ClockStep()
    duration = times[some[-1]] - times[some[0]]
    n = int(min(duration / WINDOW, len(some) / _MIN_SAMPLES))
    if n < _MIN_WINDOWS:
        return ClockStep()
    bounds = np.searchsorted(times, times[some[0]] + duration / n * np.arange(1, n))
    told = [
        (
            *_window(estimate[i], truth[i] - estimate[i], velocity[i], known[i]),
            float(times[i].mean()) - middle,
        )
        for i in np.split(np.arange(len(times)), bounds)
        if known[i].sum() >= _MIN_SAMPLES
    ]
    if len(told) < _MIN_WINDOWS:
        return ClockStep()
    shifts, information, left, at = np.array(told).T
    # A window that agrees by chance does not outweigh all others.
    weight = information / (left + np.median(left))
    line = np.stack([np.ones_like(at), at], axis=1)
    normal = line.T @ (weight[:, None] * line)
    if not np.linalg.cond(normal) * np.finfo(float).eps < 1.0:
        return ClockStep()
    shift, rate = np.linalg.solve(normal, line.T @ (weight * shifts))
    scatter = weight @ (shifts - line @ (shift, rate)) ** 2 / (len(at) - 2)
    return ClockStep(float(shift), float(rate), float(np.sqrt(scatter * np.linalg.inv(normal)[1, 1])))


def _window(
    estimate: FloatArray, residual: FloatArray, velocity: FloatArray, known: np.ndarray
) -> tuple[float, float, float]:
    """The shift in a window, s; how well it is told, (m/s)²; and mean square of what is left, m²."""
    m = known.shape[1]
    x, y, z = (estimate[known] - estimate[known].mean(axis=0)).T
    design = np.zeros((len(x), 3, 4 + 3 * m))
    design[:, 0, 1], design[:, 0, 2], design[:, 1, 2] = z, -y, x
    design[:, 1, 0], design[:, 2, 0], design[:, 2, 1] = -z, y, -x
    design[..., 3] = np.stack([x, y, z], axis=1)
    marker = np.broadcast_to(np.arange(m), known.shape)[known]
    design[np.arange(len(x))[:, None], np.arange(3), 4 + 3 * marker[:, None] + np.arange(3)] = 1.0
    directions, singular, _ = np.linalg.svd(design.reshape(-1, 4 + 3 * m), full_matrices=False)
    directions = directions[:, singular > _MIN_TOLD * singular[0]]
    moves, off = -velocity[known].ravel(), residual[known].ravel()
    moves, off = (a - directions @ (directions.T @ a) for a in (moves, off))
    information = float(moves @ moves)
    shift = float(moves @ off) / max(information, 1e-30)
    return shift, information, float(np.mean((off - shift * moves) ** 2))
