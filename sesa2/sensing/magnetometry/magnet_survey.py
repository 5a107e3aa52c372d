"""What magnets and magnetometers can tell of an arm, before it is built: over all shapes that it can have."""

from typing import NamedTuple

import numpy as np

from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings
from sesa2.shape.observability import UNTOLD, UntoldDirection, untold_directions
from sesa2.shape.rotations import FloatArray

# Shapes that are drawn, and of these the part that must not be untold for a sensor to be spared.
_SHAPES = 500
_FEW = 0.05
# A magnet is heard where its field on the straight arm is so many times the noise.
_HEARD = 10.0


class MagnetSurvey(NamedTuple):
    """Of an arm's magnets and magnetometers.

    Attributes
    ----------
    nearest : (n_sensors, n_magnets)
        the nearest that each sensor comes to each magnet's centre, m.
    trusted : (n_magnets,)
        the nearest at which the magnet's field is known, m.
    largest : (n_readings,)
        largest magnitude of each reading, T.
    swing : (n_readings,)
        from its least to its largest value, T.
    series_error
        the most that the series of moments leaves out at a sensor, T.
    deviations : (n_coordinates,)
        expected error of each coordinate by the noise, median of all shapes, rad and m; untold ones are at the prior.
    untold
        what readings do not tell of the shape that is in the middle in this.
    untold_share
        part of the shapes in which there is something that they do not tell.
    spare
        readings less coordinates.
    needed
        names of the sensors without which something more is untold.
    unseen
        stretches of the arm that no magnet and sensor have between them, (from, to), m: how the arm bends there is
        taken from the rest of the segment.
    """

    nearest: FloatArray
    trusted: FloatArray
    largest: FloatArray
    swing: FloatArray
    series_error: float
    deviations: FloatArray
    untold: list[UntoldDirection]
    untold_share: float
    spare: int
    needed: tuple[str, ...]
    unseen: list[tuple[float, float]]

    @property
    def too_near(self) -> list[tuple[int, int]]:
        """Sensor and magnet, counted from 0, that come nearer than the magnet's field is known."""
        return [(int(i), int(k)) for i, k in np.argwhere(self.nearest < self.trusted)]


def survey_magnets(predictor: MagneticReadings) -> MagnetSurvey:
    """Look at drawn shapes; the same ones at every call."""
    shapes = predictor.limits.draw(_SHAPES, np.random.default_rng(0))
    readings, J = predictor.predict(shapes)
    scaled = J * predictor.limits.scales / predictor.noise[:, None]
    whole = _information(scaled)
    names = predictor.limits.kinematics.coordinate_names
    variances = np.diagonal(np.linalg.inv(whole), axis1=-2, axis2=-1)
    least = np.linalg.eigvalsh(whole)[:, 0]
    usual = int(np.argsort(least)[len(least) // 2])
    share = _untold_share(whole)
    needed = tuple(
        name
        for i, name in enumerate(predictor.names)
        if _untold_share(_information(scaled[:, predictor.sensor_of != i])) > share + _FEW
    )
    nearest = predictor.nearest()
    return MagnetSurvey(
        nearest=nearest,
        trusted=np.array([magnet.nearest for magnet in predictor.magnets.magnets]),
        largest=np.abs(readings).max(axis=0),
        swing=np.ptp(readings, axis=0),
        series_error=_series_error(predictor, nearest),
        deviations=np.median(np.sqrt(variances), axis=0) * predictor.limits.scales,
        untold=untold_directions(whole[usual], names),
        untold_share=share,
        spare=len(predictor.noise) - len(names),
        needed=needed,
        unseen=_unseen(predictor),
    )


def _information(scaled: FloatArray) -> FloatArray:
    """Of readings whose derivatives, over their noise and by scaled coordinates, these are; with the prior's."""
    return np.swapaxes(scaled, -1, -2) @ scaled + np.eye(scaled.shape[-1])


def _untold_share(information: FloatArray) -> float:
    return float(np.mean(np.linalg.eigvalsh(information)[:, 0] < UNTOLD**-2))


def _series_error(predictor: MagneticReadings, nearest: FloatArray) -> float:
    worst = 0.0
    for magnet, distance in zip(predictor.magnets.magnets, nearest.min(axis=0), strict=True):
        distance = max(float(distance), magnet.sphere)
        field = 2.0 * abs(magnet.moments(1)[0]) / distance**3
        worst = max(worst, field * magnet.left_out(predictor.order, distance))
    return worst


def _unseen(predictor: MagneticReadings) -> list[tuple[float, float]]:
    """What is left of the arm without all that lies between a sensor and a magnet that it hears."""
    magnets, sensors = predictor.magnets, predictor.magnetometers
    distances = predictor.distances(predictor.limits.kinematics.rest)
    dipoles = np.array([abs(magnet.moments(1)[0]) for magnet in magnets.magnets])
    heard = dipoles / distances**3 > _HEARD * sensors.noise
    spans = [
        sorted((float(sensors.positions[i]), float(magnets.positions[k]))) for i, k in np.argwhere(heard)
    ]
    left, at = [], 0.0
    for begin, end in sorted(spans):
        if begin > at + 1e-9:
            left.append((at, begin))
        at = max(at, end)
    length = predictor.limits.kinematics.arm.length
    return [*left, (at, length)] if length > at + 1e-9 else left
