"""Segments that bend without twist, fitted to the orientations of their ends (Hughes et al. eq. 1–3)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.arm import GeometryError
from sesa2.shape.backbone import Backbone
from sesa2.shape.curve import CurveModel
from sesa2.shape.kinematics import create_kinematics
from sesa2.shape.kinematics.segment_chain import SegmentChain
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.options import LinkOptions, parameter
from sesa2.shape.rotations import FloatArray, conjugate, multiply, rotate
from sesa2.shape.segment_bend import TWIST_OWNERS, fit_bend
from sesa2.shape.segment_ends import SegmentEnds

# What is expected of an affine curvature, and by how much an IMU between the ends of a segment may be off, rad.
AFFINE_STD = 0.25
_INNER_STD = np.deg2rad(1.0)


@dataclass(frozen=True)
class PccDeltaOptions(LinkOptions):
    """Options of the model `pcc_delta`.

    Attributes
    ----------
    twist
        who owns the twist that an arc cannot have: see `fit_bend`.
    affine
        a of each segment, or one for all: at the fraction v of a segment its curvature is 1 + a (1 − 2 v) times the
        mean.
    slip
        c₁, c₂, c₃ of each segment, or one three for all: a measured length is too long by
        c₁ (bend by the backbones − bend by the IMUs) radius + c₂ (length − length at rest) + c₃.
    """

    twist: str = parameter(
        'shared', 'who owns the twist that is left: shared, tip, base or heading', choices=TWIST_OWNERS
    )
    affine: tuple[float, ...] = parameter(
        (0.0,),
        'change of curvature along a segment: 1 + a times the mean at its base, 1 − a at its tip; one for all or each',
        low=-3.0,
        high=3.0,
    )
    slip: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0),
        'too long by measured lengths: by their bend, by stretch, and always, m; three numbers for all or each',
        low=-1.0,
        high=1.0,
    )


class TwistFreeSegments(Backbone):
    """The segments in the frame of the base.

    Attributes
    ----------
    lengths : batch + (m,)
        see Backbone; what slipped is taken off.
    coordinates : batch + (n_coordinates,)
        see `PccDelta.kinematics`; straight past the last IMU.
    twists : batch + (m,)
        what was left in each segment, rad.
    """

    coordinates: FloatArray

    def __init__(self, model: 'PccDelta', measured: Measured):
        self._model = model
        stations = measured.stations
        ends = model.ends.orientations(stations)
        before = conjugate(ends[..., :-1, :])
        vertical = rotate(before, (0.0, 0.0, 1.0)) if model.twist == 'heading' else None
        bend, self.twists = fit_bend(multiply(before, ends[..., 1:, :]), model.twist, vertical)
        m = bend.shape[-2]
        coordinates = np.zeros((*bend.shape[:-1], len(model.kinematics.segment_coordinates)))
        if measured.lengths is not None:
            self.lengths = model.without_slip(measured, bend)
        coordinates[..., -1] = model.ends.lengths if self.lengths is None else self.lengths
        affine = model.affine
        if model.ends.inner:
            affine = model.told_affine(stations, before, bend, vertical)
        self._carried = np.zeros(bend.shape[:-1])
        if model.twist == 'tip' and m > 1:
            # The arm's own: what follows is turned by it. A bend in a frame turned about its tangent is one that is
            # turned, and the frame then is turned at its end, too.
            np.cumsum(self.twists[..., :-1], axis=-1, out=self._carried[..., 1:])
            turn = np.exp(1j * self._carried)
            bend = (np.ascontiguousarray(bend).view(complex)[..., 0] * turn)[..., None].view(float)
        coordinates[..., :2] = bend
        if model.bends_affinely:
            coordinates[..., 2:4] = -2.0 * affine[..., None] * bend
        self.coordinates = coordinates.reshape(*bend.shape[:-2], -1)
        self._base = stations[..., :1, :]

    @cached_property
    def _shape(self) -> SegmentChain[Any]:
        return self._model.kinematics.backbone(self.coordinates)

    def positions(self, s: ArrayLike) -> FloatArray:
        """See Backbone."""
        self._model.at(s)
        return rotate(self._base, self._shape.positions(s))

    def orientations(self, s: ArrayLike) -> FloatArray:
        """See Backbone. Within a segment there is no twist; at its end stands what is before it."""
        half = 0.5 * self._carried.take(self._model.at(s), axis=-1)
        twist = np.zeros((*half.shape, 4))
        twist[..., 2], twist[..., 3] = np.sin(half), np.cos(half)
        return multiply(self._base, multiply(self._shape.orientations(s), twist))


class PccDelta(CurveModel[np.ndarray]):
    """Segments that have no twist, each bent from the orientation at its base to that at its tip, as long as measured.

    Each segment stands on the one before it. The twist that is left between its ends is an error of the sensors and
    does not go on, unless the tip owns it: then the arm twists there, and each segment stands on the measured
    orientation.

    The bend between the ends of a segment is the same however its curvature is distributed. Where that is not constant,
    it is κ(v) = bend / length (1 + a (1 − 2 v)), turned by bend (v + a v (1 − v)) up to the fraction v: `affine`. IMUs
    between the ends tell a as a maximum a posteriori about what `affine` says, the more the segment bends.
    """

    name = 'pcc_delta'
    Options = PccDeltaOptions

    def __init__(self, layout: Layout, options: PccDeltaOptions):
        super().__init__(layout, options)
        self.twist = options.twist
        self.ends = SegmentEnds(layout)
        self.doubts = self.ends.doubts
        m = len(self.ends.lengths)
        self.affine = _one_each('affine', options.affine, m, 1)[:, 0]
        self.bends_affinely = bool(self.affine.any()) or bool(self.ends.inner)
        self.kinematics = create_kinematics('affine' if self.bends_affinely else 'pcc', self.ends.lengths)
        self.coordinate_names = self.kinematics.coordinate_names
        self._slip = _one_each('slip', options.slip, m, 3)
        self._slips = layout.stretches and bool(self._slip.any())
        by_bend = self._slip[:, 0] != 0.0
        self._slip_radii = np.zeros(m)
        if self._slips and by_bend.any():
            if not layout.backbone_radii or not np.all(np.array(layout.backbone_radii)[by_bend]):
                raise GeometryError(
                    'slip: the first of its numbers is not 0, and the backbones do not tell how a segment bends, or '
                    'one on its axis tells its length; expected 0.0, or three backbones beside the axis alone'
                )
            self._slip_radii = np.array(layout.backbone_radii)
            self.needs = (*self.needs, 'backbone_bends')

    def _fit(self, measured: Measured) -> TwistFreeSegments:
        return TwistFreeSegments(self, measured)

    def without_slip(self, measured: Measured, bend: FloatArray) -> FloatArray:
        """Measured length of each segment, batch + (m,), m, given its bend by the IMUs, batch + (m, 2), rad."""
        lengths = np.asarray(measured.lengths, dtype=float)
        if not self._slips:
            return lengths
        too_long = self._slip[:, 1] * (lengths - self.ends.lengths) + self._slip[:, 2]
        if self._slip_radii.any():
            by_backbones = np.linalg.norm(np.asarray(measured.backbone_bends, dtype=float), axis=-1)
            by_imus = np.linalg.norm(bend, axis=-1)
            # Where there is no slip by the bend, backbones need not tell it.
            by_bend = self._slip[:, 0] * self._slip_radii * (by_backbones - by_imus)
            too_long = too_long + np.where(self._slip[:, 0] == 0.0, 0.0, by_bend)
        return np.asarray(lengths - too_long)

    def told_affine(
        self, stations: FloatArray, to_segment: FloatArray, bend: FloatArray, vertical: FloatArray | None
    ) -> FloatArray:
        """A of each segment by the IMUs between its ends, batch + (m,).

        Parameters
        ----------
        stations : batch + (n_imu + 1, 4)
            measured, x y z w.
        to_segment : batch + (m, 4)
            from the world to the base of each segment, x y z w.
        bend : batch + (m, 2)
            of each segment, rad.
        vertical : batch + (m, 3) or None
            in the frame of the base of each segment.
        """
        pull = np.zeros(bend.shape[:-1])
        weight = np.full(bend.shape[:-1], np.square(_INNER_STD / AFFINE_STD))
        for k, i, v in self.ends.inner:
            up = None if vertical is None else vertical[..., k, :]
            there = fit_bend(multiply(to_segment[..., k, :], stations[..., i, :]), self.twist, up).bend
            own, w = bend[..., k, :], v * (1.0 - v)
            # Along the bend: what is there is |bend| (v + a w).
            off = there - (v + self.affine[k] * w) * own
            pull[..., k] += w * np.einsum('...i,...i->...', off, own)
            weight[..., k] += w * w * np.einsum('...i,...i->...', own, own)
        return np.asarray(self.affine + pull / weight)

    def _precompute(self, s: FloatArray) -> np.ndarray:
        """Segment that each place is in, (n,)."""
        ends = np.cumsum(self.ends.lengths)
        return np.searchsorted(ends[:-1], s, side='left')


def _one_each(name: str, values: tuple[float, ...], m: int, of: int) -> FloatArray:
    """Numbers of each segment, (m, of), from those of all or of each."""
    if len(values) not in (of, of * m):
        raise GeometryError(
            f'{name} has {len(values)} numbers, expected {of} or {of * m}: for all segments or for each'
        )
    return np.broadcast_to(np.reshape(values, (-1, of)), (m, of)).astype(float)
