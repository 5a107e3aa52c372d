"""How magnets and magnetometers really are, from readings of known shapes: the most probable, with its uncertainty."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sesa2.sensing.magnetic.magnetic_readings import MagneticReadings
from sesa2.shape.arm import GeometryError
from sesa2.shape.rotations import IDENTITY, FloatArray, conjugate, from_rotation_vector, multiply

_MOST_ITERATIONS = 15
_LAST_STEP = 1e-2  # standard deviations
# Steps of the differences: m, rad, of a strength.
_STEPS = {'position': 1e-5, 'tilt': 1e-4, 'strength': 1e-4, 'shift': 1e-5}


@dataclass(frozen=True)
class BuildErrors:
    """How well a build is known before anything is measured: standard deviations.

    Attributes
    ----------
    strength
        of a magnet's strength, in parts of it.
    shift
        of a magnet along the backbone, m.
    position
        of a sensor, along each axis, m.
    tilt
        of a sensor, about each of two axes across, rad.
    gain
        of a sensor's gain, in parts of it.
    offset
        of a reading without field, T.
    earth
        of each component of the earth's field, T; 0 where it is known.
    """

    strength: float = 0.03
    shift: float = 0.3e-3
    position: float = 0.3e-3
    tilt: float = 0.0175
    gain: float = 0.01
    offset: float = 2e-6
    earth: float = 50e-6


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
    before: BuildErrors = BuildErrors(),
    coordinate_errors: ArrayLike = 0.0,
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
        standard deviations of the coordinates, one for all or (n_coordinates,).

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
    bench = _Bench(predictor, before)
    theta = np.zeros(len(bench.names))
    # Reading errors: the noise, and what shapes that are not known exactly make of it.
    by_shape = predictor.predict(coordinates, base).jacobian * np.asarray(coordinate_errors, dtype=float)
    weight = there / np.sqrt(predictor.noise**2 + np.sum(by_shape**2, axis=-1))
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


class _Bench:
    """The parameters, and the readings that they make."""

    def __init__(self, predictor: MagneticReadings, before: BuildErrors):
        self.predictor = predictor
        self.n_magnets, self.n_sensors = len(predictor.magnets.magnets), len(predictor.names)
        self.rows = predictor.sensor_of
        n_rows, kinds = len(self.rows), []
        magnets = [f'magnet_{i + 1}' for i in range(self.n_magnets)]
        kinds += [(f'{m} strength', before.strength) for m in magnets]
        kinds += [(f'{m} shift', before.shift) for m in magnets]
        for axis in 'xyz':
            kinds += [(f'{name} position {axis}', before.position) for name in predictor.names]
        for axis in 'xy':
            kinds += [(f'{name} tilt {axis}', before.tilt) for name in predictor.names]
        kinds += [(f'{name} gain', before.gain) for name in predictor.names]
        kinds += [(f'{predictor.names[of]} offset {i}', before.offset) for i, of in enumerate(self.rows)]
        if before.earth > 0.0:
            kinds += [(f'earth_field {axis}', before.earth) for axis in 'xyz']
        self.names = tuple(name for name, _ in kinds)
        self.deviations = np.array([deviation for _, deviation in kinds])
        ends = np.cumsum([self.n_magnets] * 2 + [self.n_sensors] * 6 + [n_rows])
        (self.strength, self.shift, *places, self.gain, self.offset, self.earth) = (
            slice(a, b) for a, b in zip([0, *ends], [*ends, len(kinds)], strict=True)
        )
        self.places = places  # x y z, then two tilts

    def changed(self, theta: FloatArray) -> MagneticReadings:
        """The predictor with these changes."""
        p, m = self.predictor, self.predictor.magnetometers
        magnets = replace(
            p.magnets,
            magnets=tuple(
                replace(magnet, remanence=magnet.remanence * (1.0 + change))
                for magnet, change in zip(p.magnets.magnets, theta[self.strength], strict=True)
            ),
            positions=np.clip(p.magnets.positions + theta[self.shift], 0.0, p.limits.kinematics.arm.length),
        )
        x, y, z, tilt_x, tilt_y = (theta[of] for of in self.places)
        east, north = m.radii * np.cos(m.azimuths) + x, m.radii * np.sin(m.azimuths) + y
        radii, azimuths = np.hypot(east, north), np.arctan2(north, east)
        azimuths = np.where(radii > 0.0, azimuths, m.azimuths)
        tilts = from_rotation_vector(np.stack([tilt_x, tilt_y, 0.0 * tilt_x], axis=-1))
        whole = multiply(multiply(_about_z(m.azimuths), m.mountings), tilts)
        magnetometers = replace(
            m,
            radii=radii,
            azimuths=azimuths,
            axial_offsets=m.axial_offsets + z,
            mountings=multiply(conjugate(_about_z(azimuths)), whole),
            gains=m.gains * (1.0 + theta[self.gain]),
            offsets=m.offsets + theta[self.offset],
        )
        earth = p.earth_field.copy()
        if self.earth.start < self.earth.stop:
            earth += theta[self.earth]
        return MagneticReadings(p.limits, magnets, magnetometers, earth, order=p.order)

    def look(self, theta: FloatArray, q: FloatArray, base: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Readings, (n, n_readings), and their derivatives by all parameters.

        Each sensor's own parameters change its readings alone, so one difference serves all sensors.
        """
        here = self.changed(theta).predict(q, base).readings
        J = np.zeros((*here.shape, len(theta)))
        row = np.arange(len(self.rows))

        def difference(where: slice | int, step: float) -> FloatArray:
            there = []
            for sign in (1.0, -1.0):
                moved = theta.copy()
                moved[where] += sign * step
                there.append(self.changed(moved).predict(q, base).readings)
            return (there[0] - there[1]) / (2.0 * step)

        for kind, of in (('strength', self.strength), ('shift', self.shift)):
            for i in range(of.start, of.stop):
                J[..., i] = difference(i, _STEPS[kind])
        for k, of in enumerate(self.places):
            J[:, row, of.start + self.rows] = difference(of, _STEPS['position' if k < 3 else 'tilt'])
        offsets = self.predictor.magnetometers.offsets + theta[self.offset]
        J[:, row, self.gain.start + self.rows] = (here - offsets) / (1.0 + theta[self.gain][self.rows])
        J[:, row, self.offset.start + row] = 1.0
        for i in range(self.earth.start, self.earth.stop):
            J[..., i] = difference(i, 1e-6)
        return here, J


def _about_z(angles: FloatArray) -> FloatArray:
    turn = np.zeros((len(angles), 4))
    turn[:, 2], turn[:, 3] = np.sin(0.5 * angles), np.cos(0.5 * angles)
    return turn
