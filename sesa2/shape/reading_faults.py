"""Sensors that lie: those whose own readings show it, and those that a prediction finds out."""

from enum import IntEnum

import numpy as np

from sesa2.shape.reading_predictor import ReadingPredictor
from sesa2.shape.rotations import FloatArray

# A sensor that gives the same reading to the last bit so often is dead if meanwhile another's moved by so much noise.
REPEATS = 5
MOVED = 8.0
# An innovation of a sensor is a fault beyond this many standard deviations: once in 10⁹ readings by chance.
SURE = 6.0
# A sensor's reading is known if the other sensors and the prediction tell it within so many times its noise.
KNOWN = 10.0
# Sensors whose removal explains a frame nearly as well, by this much of χ², cannot be told apart.
_AS_GOOD = 12.0


class ReadingFault(IntEnum):
    """What is wrong with a sensor's readings."""

    NONE = 0
    SILENT = 1  # nothing, or zero to the last bit on every axis
    SATURATED = 2
    REPEATING = 3
    JUMPING = 4  # not what the other sensors and the instants before say
    DOUBTED = 5  # one of several that do not agree, and which of them cannot be told


class ReadingWatch:
    """Finds sensors whose own readings show that they lie. It remembers, so it wants all instants in their order.

    Parameters
    ----------
    predictor
        for which readings are of which sensor, their noise and their range.
    """

    def __init__(self, predictor: ReadingPredictor):
        self._sensor_of = predictor.sensor_of
        self._noise, self._largest = predictor.noise, predictor.largest
        self._n = len(predictor.names)
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self._last: FloatArray | None = None
        self._repeats = np.zeros(self._n, dtype=int)

    def faults(self, readings: FloatArray) -> np.ndarray:
        """Of each sensor, (n_sensors,) of ReadingFault, from the readings of one instant, (n_readings,)."""
        out = own_faults(readings, self._sensor_of, self._n, self._largest)
        if self._last is None:
            self._last = readings.copy()
            # What all readings were when each sensor last changed.
            self._when_changed = np.tile(readings, (self._n, 1))
            return out
        changed = self._by_sensor(readings != self._last, np.logical_or)
        self._repeats[changed] = 0
        self._repeats[~changed] += 1
        self._when_changed[changed] = readings
        self._last = readings.copy()
        long = (self._repeats >= REPEATS - 1) & (out == ReadingFault.NONE)
        for sensor in np.flatnonzero(long):
            moved = np.abs(readings - self._when_changed[sensor]) > MOVED * self._noise
            if moved.any():
                out[sensor] = ReadingFault.REPEATING
        return out

    def _by_sensor(self, values: np.ndarray, combine: np.ufunc) -> np.ndarray:
        result: np.ndarray = combine.reduceat(
            values, np.searchsorted(self._sensor_of, np.arange(self._n)), axis=-1
        )
        return result


def own_faults(readings: FloatArray, sensor_of: np.ndarray, n_sensors: int, largest: float) -> np.ndarray:
    """Silent and saturated sensors: batch + (n_sensors,) of ReadingFault, by readings, batch + (n_readings,)."""
    first = np.searchsorted(sensor_of, np.arange(n_sensors))
    absent = np.logical_or.reduceat(~np.isfinite(readings), first, axis=-1)
    silent = absent | np.logical_and.reduceat(readings == 0.0, first, axis=-1)
    with np.errstate(invalid='ignore'):
        over = np.logical_or.reduceat(np.abs(readings) >= largest, first, axis=-1)
    out = np.where(over, ReadingFault.SATURATED, ReadingFault.NONE)
    return np.where(silent, ReadingFault.SILENT, out)


def find_jumping(
    innovations: FloatArray, S: FloatArray, sensor_of: np.ndarray, most: int
) -> np.ndarray | None:
    """Sensors that do not agree with a prediction while the others do.

    Of Gaussian innovations, leaving out sensor j takes wᵀ (S⁻¹_jj)⁻¹ w with w = (S⁻¹ ν)_j from χ²: the square of what
    is unexpected in j, given all others. The worst is left out, and so on, until none is unexpected.

    Parameters
    ----------
    innovations : (n,)
        measured less predicted, over the noise.
    S : (n, n)
        their covariance.
    sensor_of : (n,)
        index of the sensor that each is of.
    most
        how many sensors may be left out.

    Returns
    -------
    Per sensor with innovations, in the order of np.unique(sensor_of), of ReadingFault: JUMPING, or DOUBTED where
    several explain it as well; None where even `most` do not explain it: then it is the prediction that is wrong.
    """
    sensors = np.unique(sensor_of)
    out = np.full(len(sensors), ReadingFault.NONE)
    used = np.ones(len(innovations), dtype=bool)
    while True:
        inverse = np.linalg.inv(S[np.ix_(used, used)])
        w = inverse @ innovations[used]
        taken, beyond = np.zeros(len(sensors)), np.zeros(len(sensors), dtype=bool)
        rows = sensor_of[used]
        for i, sensor in enumerate(sensors):
            own = np.flatnonzero(rows == sensor)
            if len(own):
                taken[i] = w[own] @ np.linalg.solve(inverse[np.ix_(own, own)], w[own])
                beyond[i] = taken[i] > beyond_chance(len(own))
        if not beyond.any():
            return out
        good = beyond & (taken >= taken.max() - _AS_GOOD)
        if np.count_nonzero(out) + np.count_nonzero(good) > most:
            return None
        out[good] = ReadingFault.JUMPING if np.count_nonzero(good) == 1 else ReadingFault.DOUBTED
        used &= ~np.isin(sensor_of, sensors[good])


def beyond_chance(n: int) -> float:
    """The χ² of n readings that chance passes as rarely as a single one passes SURE (Wilson and Hilferty)."""
    if n == 1:
        return SURE**2
    part = 2.0 / (9.0 * n)
    return n * float(1.0 - part + SURE * np.sqrt(part)) ** 3
