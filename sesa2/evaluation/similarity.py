"""What a similarity and a clock's rate would change: diagnostics of a trial, never applied to its figures."""

from typing import NamedTuple

import numpy as np

from sesa2.evaluation.registration import fit_registration, least_squares_step
from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.shape.rotations import FloatArray, from_rotation_vector, multiply, rotate, to_rotation_vector

MAX_FITTED = 4_000  # samples
_ROUNDS = 4
_MIN_SAMPLES = 30
_MIN_TOLD = 1e-3  # of the best told direction


class Similarity(NamedTuple):
    """p_truth(t) = scale · R p_estimate(t′) + t, with truth time = (1 + clock_rate) · estimate time + const.

    Attributes
    ----------
    rotation : (4,)
        R, x y z w.
    translation : (3,)
        m.
    scale
        of the estimate, 1 where lengths agree.
    clock_rate
        by how much the truth's clock is faster than the estimate's, s/s.
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
    clock_rate: float
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


def fit_similarity(estimate: Trajectory, truth: Trajectory, time_offset: float) -> Similarity | None:
    """Least squares over all samples that both have, by Gauss–Newton.

    Parameters
    ----------
    estimate, truth
        the same markers.
    time_offset
        truth time − estimate time, s.

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
    middle, half = 0.5 * (began + ended), 0.5 * (ended - began)
    try:
        start = fit_registration('rigid', x, y)
    except EvaluationError:
        return None
    q, t, scale, shift, drift = start.rotation, start.translation, 1.0, 0.0, 0.0  # drift: at the ends, s
    step_s = 0.5 * max(estimate.period, 1e-3)
    for _ in range(_ROUNDS):
        u = (times - middle) / half
        own = times - time_offset - shift - drift * u
        x = estimate.at(own)
        v = (estimate.at(own + step_s) - estimate.at(own - step_s)) / (2.0 * step_s)
        known = ~np.isnan(x[..., 0] + y[..., 0] + v[..., 0])
        turned, velocity = rotate(q, x[known]), scale * rotate(q, v[known])
        w = np.broadcast_to(u[:, None], known.shape)[known]
        reached = scale * turned
        A = np.zeros((len(reached), 3, 9))
        vx, vy, vz = reached.T
        A[:, 0, 1], A[:, 0, 2], A[:, 1, 2] = vz, -vy, vx
        A[:, 1, 0], A[:, 2, 0], A[:, 2, 1] = -vz, vy, -vx
        A[:, :, 3:6] = np.eye(3)
        A[:, :, 6] = reached
        A[:, :, 7] = -velocity
        A[:, :, 8] = -velocity * w[:, None]
        residual = (y[known] - reached - t).ravel()
        step = least_squares_step(A.reshape(-1, 9), residual, _MIN_TOLD)
        q = multiply(from_rotation_vector(step[:3]), q)
        t = t + step[3:6]
        scale *= float(np.exp(np.clip(step[6], -0.3, 0.3)))
        shift, drift = shift + float(step[7]), drift + float(step[8])
    left = float(np.median(np.linalg.norm(residual.reshape(-1, 3), axis=1)))  # before the last step
    return Similarity(q, t, scale, drift / half, shift, float(middle), 2.0 * half, left)
