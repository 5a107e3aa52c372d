"""An arm with magnets that moves, and what its magnetometers read: built not quite as drawn, noisy, in steps."""

from dataclasses import replace

import numpy as np

from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings
from sesa2.shape.kinematics.coordinate_limits import CoordinateLimits
from sesa2.shape.models.magnetic import Magnetic
from sesa2.shape.rotations import FloatArray, from_rotation_vector, multiply

# One turn of the motion, s: a figure of eight of each segment, the next a third of it behind.
PERIOD = 10.0
_BEND_MAX = np.pi / 4
# Half of what a careful workshop leaves, each evenly distributed: strength and gain, parts; places, m; tilts, rad; T.
_STRENGTH, _GAIN, _PLACE, _TILT, _OFFSET = 0.03, 0.01, 0.3e-3, np.deg2rad(1.0), 2e-6
_BITS = 16


class MagneticArm:
    """Moves by itself.

    Parameters
    ----------
    configuration
        as it was drawn.
    build_errors
        in parts of what a careful workshop leaves: 3 % of the magnets' strengths, 0.3 mm of places, 1° of tilts, 1 % of
        gains and 2 µT of offsets.
    seed
        of the errors and of the noise.

    Attributes
    ----------
    model
        whose coordinates it has.

    Raises
    ------
    Sesa2Error
        no model of the configuration needs magnetometers.
    """

    def __init__(self, configuration: Configuration, build_errors: float = 1.0, seed: int = 0):
        names = configuration.models_of('fields')
        model = configuration.create_model(names[0]) if names else None
        if not isinstance(model, Magnetic) or not isinstance(model.predictor, MagneticReadings):
            raise Sesa2Error(f'models: got {list(configuration.models)}, expected magnetic to be simulated')
        self.model, self._c = model, configuration
        self._random = np.random.default_rng(seed)
        self._predictor = self._built(model.predictor, build_errors)

    def coordinates(self, times: FloatArray) -> FloatArray:
        """Coordinates at times (n,), s, of the model's kinematics: (n, n_coordinates), rad and m."""
        kinematics, segments = self.model.kinematics, self._c.segments
        amplitude = min(_BEND_MAX, 0.5 * segments.bend_max)
        least, most = segments.stretch
        turn = 2.0 * np.pi * np.asarray(times, dtype=float) / PERIOD
        columns = []
        for k, length in enumerate(kinematics.segment_lengths):
            phase = turn + 2.0 * np.pi * k / len(kinematics.segment_lengths)
            for name in kinematics.segment_coordinates:
                if name == 'length':
                    middle, half = 0.5 * (least + most), 0.25 * (most - least)
                    columns.append(length * (middle + half * np.sin(phase)))
                else:
                    rising = 0.5 if name.endswith('1') else 1.0
                    columns.append(rising * amplitude * np.sin(phase if '_y' in name else 2.0 * phase))
        return np.stack(columns, axis=-1)

    def fields(self, coordinates: FloatArray) -> FloatArray:
        """What the magnetometers say at coordinates, (n_magnetometers, 3), T; NaN on axes that are not there."""
        p = self._predictor
        readings = p.predict(coordinates, self._c.base).readings
        readings = readings + p.noise * self._random.standard_normal(len(readings))
        step = 2.0 * p.largest / 2**_BITS
        readings = np.clip(np.round(readings / step) * step, -p.largest, p.largest)
        out = np.full((len(self._c.magnetometers.ids), 3), np.nan)
        places, begin = p.magnetometers, 0
        assert places.among_measured is not None
        for index, axes in zip(places.among_measured, places.axes, strict=True):
            out[index, 3 - len(axes) :] = readings[begin : begin + len(axes)]
            begin += len(axes)
        return out

    def _built(self, drawn: MagneticReadings, scale: float) -> MagneticReadings:
        magnets, sensors = drawn.magnets, drawn.magnetometers

        def off(size: float, *shape: int) -> FloatArray:
            return scale * size * self._random.uniform(-1.0, 1.0, shape)

        n, m = len(sensors.ids), len(magnets.magnets)
        strengths = 1.0 + off(_STRENGTH, m)
        rings = tuple(
            replace(magnet, remanence=magnet.remanence * float(strength))
            for magnet, strength in zip(magnets.magnets, strengths, strict=True)
        )
        tilts = np.zeros((n, 3))
        tilts[:, :2] = off(_TILT, n, 2)
        sideways = off(_PLACE, n) / np.maximum(sensors.radii, _PLACE)
        return MagneticReadings(
            CoordinateLimits(self.model.kinematics, self._c.segments.bend_max, self._c.segments.stretch),
            replace(magnets, magnets=rings, positions=magnets.positions + off(_PLACE, m)),
            replace(
                sensors,
                radii=np.maximum(sensors.radii + off(_PLACE, n), 0.0),
                azimuths=sensors.azimuths + sideways,
                axial_offsets=sensors.axial_offsets + off(_PLACE, n),
                mountings=multiply(sensors.mountings, from_rotation_vector(tilts)),
                gains=sensors.gains * (1.0 + off(_GAIN, n)),
                offsets=sensors.offsets + off(_OFFSET, len(sensors.offsets)),
            ),
            self._c.magnetometers.earth_field,
        )
