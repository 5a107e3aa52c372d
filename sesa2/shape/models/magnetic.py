"""The shape that explains best what magnetometers in the arm read (Baaij et al.): no learning, least squares."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.arm import GeometryError
from sesa2.shape.backbone import Backbone
from sesa2.shape.coordinate_filter import MOTIONS, CoordinateFilter
from sesa2.shape.coordinate_fit import CoordinateFit
from sesa2.shape.curve import CurveModel
from sesa2.shape.kinematics import KINEMATICS, create_kinematics
from sesa2.shape.kinematics.coordinate_limits import CoordinateLimits
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.observability import UntoldDirection, untold_directions
from sesa2.shape.options import LinkOptions, parameter
from sesa2.shape.reading_faults import ReadingFault, own_faults
from sesa2.shape.rotations import FloatArray, multiply, rotate


@dataclass(frozen=True)
class MagneticOptions(LinkOptions):
    """Options of the model `magnetic`.

    Attributes
    ----------
    kinematics
        family of shapes.
    filter
        none: each instant for itself. Else what an instant is expected to be follows from those before it; that
        also tells which sensor jumped.
    agility
        see CoordinateFilter.
    """

    kinematics: str = parameter('pcc', 'family of shapes', choices=KINEMATICS)
    filter: str = parameter(
        'none', 'each instant for itself, or filtered over time by one of these', choices=('none', *MOTIONS)
    )
    agility: float = parameter(
        5.0,
        'how abruptly the arm moves, for the filter: accelerations (random_walk: speeds), in parts of bend_max and of '
        'the stretch, per s² (s)',
        above=0.0,
    )


class MagneticBackbone(Backbone):
    """The shape of coordinates, turned with the base.

    Attributes
    ----------
    coordinates : batch + (n_coordinates,)
        rad and m, in the order of the kinematics' `coordinate_names`; NaN where there is no answer.
    covariance : batch + (n_coordinates, n_coordinates)
        of them.
    faults : batch + (n_sensors,)
        of ReadingFault.
    information : batch + (n_coordinates, n_coordinates)
        what each instant's readings tell, see `untold_directions`.
    doubtful : batch
        whether readings contradict each other, and no choice of few sensors explains it.
    """

    def __init__(
        self,
        model: 'Magnetic',
        base: FloatArray,
        coordinates: FloatArray,
        covariance: FloatArray,
        faults: np.ndarray,
        information: FloatArray,
        doubtful: np.ndarray,
    ):
        self._model, self._base = model, base[..., None, :]
        self.coordinates, self.covariance = coordinates, covariance
        self.faults, self.information, self.doubtful = faults, information, doubtful
        self._chain = model.kinematics.backbone(coordinates)
        lost = np.isnan(coordinates).any(axis=-1)
        self.lost = lost if lost.any() else None
        self.lengths = coordinates[..., model.length_columns]

    def positions(self, s: ArrayLike) -> FloatArray:
        """See Backbone."""
        return rotate(self._base, self._chain.positions(s))

    def orientations(self, s: ArrayLike) -> FloatArray:
        """See Backbone."""
        return multiply(self._base, self._chain.orientations(s))

    def untold(self, instant: int = -1) -> list[UntoldDirection]:
        """What the readings of one instant of a batch, by default the last, did not tell."""
        n = self.information.shape[-1]
        return untold_directions(
            self.information.reshape(-1, n, n)[instant], self._model.kinematics.coordinate_names
        )


class Magnetic(CurveModel[None]):
    """Coordinates from magnetometers. It remembers the last shape: that is where the next search begins.

    With a filter it wants all instants in their order, with their times.
    """

    name = 'magnetic'
    needs: tuple[str, ...] = ('fields',)
    finds_lengths = True
    Options = MagneticOptions

    def __init__(self, layout: Layout, options: MagneticOptions):
        if layout.readings is None or not layout.segment_lengths:
            raise GeometryError(
                f"model 'magnetic': {layout.n_magnetometers} magnetometers and {len(layout.segment_lengths)} segments, "
                'expected at least one of each, and magnets'
            )
        super().__init__(layout, options)
        inner = layout.segment_ends[1:-1]
        ends = self.link_ends
        apart = np.abs(inner[:, None] - ends).min(axis=-1, initial=np.inf) > 1e-6
        self._set_link_ends(np.sort(np.append(ends, inner[apart])))  # each link stretches with one segment
        self.kinematics = create_kinematics(options.kinematics, layout.segment_lengths)
        self.coordinate_names = self.kinematics.coordinate_names
        limits = CoordinateLimits(self.kinematics, layout.bend_max, layout.stretch_limits)
        self.predictor = layout.readings(limits)
        self.doubts = self.predictor.doubts
        names = self.kinematics.segment_coordinates
        self.length_columns = slice(names.index('length'), None, len(names))
        self._fitting = CoordinateFit(self.predictor)
        self._filter: CoordinateFilter | None = None
        if options.filter != 'none':
            self._filter = CoordinateFilter(self.predictor, options.filter, options.agility)
            self.needs = (*self.needs, 'times')
        self._last: FloatArray | None = None

    def _fit(self, measured: Measured) -> MagneticBackbone:
        assert measured.fields is not None
        readings = self.predictor.readings_of(measured.fields)
        batch = readings.shape[:-1]
        base = np.broadcast_to(np.asarray(measured.base, dtype=float), (*batch, 4))
        return self._filtered(measured, readings, base) if self._filter else self._alone(readings, base)

    def _alone(self, readings: FloatArray, base: FloatArray) -> MagneticBackbone:
        p = self.predictor
        faults = own_faults(readings, p.sensor_of, len(p.names), p.largest)
        bad = (faults != ReadingFault.NONE).take(p.sensor_of, axis=-1)
        readings = np.where(bad, np.nan, readings)
        fitted = self._fitting.fit(readings, self._last, base)
        coordinates = fitted.coordinates
        coordinates[bad.all(axis=-1)] = np.nan
        right = coordinates[~np.isnan(coordinates).any(axis=-1)].reshape(-1, coordinates.shape[-1])
        if len(right):
            self._last = right[-1]
        covariance = fitted.covariance(p.limits.scales)
        covariance[bad.all(axis=-1)] = np.nan
        return MagneticBackbone(
            self,
            base,
            coordinates,
            covariance,
            faults,
            fitted.information,
            np.zeros(readings.shape[:-1], dtype=bool),
        )

    def _filtered(self, measured: Measured, readings: FloatArray, base: FloatArray) -> MagneticBackbone:
        assert self._filter is not None
        batch = readings.shape[:-1]
        times = np.broadcast_to(np.asarray(measured.times, dtype=float), batch)
        rows = zip(times.ravel(), readings.reshape(-1, readings.shape[-1]), base.reshape(-1, 4), strict=True)
        steps = [self._filter.step(float(time), row, q) for time, row, q in rows]
        of = [np.array(each) for each in zip(*steps, strict=True)]
        coordinates, covariance, faults, information, doubtful = (a.reshape(*batch, *a.shape[1:]) for a in of)
        nothing = (faults != ReadingFault.NONE).all(axis=-1)  # then it is but what was before, going on
        coordinates[nothing], covariance[nothing] = np.nan, np.nan
        return MagneticBackbone(self, base, coordinates, covariance, faults, information, doubtful)

    def _precompute(self, s: FloatArray) -> None:
        """Nothing: the kinematics keep what they need."""
