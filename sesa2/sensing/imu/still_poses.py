"""Where an IMU was held still in what it measured: found by how little gyroscope and accelerometer scatter."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sesa2.shape.rotations import FloatArray

SHORTEST_S = 1.0
"""A pose that is held for less is none."""

# Scatter over half a second. A hand that rests on a table stays below; one that turns the IMU on does not.
_WINDOW_S = 0.5
_ACCELERATION, _ANGULAR_VELOCITY = 0.15, 0.05  # m/s², rad/s


class StillPose(NamedTuple):
    """One pose.

    Attributes
    ----------
    start, end
        s.
    acceleration
        (3,), mean of what was measured, m/s².
    """

    start: float
    end: float
    acceleration: FloatArray


def still_poses(
    times: FloatArray, accelerations: FloatArray, angular_velocities: FloatArray
) -> list[StillPose]:
    """Poses in which an IMU was held still for a second or more.

    A gyroscope's bias does no harm: scatter is looked at, not size.

    Parameters
    ----------
    times : (n,)
        s, increasing.
    accelerations : (n, 3)
        m/s².
    angular_velocities : (n, 3)
        rad/s.
    """
    if len(times) < 2:
        return []
    still = (_scatter(times, accelerations) < _ACCELERATION) & (
        _scatter(times, angular_velocities) < _ANGULAR_VELOCITY
    )
    # A gap in the recording ends a pose.
    ends = np.flatnonzero(np.diff(times) > _WINDOW_S) + 1
    changes = np.flatnonzero(np.diff(still)) + 1
    bounds = np.unique([0, *changes, *ends, len(times)])
    return [
        StillPose(float(times[a]), float(times[b - 1]), accelerations[a:b].mean(axis=0))
        for a, b in pairwise(bounds)
        if still[a] and times[b - 1] - times[a] >= SHORTEST_S
    ]


def _scatter(times: FloatArray, values: FloatArray) -> FloatArray:
    """Standard deviation, over all axes together, of the window around each sample, (n,)."""
    first = np.searchsorted(times, times - _WINDOW_S / 2)
    last = np.searchsorted(times, times + _WINDOW_S / 2, side='right')
    centred = values - values.mean(axis=0)
    sums = np.vstack([np.zeros(3), np.cumsum(centred, axis=0)])
    squares = np.concatenate([[0.0], np.cumsum(np.sum(centred**2, axis=1))])
    n = last - first
    mean = (sums[last] - sums[first]) / n[:, np.newaxis]
    variance = (squares[last] - squares[first]) / n - np.sum(mean**2, axis=1)
    return np.sqrt(np.maximum(variance, 0.0))
