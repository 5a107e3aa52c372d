"""What an arm can reach: limits of its coordinates, and the reachable point that is nearest to a target."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sesa2.sensing.lengths import BackboneLengths
from sesa2.shape.arm import GeometryError
from sesa2.shape.kinematics.constant_curvature import ConstantCurvature, arc_to
from sesa2.shape.rotations import FloatArray

_EXACT = 1e-7  # m
_ROUNDS = 60
_EDGE = 181  # points on a limit, before it is refined


class Reached(NamedTuple):
    """The nearest that the tip comes to a point.

    Attributes
    ----------
    coordinates : (3 m,)
        bend_x, bend_y, length of each segment, rad and m.
    point : (3,)
        where the tip is then, in B, m.
    left : float
        distance from the point asked for, m.
    """

    coordinates: FloatArray
    point: FloatArray
    left: float


class Reach:
    """Limits of an arm of segments of constant curvature, and what lies within them.

    Parameters
    ----------
    segment_lengths : (m,)
        at rest, m.
    backbones
        those that are driven.
    bend_max
        largest |bend| of a segment, rad.
    stretch : (2,)
        shortest and longest length of a segment over that at rest.
    length_limits : (2,) or empty
        shortest and longest of a driven backbone, m for each segment that it passes; empty: what the others come to.

    Attributes
    ----------
    kinematics
        of the arm, constant curvature.
    scale : (3 m,)
        of the coordinates, so that a step of one moves the tip alike: 1 rad, the length of the segment.

    Raises
    ------
    GeometryError
        straight and between its limits the arm would break those of a backbone.
    """

    def __init__(
        self,
        segment_lengths: ArrayLike,
        backbones: BackboneLengths,
        bend_max: float,
        stretch: ArrayLike,
        length_limits: ArrayLike = (),
    ):
        self.kinematics = ConstantCurvature(segment_lengths)
        rest = self.kinematics.segment_lengths
        self._rest, self._bend_max, self._backbones = rest, float(bend_max), backbones
        self._shortest, self._longest = np.outer(np.asarray(stretch, dtype=float), rest)
        self._tip = np.array([self.kinematics.arm.length])
        self.scale = np.where(self.kinematics.rest > 0.0, self.kinematics.rest, 1.0)
        through = backbones.through.sum(axis=1)
        limits = np.asarray(length_limits, dtype=float)
        if len(limits):
            self._limits = np.outer(limits, through)
        else:
            # What the limits of the segments come to: beside the axis a bend adds its radius times the angle.
            aside = backbones.radii * through * self._bend_max
            self._limits = np.array(
                [backbones.through @ self._shortest - aside, backbones.through @ self._longest + aside]
            )
        self.straight = self.kinematics.rest.copy()
        if len(limits):
            # Straight, and as long as the middle of what all limits allow.
            low = np.maximum(self._shortest, limits[0])
            high = np.minimum(self._longest, limits[1])
            if (low >= high).any():
                raise GeometryError(
                    f'backbones of {limits[0]} to {limits[1]} m leave no length of a segment between '
                    f'{self._shortest.tolist()} and {self._longest.tolist()} m'
                )
            self.straight[2::3] = np.clip(rest, low + 0.05 * (high - low), high - 0.05 * (high - low))

    def tip(self, coordinates: ArrayLike) -> FloatArray:
        """Where the tip is, batch + (3,), m."""
        return self.kinematics.backbone(coordinates).positions(self._tip)[..., 0, :]

    def tip_jacobian(self, coordinates: ArrayLike) -> FloatArray:
        """Derivatives of the tip's position by the coordinates, (3, 3 m), m per rad and per m."""
        return self.kinematics.jacobian(coordinates, self._tip)[..., 0, :3, :]

    def within(self, coordinates: ArrayLike) -> FloatArray:
        """The coordinates, each put back to its own limit, then all drawn back until no backbone breaks its limits."""
        q = np.array(coordinates, dtype=float)
        each = q.reshape(-1, 3)
        bend = np.hypot(each[:, 0], each[:, 1])
        each[:, :2] *= np.minimum(1.0, self._bend_max / np.maximum(bend, 1e-300))[:, None]
        each[:, 2] = np.clip(each[:, 2], self._shortest, self._longest)
        return self.driveable(q)

    def driveable(self, coordinates: FloatArray) -> FloatArray:
        """The coordinates, drawn back towards straight until no driven backbone breaks its limits."""
        lengths, middle = self.backbone_lengths(coordinates), self.backbone_lengths(self.straight)
        away = lengths - middle
        room = np.where(away > 0.0, self._limits[1] - middle, middle - self._limits[0])
        with np.errstate(divide='ignore'):
            share = float(np.min(room / np.abs(away), initial=1.0, where=away != 0.0))
        return coordinates if share >= 1.0 else self.straight + share * (coordinates - self.straight)

    def backbone_lengths(self, coordinates: FloatArray) -> FloatArray:
        """Lengths of the driven backbones by these coordinates, (n,), m."""
        each = coordinates.reshape(-1, 3)
        return self._backbones.backbones(each[:, 2], each[:, :2])

    def nearest(self, target: ArrayLike, start: ArrayLike | None = None) -> Reached:
        """The nearest that the tip comes to a point.

        One segment has the inverse in closed form (Hughes et al., sec. 3); where limits forbid it, the nearest point
        lies on a limit. Several segments are solved by damped least squares within the limits.

        Parameters
        ----------
        target : (3,)
            in B, m.
        start : (3 m,)
            coordinates to start from; of several that reach it, one nearby is found.
        """
        target = np.asarray(target, dtype=float)
        if len(self._rest) == 1:
            q = self._nearest_of_one(target)
        else:
            q = self._solve(target, self.within(self.straight if start is None else start))
            for other in (self.straight, *self._bent(target)):
                if np.linalg.norm(self.tip(q) - target) < 10.0 * _EXACT:
                    break
                found = self._solve(target, self.within(other))
                q = min(q, found, key=lambda c: float(np.linalg.norm(self.tip(c) - target)))
        point = self.tip(q)
        return Reached(q, point, float(np.linalg.norm(point - target)))

    def _nearest_of_one(self, target: FloatArray) -> FloatArray:
        try:
            arc = arc_to(target)
        except GeometryError:
            pass  # the origin, or straight behind it: on a limit
        else:
            inside = self.within(arc)
            if np.allclose(inside, arc, rtol=0.0, atol=1e-12):
                return arc
        # By symmetry in the plane of the axis and the target, on one of four edges.
        r, z = float(np.hypot(target[0], target[1])), float(target[2])
        toward = target[:2] / r if r > 0.0 else np.array([1.0, 0.0])
        shortest, longest, most = float(self._shortest[0]), float(self._longest[0]), self._bend_max
        box = np.array([[0.0, most], [shortest, longest]])
        best, least = np.array([0.0, shortest]), np.inf
        for axis, side in ((0, 1), (1, 0), (1, 1), (0, 0)):
            low, high = box[1 - axis]
            for _ in range(4):
                edge = np.empty((_EDGE, 2))
                edge[:, axis], edge[:, 1 - axis] = box[axis, side], np.linspace(low, high, _EDGE)
                theta, length = edge.T
                half = np.sinc(0.5 * theta / np.pi) * length  # the chord
                gap = np.hypot(half * np.sin(0.5 * theta) - r, half * np.cos(0.5 * theta) - z)
                k = int(np.argmin(gap))
                step = (high - low) / (_EDGE - 1)
                middle = edge[k, 1 - axis]
                low, high = max(low, middle - step), min(high, middle + step)
            if gap[k] < least:
                best, least = edge[k].copy(), float(gap[k])
        return self.within(np.array([*(best[0] * toward), best[1]]))

    def _bent(self, target: FloatArray) -> list[FloatArray]:
        """Shapes to start from where straight leads nowhere: bent to and fro in the plane of the target."""
        r, m = float(np.hypot(target[0], target[1])), len(self._rest)
        toward = target[:2] / r if r > 1e-6 else np.array([1.0, 0.0])
        starts = []
        for to, fro in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
            q = self.straight.copy().reshape(-1, 3)
            share = np.where(np.arange(m) < m / 2, to, fro)
            q[:, :2] = 0.7 * self._bend_max * share[:, None] * toward
            starts.append(q.ravel())
        return starts

    def _solve(self, target: FloatArray, q: FloatArray) -> FloatArray:
        """Levenberg–Marquardt, with each step put back within the limits."""
        damping, gap = 1e-3, target - self.tip(q)
        free = np.ones(len(q))
        for _ in range(_ROUNDS):
            if gap @ gap < _EXACT**2:
                break
            J = self.tip_jacobian(q) * self.scale * free
            step = self.scale * free * (J.T @ np.linalg.solve(J @ J.T + damping**2 * np.eye(3), gap))
            tried = self.within(q + step)
            better = target - self.tip(tried)
            if better @ better < gap @ gap * (1.0 - 1e-9):
                # What stays at its limit is left out of the next step, so that the others make up for it.
                held = (np.abs(tried - q) < 1e-12 * self.scale) & (np.abs(step) > 1e-9 * self.scale)
                q, gap, damping, free = tried, better, damping / 3.0, np.where(held, 0.0, 1.0)
            elif (free < 1.0).any():
                free = np.ones(len(q))
                damping *= 2.0
            else:
                damping *= 4.0
                if damping > 1e3:
                    break
        return q


def damped_inverse(J: FloatArray, scale: FloatArray, damping: float) -> FloatArray:
    """Damped least-squares inverse, (n, 3), of a Jacobian, (3, n), in coordinates of this scale, (n,); damping in m."""
    scaled: Any = J * scale
    return scale[:, None] * np.linalg.solve(scaled @ scaled.T + damping**2 * np.eye(len(J)), scaled).T
