"""Sweeps in, the arm's shape by every configured model out; one sweep or a whole batch."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from sesa2.alignment.earth_frame import BaseComparison
from sesa2.alignment.heading_filter import HeadingFilter
from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.estimation.field_sweeps import FieldSweepAssembler
from sesa2.estimation.joint_velocities import JointVelocities
from sesa2.estimation.sweep_lengths import SweepLengths
from sesa2.estimation.sweeps import Sweep, SweepAssembler
from sesa2.sensing.imu.mounting import Mounting
from sesa2.sensing.lengths import outside_stretch
from sesa2.shape.backbone import Backbone
from sesa2.shape.joints import WARN_COSINE, JointAngles, hold_x, joint_angles
from sesa2.shape.measured import Measured
from sesa2.shape.missing import fill_missing
from sesa2.shape.model import Model
from sesa2.shape.rotations import IDENTITY, FloatArray, conjugate, multiply, rotate
from sesa2.time import NS


class ModelResult(NamedTuple):
    """What one model says; in the configured output frame, leading axis the sweeps.

    Attributes
    ----------
    joints : (n, n_links, 3 or 4)
        joint angles x, z, y of each link, rad; of an arm that stretches its present length, m, behind them.
    joint_velocities : (n, n_links, 3 or 4)
        rad/s, m/s, since the result before; nan where there is none.
    ends, end_orientations : (n, n_links + 1, 3) and (…, 4)
        ends of all links, base to tip, m, and the orientations there, x y z w.
    markers, marker_orientations : (n, n_markers, 3) and (…, 4)
        the markers, m, x y z w.
    near_singular
        number of sweeps with a joint beyond 80° about z.
    fallen_back
        number of sweeps that the model could not solve and gave the shape of another.
    coordinates : (n, n_coordinates) or None
        of the segments, rad and m, in the order of the model's `coordinate_names`; None where it has none.
    twists : (n, n_segments) or None
        twist that each segment was measured to have and its shape has not, rad.
    """

    joints: FloatArray
    joint_velocities: FloatArray
    ends: FloatArray
    end_orientations: FloatArray
    markers: FloatArray
    marker_orientations: FloatArray
    near_singular: int
    fallen_back: int
    coordinates: FloatArray | None = None
    twists: FloatArray | None = None


class Estimate(NamedTuple):
    """Results of a batch of sweeps.

    Attributes
    ----------
    stamps_ns : (n,)
        time of the measurement of each result, ns.
    base : (n, 4)
        q_WB, x y z w.
    models
        by name, in the order of the configuration; empty where there is no result.
    base_joints, base_velocities : (n, 3)
        joint angles x, z, y of the base in the world, rad, and rad/s as of the other joints; of an IMU on the base.
    without_lengths
        number of sweeps without a result, since the length of a segment was not known.
    outside_stretch : (n_segments,)
        number of results with a segment shorter or longer than it should ever be.
    backbones
        what each model made of all the sweeps, by name; also of those without a result.
    lost
        number of sweeps without a result, since a model found none.
    """

    stamps_ns: np.ndarray
    base: FloatArray
    models: dict[str, ModelResult]
    base_joints: FloatArray | None = None
    base_velocities: FloatArray | None = None
    without_lengths: int = 0
    outside_stretch: np.ndarray = np.zeros(0, dtype=int)
    backbones: Mapping[str, Backbone] = MappingProxyType({})
    lost: int = 0


class _Configured:
    """A model, what it is asked for and where its links stand among those of all models."""

    def __init__(self, model: Model[Any], markers: Sequence[float], first_link: int):
        self.model = model
        n = model.n_links
        self.links = slice(first_link, first_link + n)
        self.pieces = model.stretching.pieces(model.link_ends)
        self.positions_at = np.concatenate([model.link_ends, markers])
        self.orientations_at = np.concatenate([model.link_middles, model.link_ends[-1:], markers])
        # Where a link ends it is oriented as that link is; only the tip and the markers are asked for exactly.
        self.at_positions = np.array([0, *range(n - 1), *range(n, len(self.orientations_at))])


class Estimator:
    """Turns what was measured into shapes. What does not depend on the measurement is computed once.

    Parameters
    ----------
    configuration
        the arm, its sensors and the models.
    kind
        of sensors that the sweeps are of: those of IMUs (`orientations`) or of magnetometers (`fields`). It has the
        models that need this kind.
    """

    def __init__(self, configuration: Configuration, kind: str = 'orientations'):
        self.configuration = configuration
        self.layout = configuration.layout
        self._mounting = Mounting(configuration.mountings, configuration.headings)
        self._base = configuration.base
        self._on_base = configuration.imus.base_id != 0
        self._base_mounting = Mounting(configuration.base_mounting[None], np.zeros(1))
        self._kind = kind
        wants_headings = configuration.imus.heading_filter and kind == 'orientations'
        self._heading_filter = HeadingFilter(self.layout) if wants_headings else None
        self._in_world = configuration.arm.output_frame == 'world'
        self._models: dict[str, _Configured] = {}
        n_links = 0
        for name in configuration.models_of(kind):
            model = configuration.create_model(name)
            self._models[name] = _Configured(model, configuration.markers.positions, n_links)
            n_links += model.n_links
        self._on_clamp = [one.links.start for one in self._models.values()]
        self._backbones = configuration.backbones if configuration.has_lengths else None
        self._velocities = JointVelocities()
        self._angles: FloatArray | None = None  # of the last sweep, to go on from at a singularity
        self._base_is_world = not self._on_base and bool(np.array_equal(np.abs(self._base), IDENTITY))

    @property
    def models(self) -> dict[str, Model[Any]]:
        """The models, in the order of the configuration."""
        return {name: configured.model for name, configured in self._models.items()}

    def assembler(self, patience: float | None = None) -> SweepAssembler:
        """A sweep assembler for this configuration; index n_imu is the IMU on the base, if there is one.

        Parameters
        ----------
        patience : s
            how long a message may be on its way; None: arrivals teach it.
        """
        imus = self.configuration.imus
        return SweepAssembler(
            imus.enabled,
            has_base=self._on_base,
            timeout=self.configuration.sweep_timeout,
            interpolate=self.configuration.time_alignment == 'interpolate',
            latency=imus.latency,
            patience=patience,
        )

    def field_assembler(self, patience: float | None = None) -> FieldSweepAssembler:
        """The same for the magnetometers; index k is the k-th of `magnetometers.ids`."""
        magnetometers = self.configuration.magnetometers
        return FieldSweepAssembler(
            [i not in magnetometers.masked for i in magnetometers.ids],
            wants_base=self._on_base,
            timeout=self.configuration.sweep_timeout,
            interpolate=self.configuration.time_alignment == 'interpolate',
            patience=patience,
        )

    def sweep_lengths(self, assembler: SweepAssembler, patience: float | None = None) -> SweepLengths:
        """What gives the sweeps of an assembler their lengths; patience as above.

        Only of a configuration that has lengths.
        """
        lengths = self.configuration.lengths
        n = len(lengths.names)
        return SweepLengths(n, timeout=lengths.timeout, imus=assembler.arrivals, patience=patience)

    def estimate(self, sweeps: Sequence[Sweep]) -> Estimate:
        """Shapes of sweeps.

        Parameters
        ----------
        sweeps
            at least one, in order of time.
        """
        stamps = np.array([sweep.stamp_ns for sweep in sweeps], dtype=np.int64)
        base = self.bases(sweeps)
        if not self._models:
            return Estimate(stamps[:0], base[:0], {})
        if self._kind == 'fields':
            fields = np.array([sweep.fields for sweep in sweeps])
            return self._fit(stamps, Measured(None, base, fields=fields, times=stamps / NS))
        measured = np.array([sweep.measured for sweep in sweeps])
        orientations = self._mounting.link_orientations(np.array([sweep.orientations for sweep in sweeps]))
        if self._heading_filter:
            orientations = self._heading_filter.correct(stamps / NS, orientations, measured, base)
        orientations = fill_missing(orientations, measured, self.layout, base)
        if self._backbones is None:
            return self._fit(stamps, Measured(orientations, base))
        lengths, bends = self._backbones.read(np.stack([self._lengths_of(sweep) for sweep in sweeps]))
        known = (lengths > 0.0).all(axis=-1)
        without = len(sweeps) - int(np.count_nonzero(known))
        if without == len(sweeps):
            return Estimate(stamps[:0], base[:0], {}, without_lengths=without)
        if without:
            stamps, base, orientations = stamps[known], base[known], orientations[known]
            lengths, bends = lengths[known], bends[known]
        segments = self.configuration.segments
        outside = outside_stretch(lengths, segments.lengths, segments.stretch).sum(axis=0)
        estimate = self._fit(stamps, Measured(orientations, base, lengths, bends))
        return estimate._replace(without_lengths=without, outside_stretch=outside)

    def _lengths_of(self, sweep: Sweep) -> FloatArray:
        n = len(self.configuration.lengths.names)
        return np.full(n, np.nan) if sweep.lengths is None else sweep.lengths

    def compare(self, sweeps: Sequence[Sweep], comparison: BaseComparison) -> BaseComparison:
        """Have it look at sweeps; the comparison."""
        links = self._mounting.link_orientations(np.array([sweep.orientations for sweep in sweeps]))
        comparison.add(links, np.array([sweep.measured for sweep in sweeps]), self.bases(sweeps))
        return comparison

    def bases(self, sweeps: Sequence[Sweep]) -> FloatArray:
        """Orientation of the base at each sweep, q_WB, (n, 4): of the IMU on it where there is one, else as configured.

        Raises
        ------
        Sesa2Error
            a sweep lacks that IMU.
        """
        measured = [sweep.base for sweep in sweeps if sweep.base is not None]
        if not measured and not self._on_base:
            bases = np.empty((len(sweeps), 4))
            bases[:] = self._base
            return bases
        if len(measured) < len(sweeps):
            n = len(sweeps) - len(measured)
            raise Sesa2Error(f'{n} of {len(sweeps)} sweeps without the IMU on the base, expected it in each')
        return self._base_mounting.link_orientations(np.stack(measured)[:, None])[:, 0]

    def _fit(self, stamps_ns: np.ndarray, measured: Measured) -> Estimate:
        base = np.asarray(measured.base)
        backbones = {name: one.model.fit(measured) for name, one in self._models.items()}
        given = _given(backbones, len(base))
        lost = 0 if given is None else len(base) - int(np.count_nonzero(given))
        if lost == len(base):
            return Estimate(stamps_ns[:0], base[:0], {}, backbones=backbones, lost=lost)
        if given is not None:
            stamps_ns, base = stamps_ns[given], base[given]
        fitted, links, lengths = [], [], []
        for name, configured in self._models.items():
            backbone = backbones[name]
            positions = _of(backbone.positions(configured.positions_at), given)
            there = _of(backbone.orientations(configured.orientations_at), given)
            fitted.append((positions, there, backbone))
            links.append(there[:, : configured.model.n_links])
            if backbone.lengths is not None:
                lengths.append(_of(backbone.lengths, given) @ configured.pieces)
        # All models' joints in one call: for a single sweep the number of numpy's calls is what costs.
        of_links = joint_angles(np.concatenate(links, axis=1), base, self._on_clamp)
        near_singular = self._hold_singular(of_links)
        joints = of_links.angles
        if lengths:
            joints = np.concatenate([joints, np.concatenate(lengths, axis=1)[..., None]], axis=-1)
        if self._on_base:  # behind the links, as one of them
            own = np.zeros((len(base), 1, joints.shape[-1]))
            own[..., :3] = joint_angles(base[:, None], IDENTITY).angles
            joints = np.concatenate([joints, own], axis=1)
        velocities = self._velocities.of(stamps_ns, joints)
        results = {}
        for (name, configured), (positions, there, backbone) in zip(
            self._models.items(), fitted, strict=True
        ):
            n, at = configured.model.n_links + 1, configured.links
            there = there.take(configured.at_positions, axis=1)
            if not self._in_world and not self._base_is_world:
                to_base = conjugate(base)[:, None, :]
                positions, there = rotate(to_base, positions), multiply(to_base, there)
            results[name] = ModelResult(
                joints=joints[:, at],
                joint_velocities=velocities[:, at],
                ends=positions[:, :n],
                end_orientations=there[:, :n],
                markers=positions[:, n:],
                marker_orientations=there[:, n:],
                near_singular=0
                if near_singular is None
                else int(np.count_nonzero(near_singular[:, at].any(axis=-1))),
                fallen_back=backbone.fallen_back,
                coordinates=None if backbone.coordinates is None else _of(backbone.coordinates, given),
                twists=None if backbone.twists is None else _of(backbone.twists, given),
            )
        estimate = Estimate(stamps_ns, base, results, backbones=backbones, lost=lost)
        if not self._on_base:
            return estimate
        return estimate._replace(base_joints=joints[:, -1, :3], base_velocities=velocities[:, -1, :3])

    def _hold_singular(self, joints: JointAngles) -> np.ndarray | None:
        """Have singular joints go on from the sweep before, in place; which are near it, (n, links), None: none."""
        near = None
        if joints.cosine.min() < WARN_COSINE:
            near = joints.cosine < WARN_COSINE
            if joints.singular.any():
                last = np.zeros(joints.angles.shape[1:]) if self._angles is None else self._angles
                for i in range(len(joints.angles)):
                    last = hold_x(JointAngles(joints.angles[i], joints.cosine[i]), last)
                    joints.angles[i] = last
        self._angles = joints.angles[-1]
        return near


def _given(backbones: Mapping[str, Backbone], n: int) -> np.ndarray | None:
    """Of which sweeps every model has found a shape, (n,); None: of all."""
    lost = [backbone.lost for backbone in backbones.values() if backbone.lost is not None]
    return ~np.logical_or.reduce([np.broadcast_to(each, n) for each in lost]) if lost else None


def _of(values: FloatArray, given: np.ndarray | None) -> FloatArray:
    return values if given is None else values[given]
