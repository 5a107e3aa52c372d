"""What of magnets and magnetometers can differ from what is described, and what that does to the readings."""

from dataclasses import dataclass, replace

import numpy as np

from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings
from sesa2.shape.rotations import FloatArray, conjugate, from_rotation_vector, multiply

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


USUAL_BUILD = BuildErrors()


class BuildParameters:
    """What a build can have otherwise than described, and the readings that it makes then.

    Parameters
    ----------
    predictor
        of magnets and magnetometers as they are described.
    before
        how well the build is known.

    Attributes
    ----------
    names
        of all parameters, as `magnet_1 strength`, `magnetometer_3 gain`.
    deviations : (n_parameters,)
        how well each is known: parts, m, rad or T.
    kinds
        for each kind of error, a name of a field of BuildErrors, its parameters.
    """

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
        self.kinds = {
            'strength': self.strength,
            'shift': self.shift,
            'position': slice(places[0].start, places[2].stop),
            'tilt': slice(places[3].start, places[4].stop),
            'gain': self.gain,
            'offset': self.offset,
            'earth': self.earth,
        }

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
