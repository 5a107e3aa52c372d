"""How magnets and magnetometers really are, from readings of known shapes: the most probable, with its uncertainty."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sesa2.sensing.magnetometry.build_parameters import USUAL_BUILD, BuildErrors, BuildParameters
from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings
from sesa2.shape.arm import GeometryError
from sesa2.shape.rotations import IDENTITY, FloatArray

_MOST_ITERATIONS = 15
_LAST_STEP = 1e-2  # standard deviations


class MagnetCalibration(NamedTuple):
    """What a calibration found.

    Attributes
    ----------
    predictor
        of the magnets and magnetometers as they are.
    names
        of all parameters, as `magnet_1 strength`, `magnetometer_3 gain`.
    changes, deviations : (n_parameters,)
        by how much each differs from what was described, and how well that is known: parts, m, rad or T.
    told : (n_parameters,)
        how much better than before: 1 less the deviation over that before. Near 0: the readings do not tell it.
    residual
        root mean square of what is left, over what is expected; 1 where all is well.
    """

    predictor: MagneticReadings
    names: tuple[str, ...]
    changes: FloatArray
    deviations: FloatArray
    told: FloatArray
    residual: float


def calibrate_magnets(
    predictor: MagneticReadings,
    coordinates: ArrayLike,
    readings: ArrayLike,
    base: ArrayLike = IDENTITY,
    before: BuildErrors = USUAL_BUILD,
    coordinate_errors: ArrayLike = 0.0,
    reading_errors: ArrayLike | None = None,
) -> MagnetCalibration:
    """Fit strengths and shifts of magnets, positions, tilts, gains and offsets of sensors, and the earth's field.

    Gauss–Newton on the sum of squares of readings over their expected errors and of changes over their deviations
    before: these decide between what readings do not tell apart, such as all gains from all strengths.

    Parameters
    ----------
    predictor
        of magnets and magnetometers as they are described.
    coordinates : (n, n_coordinates)
        known shapes: straight, in a jig, or by motion capture; rad and m.
    readings : (n, n_readings)
        T; not finite where nothing was measured.
    base : (4,)
        or (n, 4), q_WB, x y z w.
    before
        how well the build is known.
    coordinate_errors
        standard deviations of the coordinates, one for all, (n_coordinates,) or (n, 1, n_coordinates).
    reading_errors : (n, n_readings)
        standard deviations of the readings, T; None: the noise of one.

    Raises
    ------
    GeometryError
        shapes and readings do not match, or there are none.
    """
    coordinates, readings = np.asarray(coordinates, dtype=float), np.asarray(readings, dtype=float)
    n_rows = len(predictor.noise)
    if readings.ndim != 2 or readings.shape[1] != n_rows or len(readings) != len(coordinates):
        raise GeometryError(
            f'readings of shape {readings.shape} for {len(coordinates)} shapes, expected ({len(coordinates)}, {n_rows})'
        )
    there = np.isfinite(readings)
    if not there.any():
        raise GeometryError('no reading is a number, expected some of known shapes')
    base = np.broadcast_to(np.asarray(base, dtype=float), (len(coordinates), 4))
    bench = BuildParameters(predictor, before)
    theta = np.zeros(len(bench.names))
    # Reading errors: the noise, and what shapes that are not known exactly make of it.
    by_shape = predictor.predict(coordinates, base).jacobian * np.asarray(coordinate_errors, dtype=float)
    expected = predictor.noise if reading_errors is None else np.where(there, reading_errors, predictor.noise)
    weight = there / np.sqrt(expected**2 + np.sum(by_shape**2, axis=-1))
    target = np.where(there, readings, 0.0)
    prior = 1.0 / bench.deviations**2
    for _ in range(_MOST_ITERATIONS):
        predicted, J = bench.look(theta, coordinates, base)
        residuals = (weight * (target - predicted)).ravel()
        J = (weight[..., None] * J).reshape(-1, len(theta))
        A = J.T @ J + np.diag(prior)
        step = np.linalg.solve(A, J.T @ residuals - prior * theta)
        theta = theta + step
        if (np.abs(step) < _LAST_STEP * bench.deviations).all() and np.sqrt(step @ A @ step) < len(
            theta
        ) * _LAST_STEP:
            break
    deviations = np.sqrt(np.diag(np.linalg.inv(A)))
    found = bench.changed(theta)
    left = (weight * (target - found.predict(coordinates, base).readings))[there]
    spare = max(1.0, len(left) - np.sum(1.0 - (deviations / bench.deviations) ** 2))
    return MagnetCalibration(
        found,
        bench.names,
        theta,
        deviations,
        1.0 - deviations / bench.deviations,
        float(np.sqrt(left @ left / spare)),
    )
