"""Segments one after the other: each bends in the frame that the one before it ends in."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.backbone import Backbone
from sesa2.shape.model import Kept
from sesa2.shape.rotations import FloatArray, multiply, to_matrix


@dataclass(frozen=True)
class Places(Generic[Kept]):
    """Where on the arm something is wanted, and what of that does not depend on the coordinates.

    The joints between segments, m − 1 of them, follow the n places that were asked for, so that one pass gives both.

    Attributes
    ----------
    n
        number of places that were asked for.
    section : (n + m − 1,)
        segment that each is in, from 0; a joint belongs to the segment that ends there.
    within
        per segment, which of the n are in it.
    beyond
        per segment, which of the n are in a later one.
    kept
        what the family keeps ready for them.
    """

    n: int
    section: np.ndarray
    within: list[np.ndarray | slice]
    beyond: list[np.ndarray | slice]
    kept: Kept


class Segments(ABC, Generic[Kept]):
    """The segments of one shape or a batch of shapes, each seen from its own base."""

    @abstractmethod
    def poses(self, places: Places[Kept]) -> tuple[FloatArray, FloatArray]:
        """Positions, batch + (n + m − 1, 3), m, and orientations, batch + (n + m − 1, 4), x y z w."""

    @abstractmethod
    def rates(self, places: Places[Kept]) -> FloatArray:
        """Their derivatives by the coordinates of the own segment, batch + (n + m − 1, 6, c): position, then turn."""


class SegmentChain(Backbone, Generic[Kept]):
    """The backbone that coordinates describe. Positions and orientations are in the base frame B.

    Parameters
    ----------
    segments
        m segments.
    coordinates
        number of coordinates of each, c.
    at
        gives the Places of arc lengths.
    """

    def __init__(self, segments: Segments[Kept], coordinates: int, at: Callable[[ArrayLike], Places[Kept]]):
        self._segments = segments
        self._coordinates = coordinates
        self._at = at
        self._last: tuple[Places[Kept], FloatArray, FloatArray, FloatArray] | None = None

    def positions(self, s: ArrayLike) -> FloatArray:
        """See Backbone; at material arc lengths, in B."""
        places, positions, _, _ = self._chained(s)
        return positions[..., : places.n, :].copy()

    def orientations(self, s: ArrayLike) -> FloatArray:
        """See Backbone; at material arc lengths, q_BL."""
        places, _, own, _ = self._chained(s)
        n, joints = places.n, len(places.section) - places.n
        if not joints:
            return own[..., :n, :].copy()
        turns = np.zeros((*own.shape[:-2], joints + 1, 4))
        turns[..., 0, 3] = 1.0
        for k in range(joints):
            turns[..., k + 1, :] = multiply(turns[..., k, :], own[..., n + k, :])
        return multiply(turns.take(places.section[:n], axis=-2), own[..., :n, :])

    def matrices(self, s: ArrayLike) -> FloatArray:
        """Orientations as rotation matrices, batch + (n, 3, 3): cheaper than these of quaternions, beside positions."""
        places, _, own, frames = self._chained(s)
        there = to_matrix(own[..., : places.n, :])
        return frames.take(places.section[: places.n], axis=-3) @ there if frames.shape[-3] > 1 else there

    def jacobian(self, s: ArrayLike) -> FloatArray:
        """Derivatives of the poses by the coordinates.

        Parameters
        ----------
        s : (n,)
            material arc lengths, m.

        Returns
        -------
        batch + (n, 6, m c). Rows 0–2: position in B, m per unit of the coordinate. Rows 3–5: rotation vector w in B,
        dR = [w]ₓ R, rad per unit.

        Raises
        ------
        GeometryError
            an arc length is not on the arm.
        """
        places, positions, _, frames = self._chained(s)
        n, (*batch, m, _, _) = places.n, frames.shape
        rates = self._segments.rates(places)
        if m > 1:
            turn = frames.take(places.section, axis=-3)[..., None, :, :]
            halves = rates.reshape(*rates.shape[:-2], 2, 3, self._coordinates)
            rates = (turn @ halves).reshape(rates.shape)
        out = np.zeros((*batch, n, 6, m, self._coordinates))
        for k in range(m):
            own = out[..., k, :]
            own[..., places.within[k], :, :] = rates[..., places.within[k], :, :]
            if k < m - 1:
                # What comes after a segment is carried along by its end: dp = dp_end + w × (p − p_end).
                end = rates[..., n + k, None, :, :]
                lever = positions[..., places.beyond[k], :] - positions[..., n + k, None, :]
                x, y, z = (lever[..., i, None] for i in range(3))
                wx, wy, wz = (end[..., i, :] for i in (3, 4, 5))
                carried = np.empty((*lever.shape[:-1], 6, self._coordinates))
                carried[...] = end
                carried[..., 0, :] += wy * z - wz * y
                carried[..., 1, :] += wz * x - wx * z
                carried[..., 2, :] += wx * y - wy * x
                own[..., places.beyond[k], :, :] = carried
        return out.reshape(*batch, n, 6, m * self._coordinates)

    def _chained(self, s: ArrayLike) -> tuple[Places[Kept], FloatArray, FloatArray, FloatArray]:
        """Places, their positions in B, orientations against their segments' bases, and these, batch + (m, 3, 3), in B.

        The last answer is kept: who wants positions mostly wants orientations or the Jacobian there, too.
        """
        places = self._at(s)
        if self._last is None or self._last[0] is not places:
            self._last = (places, *self._chain(places))
        return self._last

    def _chain(self, places: Places[Kept]) -> tuple[FloatArray, FloatArray, FloatArray]:
        positions, orientations = self._segments.poses(places)
        n, joints, batch = places.n, len(places.section) - places.n, positions.shape[:-2]
        starts, frames = np.zeros((*batch, joints + 1, 3)), np.empty((*batch, joints + 1, 3, 3))
        frames[..., 0, :, :] = np.eye(3)
        if not joints:
            return positions, orientations, frames
        ends = to_matrix(orientations[..., n:, :])
        for k in range(joints):
            step = frames[..., k, :, :] @ positions[..., n + k, :, None]
            starts[..., k + 1, :] = starts[..., k, :] + step[..., 0]
            frames[..., k + 1, :, :] = frames[..., k, :, :] @ ends[..., k, :, :]
        section = places.section
        local = frames.take(section, axis=-3) @ positions[..., None]
        positions = starts.take(section, axis=-2) + local[..., 0]
        return positions, orientations, frames
