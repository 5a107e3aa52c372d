"""Segments of constant curvature without twist, fitted to the orientations of their ends (Hughes et al. eq. 1–3)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.curve import CurveModel
from sesa2.shape.kinematics import create_kinematics
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.model import Backbone
from sesa2.shape.options import LinkOptions, parameter
from sesa2.shape.rotations import FloatArray, conjugate, multiply, rotate
from sesa2.shape.segment_bend import TWIST_OWNERS, fit_bend


@dataclass(frozen=True)
class PccDeltaOptions(LinkOptions):
    """Options of the model `pcc_delta`.

    Attributes
    ----------
    twist
        who owns the twist that an arc cannot have: see `fit_bend`.
    """

    twist: str = parameter(
        'shared', 'who owns the twist that is left: shared, tip, base or heading', choices=TWIST_OWNERS
    )


class TwistFreeArcs(Backbone):
    """Arcs in the frame of the base.

    Attributes
    ----------
    coordinates : batch + (3 n,)
        bend_x, bend_y, rad, and length, m, of each segment, base to tip; a straight one past the last IMU.
    twists : batch + (n_imu,)
        what was left at each IMU, rad.
    """

    def __init__(self, model: 'PccDelta', measured: Measured):
        self._model = model
        stations = measured.stations
        before = stations[..., :-1, :]
        vertical = rotate(conjugate(before), (0.0, 0.0, 1.0)) if model.twist == 'heading' else None
        bend, self.twists = fit_bend(multiply(conjugate(before), stations[..., 1:, :]), model.twist, vertical)
        n_imu, n = bend.shape[-2], len(model.kinematics.segment_lengths)
        self._carried = np.zeros((*bend.shape[:-2], n))
        if model.twist == 'tip':
            # The arm's own: what follows is turned by it. An arc in a frame turned about its tangent is one whose bend
            # is turned, and the frame then is turned at its end, too.
            np.cumsum(self.twists[..., : n - 1], axis=-1, out=self._carried[..., 1:])
            turn = np.exp(1j * self._carried[..., :n_imu])
            bend = (np.ascontiguousarray(bend).view(complex)[..., 0] * turn)[..., None].view(float)
        coordinates = np.zeros((*bend.shape[:-2], n, 3))
        coordinates[..., :n_imu, :2] = bend
        coordinates[..., 2] = model.kinematics.segment_lengths
        self.coordinates = coordinates.reshape(*bend.shape[:-2], 3 * n)
        self._base = stations[..., :1, :]
        self._arcs = model.kinematics.backbone(self.coordinates)

    def positions(self, s: ArrayLike) -> FloatArray:
        """See Backbone."""
        self._model.at(s)
        return rotate(self._base, self._arcs.positions(s))

    def orientations(self, s: ArrayLike) -> FloatArray:
        """See Backbone. Within a segment there is no twist; at its end stands what is before it."""
        half = 0.5 * self._carried.take(self._model.at(s), axis=-1)
        twist = np.zeros((*half.shape, 4))
        twist[..., 2], twist[..., 3] = np.sin(half), np.cos(half)
        return multiply(self._base, multiply(self._arcs.orientations(s), twist))


class PccDelta(CurveModel[np.ndarray]):
    """Arcs from station to station that have no twist; straight past the last IMU.

    Each segment stands on the one before it. The twist that is left between its ends is an error of the sensors and
    does not go on, unless the tip owns it: then the arm twists there, and each arc stands on the measured orientation.
    """

    name = 'pcc_delta'
    Options = PccDeltaOptions

    def __init__(self, layout: Layout, options: PccDeltaOptions):
        super().__init__(layout, options)
        self.twist = options.twist
        past = layout.arm.length - layout.stations[-1]
        lengths = [*np.diff(layout.stations), *([past] if past > 0.0 else [])]
        self.kinematics = create_kinematics('pcc', lengths)

    def _fit(self, measured: Measured) -> TwistFreeArcs:
        return TwistFreeArcs(self, measured)

    def _precompute(self, s: FloatArray) -> np.ndarray:
        """Segment that each place is in, (n,)."""
        ends = np.cumsum(self.kinematics.segment_lengths)
        return np.searchsorted(ends[:-1], s, side='left')
