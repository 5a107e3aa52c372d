"""The moments of a magnet that nobody knows, from readings of known shapes: linear least squares, nothing to train."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sesa2.sensing.magnetic.axial_field import AxialField
from sesa2.sensing.magnetic.magnetic_readings import MagneticReadings
from sesa2.shape.arm import GeometryError
from sesa2.shape.rotations import IDENTITY, FloatArray


class FittedMoments(NamedTuple):
    """The moments of magnets of one kind.

    Attributes
    ----------
    moments : (n_orders,)
        of orders 1, 3, 5 …, T m^(n+2), as `RingMagnet.moments` gives them.
    deviations : (n_orders,)
        their standard deviations by the noise.
    residual
        root mean square of what is left over the noise; 1 where all is well.
    """

    moments: FloatArray
    deviations: FloatArray
    residual: float


def fit_moments(
    predictor: MagneticReadings,
    coordinates: ArrayLike,
    readings: ArrayLike,
    order: int = 3,
    base: ArrayLike = IDENTITY,
) -> FittedMoments:
    """Fit the moments that all magnets of an arm share: the field of any magnet symmetric about axis and middle.

    Parameters
    ----------
    predictor
        of an arm with such magnets; what it says of their sizes and strength is not used, their places are.
    coordinates : (n, n_coordinates)
        known shapes, rad and m.
    readings : (n, n_readings)
        T; not finite where nothing was measured.
    order
        the highest, odd.
    base : (4,)
        or (n, 4), q_WB, x y z w.

    Raises
    ------
    GeometryError
        there are fewer readings than moments, or shapes and readings do not match.
    """
    coordinates, readings = np.asarray(coordinates, dtype=float), np.asarray(readings, dtype=float)
    n_orders = (order + 1) // 2
    if readings.shape != (len(coordinates), len(predictor.noise)):
        raise GeometryError(
            f'readings of shape {readings.shape}, expected {(len(coordinates), len(predictor.noise))}'
        )
    there = np.isfinite(readings)
    if np.count_nonzero(there) < n_orders:
        raise GeometryError(
            f'{np.count_nonzero(there)} readings, expected at least {n_orders}, one for each moment'
        )
    n_magnets = len(predictor.magnets.magnets)
    spheres = np.array([magnet.sphere for magnet in predictor.magnets.magnets])
    unit = np.median(predictor.distances(coordinates))  # so that all columns are of one size

    def of(moments: FloatArray) -> FloatArray:
        field = AxialField(np.tile(moments, (n_magnets, 1)), spheres)
        return predictor.with_field(field).predict(coordinates, base).readings

    without = of(np.zeros(n_orders))
    weight = there / predictor.noise
    scales = unit ** np.arange(3, 2 * n_orders + 2, 2) * 1e-3
    columns = np.stack([(of(c) - without) * weight for c in np.diag(scales)], axis=-1)[there]
    target = (np.where(there, readings, 0.0) - without)[there] * weight[there]
    solution = np.linalg.lstsq(columns, target, rcond=None)[0]
    left = target - columns @ solution
    covariance = np.linalg.pinv(columns.T @ columns)
    residual = float(np.sqrt(left @ left / max(1, len(left) - n_orders)))
    return FittedMoments(scales * solution, scales * np.sqrt(np.diag(covariance)), residual)
