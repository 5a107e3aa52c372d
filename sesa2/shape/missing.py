"""Orientations of IMUs that did not measure, from their neighbours along the arm."""

from functools import lru_cache

import numpy as np

from sesa2.shape.layout import Layout
from sesa2.shape.measured import with_base
from sesa2.shape.rotations import FloatArray, slerp


def fill_missing(
    orientations: FloatArray, measured: np.ndarray, layout: Layout, base: FloatArray
) -> FloatArray:
    """Interpolate missing orientations by arc length between the nearest that are there.

    The base counts as there; beyond the last IMU that is there its orientation is held.

    Parameters
    ----------
    orientations : batch + (n_imu, 4)
        q_WL, x y z w; what stands at a missing IMU is not looked at.
    measured : batch + (n_imu,)
        true where the IMU has measured.
    layout
        the arm and its IMUs.
    base : (4,)
        or batch + (4,), q_WB.

    Returns
    -------
    batch + (n_imu, 4); the input itself where nothing is missing.
    """
    if measured.all():
        return orientations
    n = layout.n_imu
    stations = with_base(orientations, base).reshape(-1, n + 1, 4)
    # A recording has few distinct patterns of missing IMUs: each is worked out once, for all sweeps that have it.
    patterns, which = np.unique(measured.reshape(-1, n), axis=0, return_inverse=True)
    for i, pattern in enumerate(patterns):
        if not pattern.all():
            missing, left, right, fraction = _neighbours(layout, pattern.tobytes())
            rows = np.flatnonzero(which.reshape(-1) == i)[:, None]
            stations[rows, missing] = slerp(stations[rows, left], stations[rows, right], fraction)
    return stations[:, 1:].reshape(orientations.shape)


@lru_cache(maxsize=512)
def _neighbours(layout: Layout, pattern: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray, FloatArray]:
    """Stations that are missing, their living neighbours and where between these they lie."""
    at = layout.stations
    alive = np.concatenate([[True], np.frombuffer(pattern, dtype=bool)])
    living, missing = np.flatnonzero(alive), np.flatnonzero(~alive)
    after = np.searchsorted(living, missing)
    left, right = living[after - 1], living[np.minimum(after, len(living) - 1)]
    span = at[right] - at[left]
    fraction = np.where(span > 0.0, (at[missing] - at[left]) / np.where(span > 0.0, span, 1.0), 0.0)
    return missing, left, right, fraction
