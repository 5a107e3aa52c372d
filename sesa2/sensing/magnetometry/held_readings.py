"""Readings of an arm that is held still, and what shows that they cannot be what they are taken for."""

from typing import NamedTuple

import numpy as np

from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings
from sesa2.shape.arm import GeometryError
from sesa2.shape.rotations import FloatArray

FEWEST = 10
"""Of a pose, readings of each magnetometer."""
# Scatter over the noise seen from one reading to the next, and over the expected one: with both more, the arm moves.
_MOVING = 3.0
# Readings over those of the described magnets that another unit would explain, and what a build may have at most.
_UNITS = ((1e3, 'mT'), (1e4, 'gauss'), (1e6, 'µT'), (1e9, 'nT'))
_ANOTHER = 2.0


class HeldReadings(NamedTuple):
    """Of one magnetometer in one pose: mean, (3,), T, and its expected error by their scatter, (3,), T."""

    mean: FloatArray
    deviation: FloatArray


def held_readings(fields: FloatArray, noise: float, where: str) -> HeldReadings:
    """Average readings of one magnetometer.

    Parameters
    ----------
    fields : (n, 3)
        T; NaN on axes that are not there.
    noise
        expected error of one, T.
    where
        for messages.

    Raises
    ------
    GeometryError
        they are too few, or the arm moves.
    """
    if len(fields) < FEWEST:
        raise GeometryError(f'{where}: {len(fields)} readings, expected at least {FEWEST}')
    scatter = np.std(fields, axis=0)
    steps = np.std(np.diff(fields, axis=0), axis=0) / np.sqrt(2.0)
    moving = scatter > _MOVING * np.maximum(steps, noise)
    if moving.any():
        worst = float(np.nanmax(np.where(moving, scatter, np.nan)))
        raise GeometryError(
            f'{where}: the readings scatter by {1e6 * worst:.3g} µT and change slowly, expected about '
            f'{1e6 * noise:.2g} µT, as of an arm that is held still'
        )
    return HeldReadings(fields.mean(axis=0), np.maximum(scatter, noise) / np.sqrt(len(fields)))


def refuse_unlike(predictor: MagneticReadings, readings: FloatArray, predicted: FloatArray) -> None:
    """Refuse readings that no build of what is described gives.

    Parameters
    ----------
    predictor
        of magnets and magnetometers as they are described.
    readings, predicted : (n, n_readings)
        T; not finite where nothing was measured.

    Raises
    ------
    GeometryError
        they are in another unit, of the other sign, of other magnets, or saturated.
    """
    there = np.isfinite(readings)
    u, expected = readings[there], predicted[there]
    largest = float(np.abs(u).max(initial=0.0))
    scale = float(u @ expected) / max(float(expected @ expected), 1e-30)
    for factor, unit in _UNITS:
        if factor / 3.0 < abs(scale) < factor * 3.0:
            raise GeometryError(
                f'readings up to {largest:.3g} T, {abs(scale):.3g} times what the magnets give: they seem to be in '
                f'{unit}, expected tesla'
            )
    if scale < 0.0:
        raise GeometryError(
            f'readings are {scale:.2f} times what the magnets give, expected about 1: poles or sensors are the other '
            'way round (magnets.remanences, magnetometers.mount_orientations)'
        )
    if not 1.0 / _ANOTHER < scale < _ANOTHER:
        raise GeometryError(
            f'readings are {scale:.2g} times what the magnets give, expected about 1: other magnets (diameters, not '
            'radii; m, T) or other places than described'
        )
    over = np.abs(readings) >= predictor.largest
    if over.any():
        names = dict.fromkeys(predictor.names[predictor.sensor_of[row]] for row in np.nonzero(over)[1])
        raise GeometryError(
            f'{", ".join(names)}: up to {1e3 * largest:.3g} mT, expected less than its range, '
            f'{1e3 * predictor.largest:.3g} mT'
        )
