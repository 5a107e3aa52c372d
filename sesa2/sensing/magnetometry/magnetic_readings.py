"""What magnetometers in an arm read of its shape: the field of the magnets in it and that of the earth."""

from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sesa2.sensing.magnetometry.axial_field import AxialField
from sesa2.sensing.magnetometry.ring_magnet import RingMagnet
from sesa2.shape.arm import GeometryError
from sesa2.shape.kinematics.coordinate_limits import CoordinateLimits
from sesa2.shape.kinematics.segment_chain import SegmentChain
from sesa2.shape.reading_predictor import Prediction, ReadingPredictor
from sesa2.shape.rotations import IDENTITY, FloatArray, conjugate, cross, multiply, rotate, to_matrix

# Said where gains and offsets are those of a drawing.
UNCALIBRATED = (
    'magnets and magnetometers are uncalibrated (every gain is 1, every offset 0): built as carefully as a workshop '
    'does, three segments err by some 30 mm at the tip'
)
# Shapes by which the nearest distance in the workspace is found, and what is taken off for those that were not drawn.
_DRAWN = 2000
_MARGIN = 0.9


@dataclass(frozen=True, eq=False)
class MagnetPlaces:
    """Magnets on the backbone, their axes along it.

    Attributes
    ----------
    magnets
        what they are.
    positions : (n_magnets,)
        material arc lengths of their centres, m.
    """

    magnets: tuple[RingMagnet, ...]
    positions: FloatArray


@dataclass(frozen=True, eq=False)
class MagnetometerPlaces:
    """Magnetometers, each beside or on the backbone.

    Attributes
    ----------
    ids
        ids.
    positions : (n,)
        material arc lengths, m.
    radii, azimuths : (n,)
        distance from the backbone, m, and direction there about z from x, rad.
    axial_offsets : (n,)
        how far along the link's axis beyond their position, m: on something rigid, which does not stretch.
    mountings : (n, 4)
        the sensor in its link once that was turned about z by the azimuth, x y z w.
    axes : (n,)
        which of its own each measures along: 'z' or 'xyz'.
    gains : (n,)
        what it reads of 1 T, T.
    offsets : (n_readings,)
        what is read of no field, T; x, y, z of a sensor one after the other.
    noise
        expected error of a reading, T, one standard deviation.
    range
        reading at which it saturates, T.
    among_measured : (n,)
        place of each among all that are measured, of which some may not be used; None: these are all.
    """

    ids: tuple[int, ...]
    positions: FloatArray
    radii: FloatArray
    azimuths: FloatArray
    axial_offsets: FloatArray
    mountings: FloatArray
    axes: tuple[str, ...]
    gains: FloatArray
    offsets: FloatArray
    noise: float
    range: float
    among_measured: np.ndarray | None = None

    def __post_init__(self) -> None:
        for axes in self.axes:
            if axes not in ('z', 'xyz'):
                raise GeometryError(f'axes of a magnetometer = {axes!r}, expected z or xyz')


