"""The magnets in an arm and the magnetometers around them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings, MagnetometerPlaces, MagnetPlaces
from sesa2.sensing.magnetometry.ring_magnet import RingMagnet
from sesa2.shape.arm import GeometryError
from sesa2.shape.kinematics.coordinate_limits import CoordinateLimits
from sesa2.shape.options import parameter
from sesa2.shape.rotations import FloatArray, normalize

Floats = tuple[float, ...]


@dataclass(frozen=True)
class MagnetSection:
    """Ring or disc magnets on the backbone, magnetised along it; lists have one entry per magnet, or one for all."""

    segments: tuple[int, ...] = parameter((), 'segment that each magnet sits in, 1 the first', low=1)
    positions: Floats = parameter(
        (), "of its centre along the segment's backbone from the segment's base, m, one each", low=0.0
    )
    inner_diameters: Floats = parameter((0.0,), 'inner diameter, m; 0: a disc', low=0.0)
    outer_diameters: Floats = parameter((), 'outer diameter, m', above=0.0)
    heights: Floats = parameter((), 'size along the backbone, m', above=0.0)
    remanences: Floats = parameter(
        (), 'polarisation, T; negative: north pole towards the base', low=-2.0, high=2.0
    )

    def places(self, segment_ends: FloatArray) -> MagnetPlaces:
        """The magnets, for segments that end there, (n_segments + 1,), m, the clamp first."""
        n = len(self.segments)
        sizes = [
            _each(of, n) for of in (self.inner_diameters, self.outer_diameters, self.heights, self.remanences)
        ]
        return MagnetPlaces(
            tuple(RingMagnet(*of) for of in zip(*sizes, strict=True)),
            segment_ends[np.array(self.segments, dtype=int) - 1] + np.array(self.positions),
        )

    def calibrated(self, found: MagneticReadings, segment_ends: FloatArray) -> 'MagnetSection':
        """The same as a predictor has them.

        Raises
        ------
        GeometryError
            a magnet would be outside its segment.
        """
        starts = segment_ends[np.array(self.segments, dtype=int) - 1]
        positions = found.magnets.positions - starts
        lengths = segment_ends[np.array(self.segments, dtype=int)] - starts
        outside = np.flatnonzero((positions < 0.0) | (positions > lengths))
        if len(outside):
            i = outside[0]
            raise GeometryError(
                f'magnet {i + 1} was found {1e3 * positions[i]:.2f} mm from the base of segment {self.segments[i]}, '
                f'expected 0 to {1e3 * lengths[i]:.2f} mm'
            )
        magnets = found.magnets.magnets
        return replace(
            self,
            positions=_rounded(positions),
            inner_diameters=_rounded([magnet.inner_diameter for magnet in magnets]),
            outer_diameters=_rounded([magnet.outer_diameter for magnet in magnets]),
            heights=_rounded([magnet.height for magnet in magnets]),
            remanences=_rounded([magnet.remanence for magnet in magnets]),
        )


@dataclass(frozen=True)
class MagnetometerSection:
    """The magnetometers; every list has one entry per id, or, but for ids, segments and positions, one for all."""

    ids: tuple[int, ...] = parameter((), 'id of each magnetometer, as in magnetometer_<id>/field', low=1)
    segments: tuple[int, ...] = parameter((), 'segment that each sits in, 1 the first', low=1)
    positions: Floats = parameter((), "along the segment's backbone from the segment's base, m", low=0.0)
    radii: Floats = parameter((0.0,), 'distance from the backbone, m', low=0.0)
    azimuths: Floats = parameter((0.0,), 'direction there about z from x, rad')
    axial_offsets: Floats = parameter(
        (0.0,), "how far along the link's axis beyond its position, m; not stretched"
    )
    mount_orientations: Floats = parameter(
        (0.0, 0.0, 0.0, 1.0),
        'the sensor in its link turned about z by its azimuth: x y z w, one for all or each',
    )
    axes: tuple[str, ...] = parameter(('xyz',), 'which of its own it measures along', choices=('z', 'xyz'))
    gains: Floats = parameter((1.0,), 'reading over field', above=0.0)
    offsets: Floats = parameter((0.0,), 'reading without field, T; one for all, per id, or per id and axis')
    masked: tuple[int, ...] = parameter((), 'ids of those that are not used', low=1)
    range: float = parameter(2.0e-3, 'reading at which a sensor saturates, T', above=0.0)
    noise: float = parameter(7.0e-7, 'expected error of a reading, one standard deviation, T', above=0.0)
    earth_field: Floats = parameter((0.0, 0.0, 0.0), "the earth's field in W, T", low=-1e-3, high=1e-3)

    def calibrated(self, found: MagneticReadings) -> 'MagnetometerSection':
        """The same as a predictor of those that are used has them."""
        n, m = len(self.ids), found.magnetometers
        used = [self.ids.index(i) for i in m.ids]
        axes = _each(self.axes, n)
        offsets = np.array(self.offsets)
        if len(offsets) == n:
            offsets = np.repeat(offsets, [len(of) for of in axes])
        offsets = np.array(np.broadcast_to(offsets, self.n_readings))
        offsets[np.repeat(np.isin(np.arange(n), used), [len(of) for of in axes])] = m.offsets
        mountings = np.array(np.broadcast_to(np.reshape(self.mount_orientations, (-1, 4)), (n, 4)))
        mountings[used] = m.mountings
        values: dict[str, Any] = {}
        for name in ('radii', 'azimuths', 'axial_offsets', 'gains'):
            of = np.array(_each(getattr(self, name), n), dtype=float)
            of[used] = getattr(m, name)
            values[name] = _rounded(of)
        return replace(
            self,
            **values,
            offsets=_rounded(offsets),
            mount_orientations=_rounded(mountings.ravel()),
            earth_field=_rounded(found.earth_field),
        )

    @property
    def n_readings(self) -> int:
        """Axes of all of them."""
        return sum(len(axes) for axes in _each(self.axes, len(self.ids)))

    def places(self, segment_ends: FloatArray) -> MagnetometerPlaces:
        """Those that are used, for segments that end there, (n_segments + 1,), m, the clamp first."""
        n = len(self.ids)
        axes = _each(self.axes, n)
        offsets = np.array(self.offsets)
        if len(offsets) == n:
            offsets = np.repeat(offsets, [len(of) for of in axes])
        mountings = np.reshape(self.mount_orientations, (-1, 4))
        used = np.array([i for i, of in enumerate(self.ids) if of not in self.masked], dtype=int)
        row_used = np.repeat(np.isin(np.arange(n), used), [len(of) for of in axes])
        starts = segment_ends[np.array(self.segments, dtype=int) - 1]
        return MagnetometerPlaces(
            ids=tuple(self.ids[i] for i in used),
            positions=(starts + np.array(self.positions))[used],
            radii=np.array(_each(self.radii, n))[used],
            azimuths=np.array(_each(self.azimuths, n))[used],
            axial_offsets=np.array(_each(self.axial_offsets, n))[used],
            mountings=normalize(np.broadcast_to(mountings, (n, 4)))[used],
            axes=tuple(axes[i] for i in used),
            gains=np.array(_each(self.gains, n))[used],
            offsets=np.broadcast_to(offsets, self.n_readings)[row_used],
            noise=self.noise,
            range=self.range,
            among_measured=used,
        )


@dataclass(frozen=True)
class FieldSourceSection:
    """The arm that the source `sim` plays to magnetometers."""

    rate: float = parameter(50.0, 'sweeps per second', above=0.0, high=1000.0)
    build_errors: float = parameter(
        1.0,
        'how far it is built from what is configured, in parts of what a careful workshop leaves',
        low=0.0,
    )
    seed: int = parameter(0, 'of these errors and of the noise', low=0)


def magnetic_readings(
    magnets: MagnetSection, magnetometers: MagnetometerSection, segment_ends: FloatArray
) -> Callable[[CoordinateLimits], MagneticReadings] | None:
    """What makes the predictor of the magnetometers' readings for a family of shapes; None where there are none."""
    if not magnetometers.ids:
        return None
    return partial(
        MagneticReadings,
        magnets=magnets.places(segment_ends),
        magnetometers=magnetometers.places(segment_ends),
        earth_field=magnetometers.earth_field,
    )


def _each(values: tuple[Any, ...], n: int) -> tuple[Any, ...]:
    return values * n if len(values) == 1 else values


def _rounded(values: ArrayLike) -> Floats:
    return tuple(np.round(np.asarray(values, dtype=float), 12).tolist())
