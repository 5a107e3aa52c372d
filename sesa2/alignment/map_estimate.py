"""Maximum a posteriori of a handful of unknowns, from measurements that a function of them predicts."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sesa2.errors import Sesa2Error
from sesa2.shape.rotations import FloatArray

# Of Gauss–Newton; derivatives are differences over this step, rad, m or a plain number.
_STEP = 1e-4
_ITERATIONS = 40
_SETTLED = 1e-3  # of a standard deviation
_DAMPING = (0.0, *(10.0 ** np.arange(-4, 5)))
# Errors of points as Student's t with so many degrees of freedom, so that one that is wrong does not pull the others.
_FREEDOM = 5.0
_WRONG = 0.2  # weight below which a point disagrees with the rest
# What is expected to be left over counts as much as so many numbers.
_COUNTS_AS = 6.0
# An unknown is told where less than half of its expected variance is left.
_TOLD = 0.7


class MapEstimate(NamedTuple):
    """What was found.

    Attributes
    ----------
    values : (k,)
        of the unknowns; 0 where they were not told.
    std : (k,)
        standard deviation that is left.
    told : (k,)
        whether the measurements tell the unknown.
    left : (n, 3)
        residuals of the points.
    noise
        standard deviation of a component of a point, as learnt.
    weights : (n,)
        1 of a point as expected, near 0 of one that disagrees with the rest.
    """

    values: FloatArray
    std: FloatArray
    told: np.ndarray
    left: FloatArray
    noise: float
    weights: FloatArray

    @property
    def wrong(self) -> np.ndarray:
        """Points that disagree with the rest, (n,), bool."""
        return self.weights < _WRONG


def map_estimate(
    residuals: Callable[[FloatArray], FloatArray], expected: FloatArray, noise: float, share: float = 1.0
) -> MapEstimate:
    """Estimate unknowns that are expected about 0, by Gauss–Newton with damping where a step does not help.

    The noise is learnt on the way, with what is expected as its prior, and each point's weight (Student's t by
    iterated weights). What the measurements do not tell, so that the posterior is about as wide as the prior, is put
    back to 0, and the rest estimated anew given that; its uncertainty stays that of the whole.

    Parameters
    ----------
    residuals
        of values (k,) gives those of n points, (n, 3); raises a Sesa2Error where values cannot be.
    expected : (k,)
        prior standard deviation of each unknown; inf: nothing is expected.
    noise
        expected standard deviation of a component of a point.
    share
        of a point's weight against one that tells something of its own: of points that follow one another closely.

    Returns
    -------
    The estimate.
    """
    k = len(expected)
    whole = _solve(residuals, expected, noise, share, np.ones(k, dtype=bool))
    told = whole.std < _TOLD * expected
    if told.all():
        return whole
    again = _solve(residuals, expected, noise, share, told)
    return again._replace(std=whole.std, told=told)


def _solve(
    residuals: Callable[[FloatArray], FloatArray],
    expected: FloatArray,
    noise: float,
    share: float,
    free: np.ndarray,
) -> MapEstimate:
    x = np.zeros(len(expected))
    precision = 1.0 / np.square(expected[free])
    r = residuals(x)
    variance, weights = max(float(np.mean(r**2)), noise**2), np.ones(len(r))
    covariance = np.zeros((len(precision), len(precision)))
    for iteration in range(_ITERATIONS):
        J = _derivatives(residuals, x, r, free)
        scaled = share * weights / variance
        normal = np.einsum('nik,n,nil->kl', J, scaled, J) + np.diag(precision)
        gradient = np.einsum('nik,n,ni->k', J, scaled, r) + precision * x[free]
        covariance = np.linalg.pinv(normal, rcond=1e-14, hermitian=True)
        tried = _downhill(residuals, x, free, normal, gradient, scaled, precision, r)
        step = np.zeros(len(x)) if tried is None else tried[0] - x
        if tried is not None:
            x, r = tried
        if iteration > 2 and np.all(np.abs(step[free]) < _SETTLED * np.sqrt(np.diag(covariance))):
            break
        effective = max(len(precision) - float(precision @ np.diag(covariance)), 0.0)
        numbers = share * r.size
        left = share * float(weights @ np.square(r).sum(axis=1)) + _COUNTS_AS * noise**2
        variance = left / max(numbers + _COUNTS_AS - effective, 1.0)
        weights = (_FREEDOM + 3.0) / (_FREEDOM + np.square(r).sum(axis=1) / variance)
    std = np.zeros(len(x))
    std[free] = np.sqrt(np.diag(covariance))
    return MapEstimate(x, std, free, r, float(np.sqrt(variance)), weights)


def _downhill(
    residuals: Callable[[FloatArray], FloatArray],
    x: FloatArray,
    free: np.ndarray,
    normal: FloatArray,
    gradient: FloatArray,
    scaled: FloatArray,
    precision: FloatArray,
    r: FloatArray,
) -> tuple[FloatArray, FloatArray] | None:
    """The least damped step that lowers the cost, and its residuals; None where none does."""

    def cost(x: FloatArray, r: FloatArray) -> float:
        return float(scaled @ np.square(r).sum(axis=1) + precision @ np.square(x[free]))

    now = cost(x, r)
    for damping in _DAMPING:
        there = x.copy()
        there[free] -= np.linalg.pinv(
            normal + damping * np.diag(np.diag(normal)), rcond=1e-14, hermitian=True
        ) @ (gradient)
        try:
            reached = residuals(there)
        except Sesa2Error:  # no arm can be so
            continue
        if cost(there, reached) < now:
            return there, reached
    return None


def _derivatives(
    residuals: Callable[[FloatArray], FloatArray], x: FloatArray, r: FloatArray, free: np.ndarray
) -> FloatArray:
    """Of the residuals by the unknowns that are free, (n, 3, k)."""
    columns = []
    for k in np.flatnonzero(free):
        there = x.copy()
        there[k] += _STEP
        columns.append((residuals(there) - r) / _STEP)
    return np.stack(columns, axis=-1) if columns else np.zeros((*r.shape, 0))
