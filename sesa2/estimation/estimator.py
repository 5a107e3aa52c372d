"""Sweeps in, the arm's shape by every configured model out; one sweep or a whole batch."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sesa2.alignment.heading_filter import HeadingFilter
from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.estimation.sweeps import Sweep, SweepAssembler
from sesa2.sensing.imu.mounting import Mounting
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
    joints : (n, n_links, 3)
        joint angles x, z, y of each link, rad.
    ends, end_orientations : (n, n_links + 1, 3) and (…, 4)
        ends of all links, base to tip, m, and the orientations there, x y z w.
    markers, marker_orientations : (n, n_markers, 3) and (…, 4)
        the markers, m, x y z w.
    near_singular
        number of sweeps with a joint beyond 80° about z.
    fallen_back
        number of sweeps that the model could not solve and gave the shape of another.
    """

    joints: FloatArray
    ends: FloatArray
    end_orientations: FloatArray
    markers: FloatArray
    marker_orientations: FloatArray
    near_singular: int
    fallen_back: int


class Estimate(NamedTuple):
    """Results of a batch of sweeps.

    Attributes
    ----------
    stamps_ns : (n,)
        time of the measurement of each result, ns.
    base : (n, 4)
        q_WB, x y z w.
    models
        by name, in the order of the configuration.
    """

    stamps_ns: np.ndarray
    base: FloatArray
    models: dict[str, ModelResult]


class _Configured:
    """A model, what it is asked for and where its links stand among those of all models."""

    def __init__(self, model: Model[Any], markers: Sequence[float], first_link: int):
        self.model = model
        n = model.n_links
        self.links = slice(first_link, first_link + n)
        self.positions_at = np.concatenate([model.link_ends, markers])
        self.orientations_at = np.concatenate([model.link_middles, model.link_ends[-1:], markers])
        # Where a link ends it is oriented as that link is; only the tip and the markers are asked for exactly.
        self.at_positions = np.array([0, *range(n - 1), *range(n, len(self.orientations_at))])
        self.angles: FloatArray | None = None  # of the last sweep, to go on from at a singularity


class Estimator:
    """Turns measured orientations into shapes. What does not depend on the measurement is computed once.

    Parameters
    ----------
    configuration
        the arm, its IMUs and the models.
    """

    def __init__(self, configuration: Configuration):
        self.configuration = configuration
        self.layout = configuration.layout
        self._mounting = Mounting(configuration.mountings, configuration.headings)
        self._base = configuration.base
        self._base_mounting = Mounting(configuration.base_mounting[None], np.zeros(1))
        self._heading_filter = HeadingFilter(self.layout) if configuration.imus.heading_filter else None
        self._in_world = configuration.arm.output_frame == 'world'
        self._models: dict[str, _Configured] = {}
        n_links = 0
        for name in configuration.models:
            model = configuration.create_model(name)
            self._models[name] = _Configured(model, configuration.markers.positions, n_links)
            n_links += model.n_links
        self._base_is_world = not configuration.imus.base_id and bool(
            np.array_equal(np.abs(self._base), IDENTITY)
        )

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
            has_base=imus.base_id != 0,
            timeout=self.configuration.sweep_timeout,
            interpolate=self.configuration.time_alignment == 'interpolate',
            latency=imus.latency,
            patience=patience,
        )

    def estimate(self, sweeps: Sequence[Sweep]) -> Estimate:
        """Shapes of sweeps.

        Parameters
        ----------
        sweeps
            at least one, in order of time.
        """
        stamps = np.array([sweep.stamp_ns for sweep in sweeps], dtype=np.int64)
        measured = np.array([sweep.measured for sweep in sweeps])
        base = self.bases(sweeps)
        orientations = self._mounting.link_orientations(np.array([sweep.orientations for sweep in sweeps]))
        if self._heading_filter:
            orientations = self._heading_filter.correct(stamps / NS, orientations, measured, base)
        orientations = fill_missing(orientations, measured, self.layout, base)
        return Estimate(stamps, base, self._fit(orientations, base))

    def bases(self, sweeps: Sequence[Sweep]) -> FloatArray:
        """Orientation of the base at each sweep, q_WB, (n, 4): of the IMU on it where there is one, else as configured.

        Raises
        ------
        Sesa2Error
            a sweep lacks that IMU.
        """
        measured = [sweep.base for sweep in sweeps if sweep.base is not None]
        if not measured and not self.configuration.imus.base_id:
            bases = np.empty((len(sweeps), 4))
            bases[:] = self._base
            return bases
        if len(measured) < len(sweeps):
            n = len(sweeps) - len(measured)
            raise Sesa2Error(f'{n} of {len(sweeps)} sweeps without the IMU on the base, expected it in each')
        return self._base_mounting.link_orientations(np.stack(measured)[:, None])[:, 0]

    def _fit(self, orientations: FloatArray, base: FloatArray) -> dict[str, ModelResult]:
        measured = Measured(orientations, base)
        models = self._models.values()
        asked, links = [], []
        for configured in models:
            backbone = configured.model.fit(measured)
            positions = backbone.positions(configured.positions_at)
            there = backbone.orientations(configured.orientations_at)
            asked.append((positions, there, backbone.fallen_back))
            links.append(there[:, : configured.model.n_links])
        # All models' joints in one call: for a single sweep the number of numpy's calls is what costs.
        joints = joint_angles(np.concatenate(links, axis=1), base, [one.links.start for one in models])
        may_jump = bool(joints.cosine.min() < WARN_COSINE)
        return {
            name: self._result(configured, *ours, base, joints, may_jump)
            for (name, configured), ours in zip(self._models.items(), asked, strict=True)
        }

    def _result(
        self,
        configured: _Configured,
        positions: FloatArray,
        orientations: FloatArray,
        fallen_back: int,
        base: FloatArray,
        joints: JointAngles,
        may_jump: bool,
    ) -> ModelResult:
        there = orientations.take(configured.at_positions, axis=1)
        if not self._in_world and not self._base_is_world:
            to_base = conjugate(base)[:, None, :]
            positions, there = rotate(to_base, positions), multiply(to_base, there)
        own = JointAngles(joints.angles[:, configured.links], joints.cosine[:, configured.links])
        near_singular = 0
        if may_jump:
            own = self._without_jumps(configured, own)
            near_singular = int(np.count_nonzero(own.cosine.min(axis=-1) < WARN_COSINE))
        configured.angles = own.angles[-1]
        n = configured.model.n_links + 1
        return ModelResult(
            joints=own.angles,
            ends=positions[:, :n],
            end_orientations=there[:, :n],
            markers=positions[:, n:],
            marker_orientations=there[:, n:],
            near_singular=near_singular,
            fallen_back=fallen_back,
        )

    @staticmethod
    def _without_jumps(configured: _Configured, joints: JointAngles) -> JointAngles:
        """Joint angles of the sweeps in turn, each going on from the one before where a joint is singular."""
        angles = joints.angles
        if joints.singular.any():
            last = configured.angles if configured.angles is not None else np.zeros(angles.shape[1:])
            for i in range(len(angles)):
                angles[i] = last = hold_x(JointAngles(angles[i], joints.cosine[i]), last)
        return joints