class MagneticReadings(ReadingPredictor):
    """Readings of magnetometers, with the derivatives, from one pass over the kinematics.

    A reading is gain · o · (Σ B_magnet + B_earth) + offset, o the axis that it measures along. Its change with the
    shape is the work of forces and torques on the cross-sections: with v = Σ (∂B/∂r) o and
    t = (∂B/∂a)ᵀ o, v and lever × v + o × B act on the sensor's, −v and a × t on the magnet's.

    Parameters
    ----------
    limits
        of the shapes; the order of the series follows from the nearest that a magnet and a sensor come within them.
    magnets
        at least one.
    magnetometers
        at least one.
    earth_field : (3,)
        in W, T.
    order
        of the series of moments; None: as the nearest distance within the limits asks.

    Attributes
    ----------
    order
        of the series of moments.
    """

    def __init__(
        self,
        limits: CoordinateLimits,
        magnets: MagnetPlaces,
        magnetometers: MagnetometerPlaces,
        earth_field: ArrayLike = (0.0, 0.0, 0.0),
        order: int | None = None,
    ):
        if not magnets.magnets or not magnetometers.ids:
            raise GeometryError(
                f'{len(magnets.magnets)} magnets and {len(magnetometers.ids)} magnetometers, expected at least one each'
            )
        self.limits = limits
        self.magnets, self.magnetometers = magnets, magnetometers
        self.earth_field = np.array(earth_field, dtype=float)
        self.names = tuple(f'magnetometer_{i}' for i in magnetometers.ids)
        self.sensor_of = np.repeat(np.arange(len(self.names)), [len(axes) for axes in magnetometers.axes])
        self.noise = np.full(len(self.sensor_of), magnetometers.noise)
        self.largest = magnetometers.range
        # Sensors and magnets at one arc length share one evaluation of the kinematics.
        both = np.round(np.concatenate([magnets.positions, magnetometers.positions]), 12)
        self._places, places = np.unique(both, return_inverse=True)
        self._of_magnet, self._of_sensor = np.split(places.ravel(), [len(magnets.magnets)])
        # Where some measure along three axes, all are predicted so; then what is not measured is dropped.
        self._only_z = set(magnetometers.axes) == {'z'}
        measured = np.array([[axes == 'xyz', axes == 'xyz', True] for axes in magnetometers.axes])
        self._measured = np.flatnonzero(measured) if not (self._only_z or measured.all()) else None
        self._in_link = self._sensors_in_link()
        self._gains = magnetometers.gains[self.sensor_of]
        self._offsets = np.asarray(magnetometers.offsets, dtype=float)
        if not self._offsets.any() and (magnetometers.gains == 1.0).all():
            self.doubts = (UNCALIBRATED,)
        self.order = self._order() if order is None else order
        self._field = AxialField(
            np.array([magnet.moments(self.order) for magnet in magnets.magnets]),
            np.array([magnet.sphere for magnet in magnets.magnets]),
        )

    def predict(self, coordinates: FloatArray, base: ArrayLike = IDENTITY) -> Prediction:
        """See ReadingPredictor."""
        p, R, backbone = self._poses(coordinates)
        at_sensor, r, a = self._vectors(p, R)
        lever, o = at_sensor[..., 0, :], at_sensor[..., 1:, :]
        F, H, g, k, l = self._field.factors(r, a)  # noqa: E741
        field = np.einsum('...sm,...smi->...si', F, r) - H @ a[..., 0, :, :]
        field += rotate(conjugate(base), self.earth_field)[..., None, :] if self.earth_field.any() else 0.0
        readings = (o @ field[..., None])[..., 0]
        # Per sensor, axis and magnet; then vectors on a further axis.
        along_r = o @ np.swapaxes(r, -1, -2)
        along_a = o @ np.swapaxes(a[..., 0, :, :], -1, -2)[..., None, :, :]
        turning = k[..., None, :] * along_r - l[..., None, :] * along_a
        pushing = g[..., None, :] * along_r + k[..., None, :] * along_a
        r, a, o_m = r[..., None, :, :], a[..., None, :, :], o[..., None, :]
        turning_r = turning[..., None] * r
        on_magnets = np.empty((*turning.shape, 6))
        force = F[..., None, :, None] * o_m + pushing[..., None] * r + turning[..., None] * a
        np.negative(force, out=on_magnets[..., :3])
        on_magnets[..., 3:] = cross(a, turning_r - H[..., None, :, None] * o_m)
        on_sensors = np.empty((*o.shape[:-1], 6))
        total = force.sum(axis=-2)
        on_sensors[..., :3] = total
        on_sensors[..., 3:] = cross(lever[..., None, :], total) + cross(o, field[..., None, :])
        rates = backbone.jacobian(self._places)
        jacobian = on_sensors @ rates.take(self._of_sensor, axis=-3)
        batch = jacobian.shape[:-3]
        n_rows, n_coordinates = o.shape[-3] * o.shape[-2], jacobian.shape[-1]
        at_magnets = rates.take(self._of_magnet, axis=-3).reshape(*batch, -1, n_coordinates)
        jacobian = jacobian.reshape(*batch, n_rows, n_coordinates)
        jacobian += on_magnets.reshape(*batch, n_rows, -1) @ at_magnets
        readings = readings.reshape(*batch, n_rows)
        if self._measured is not None:
            readings = readings.take(self._measured, axis=-1)
            jacobian = jacobian.take(self._measured, axis=-2)
        return Prediction(self._gains * readings + self._offsets, self._gains[:, None] * jacobian)

    def readings_of(self, measured: ArrayLike) -> FloatArray:
        """See ReadingPredictor; measured in T."""
        measured = np.asarray(measured, dtype=float)
        if self.magnetometers.among_measured is not None:
            measured = measured.take(self.magnetometers.among_measured, axis=-2)
        columns = measured[..., 2:] if self._only_z else measured
        rows = columns.reshape(*measured.shape[:-2], -1)
        return rows if self._measured is None else rows.take(self._measured, axis=-1)

    def with_field(self, field: AxialField) -> 'MagneticReadings':
        """The same with other fields of the magnets, whatever makes them."""
        other = copy(self)
        other._field = field
        return other

    def distances(self, coordinates: FloatArray) -> FloatArray:
        """Between each sensor and the centre of each magnet, batch + (n_sensors, n_magnets), m."""
        p, R, _ = self._poses(coordinates)
        _, r, _ = self._vectors(p, R)
        return np.sqrt(np.einsum('...i,...i->...', r, r))

    def _poses(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray, SegmentChain[Any]]:
        backbone = self.limits.kinematics.backbone(coordinates)
        positions = backbone.positions(self._places)
        return positions, backbone.matrices(self._places), backbone

    def _vectors(self, p: FloatArray, R: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Lever and axes of the sensors, (..., s, 1 + n_axes, 3); r, (..., s, m, 3), and a, (..., 1, m, 3)."""
        at_sensor = self._in_link @ np.swapaxes(R.take(self._of_sensor, axis=-3), -1, -2)
        there = p.take(self._of_sensor, axis=-2) + at_sensor[..., 0, :]
        r = there[..., :, None, :] - p.take(self._of_magnet, axis=-2)[..., None, :, :]
        return at_sensor, r, R[..., 2].take(self._of_magnet, axis=-2)[..., None, :, :]

    def _sensors_in_link(self) -> FloatArray:
        """Lever and axes of each sensor in its cross-section's frame, (n, 1 + n_axes, 3)."""
        m = self.magnetometers
        turn = np.zeros((len(m.ids), 4))
        turn[:, 2], turn[:, 3] = np.sin(0.5 * m.azimuths), np.cos(0.5 * m.azimuths)
        axes = np.swapaxes(to_matrix(multiply(turn, m.mountings)), -1, -2)
        lever = np.zeros((len(m.ids), 1, 3))
        lever[:, 0, 0], lever[:, 0, 1] = m.radii * np.cos(m.azimuths), m.radii * np.sin(m.azimuths)
        lever[:, 0, 2] = m.axial_offsets
        return np.concatenate([lever, axes[:, 2:] if self._only_z else axes], axis=1)

    def nearest(self) -> FloatArray:
        """The nearest that sensors and magnets come within the limits, of drawn shapes, (n_sensors, n_magnets), m."""
        shapes = self.limits.draw(_DRAWN, np.random.default_rng(0))
        return self.distances(shapes).min(axis=0)

    def _order(self) -> int:
        nearest = _MARGIN * self.nearest().min(axis=0)
        magnets = self.magnets.magnets
        return max(magnet.order_beyond(float(d)) for magnet, d in zip(magnets, nearest, strict=True))
