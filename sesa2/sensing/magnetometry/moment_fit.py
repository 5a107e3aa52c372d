"""The moments of a magnet that nobody knows, from readings of known shapes: linear least squares, nothing to train."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sesa2.sensing.magnetometry.axial_field import AxialField
from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings
from sesa2.sensing.magnetometry.ring_magnet import RingMagnet
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
    errors: ArrayLike | None = None,
    disturbed: ArrayLike | None = None,
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
    errors : (n, n_readings)
        standard deviations of the readings, T; None: the noise.
    disturbed : (n, n_readings, k)
        what one standard deviation of each of k other things that are not known does to the readings, T: these are
        fitted along, and the deviations are larger for it.

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
    weight = there / (predictor.noise if errors is None else np.where(there, errors, predictor.noise))
    scales = unit ** np.arange(3, 2 * n_orders + 2, 2) * 1e-3
    columns = np.stack([(of(c) - without) * weight for c in np.diag(scales)], axis=-1)[there]
    target = (np.where(there, readings, 0.0) - without)[there] * weight[there]
    n_target = len(target)
    if disturbed is not None:
        others = np.asarray(disturbed, dtype=float)[there] * weight[there][:, None]
        k = others.shape[1]
        columns = np.block([[columns, others], [np.zeros((k, n_orders)), np.eye(k)]])
        target = np.append(target, np.zeros(k))
    solution = np.linalg.lstsq(columns, target, rcond=None)[0]
    left = target - columns @ solution
    covariance = np.linalg.pinv(columns.T @ columns)[:n_orders, :n_orders]
    residual = float(np.sqrt(left @ left / max(1, n_target - n_orders)))
    return FittedMoments(scales * solution[:n_orders], scales * np.sqrt(np.diag(covariance)), residual)


def ring_of_moments(described: RingMagnet, moments: FloatArray) -> RingMagnet:
    """The ring that has these two moments, of orders 1 and 3; inner diameter and height are those described.

    Outside its sphere, any magnet that is symmetric about axis and middle is as good as a ring with its moments.

    Raises
    ------
    GeometryError
        no such ring has them.
    """
    wanted = float(moments[1] / moments[0])

    def ring(outer: float) -> RingMagnet:
        return replace(described, outer_diameter=outer, remanence=1.0)

    def ratio(outer: float) -> float:
        first, third = ring(outer).moments(3)
        return float(third / first)

    # The wider, the more it is a disc: the ratio falls.
    low = max(described.inner_diameter, 0.01 * described.height) * (1.0 + 1e-6)
    high = 20.0 * max(described.outer_diameter, described.height)
    if not ratio(high) < wanted < ratio(low):
        raise GeometryError(
            f'the moments of orders 1 and 3 are {moments[0]:.3g} T m³ and {moments[1]:.3g} T m⁵, which no ring has '
            f'that is {1e3 * described.height:g} mm high, {1e3 * described.inner_diameter:g} mm inside; expected '
            f'magnets.heights and inner_diameters as they are, and readings of other shapes'
        )
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if ratio(middle) > wanted else (low, middle)
    return replace(described, outer_diameter=high, remanence=float(moments[0] / ring(high).moments(1)[0]))
