"""An arm and where its sensors sit on it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sesa2.shape.arm import Arm, GeometryError
from sesa2.shape.rotations import FloatArray

# How far the segments together may be from the arm, m: what numbers of a file are rounded to.
SEGMENTS_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Layout:
    """Where what is measured is measured; a kind of sensor that is not there has no places.

    Attributes
    ----------
    arm
        the arm.
    imu_positions
        arc lengths of the IMUs, m, strictly increasing in (0, arm.length].
    segment_lengths
        lengths of the segments at rest, base to tip, m; empty where nobody says where segments end.
    stretches
        whether the present lengths of the segments are measured.
    bend_max
        largest bend of a segment, rad.
    stretch_limits
        least and largest length of a segment, in parts of that at rest.
    n_magnetometers
        number of magnetometers.
    readings
        makes the ReadingPredictor of the magnetometers for shapes within CoordinateLimits; None where there are none.
    backbone_radii
        of each segment, m, the mean distance from its axis of the backbones that tell its length and its bend; 0 where
        none do.
    """

    arm: Arm
    imu_positions: tuple[float, ...] = ()
    segment_lengths: tuple[float, ...] = ()
    stretches: bool = False
    bend_max: float = 1.6
    stretch_limits: tuple[float, ...] = (0.5, 1.5)
    n_magnetometers: int = 0
    readings: Callable[[Any], Any] | None = None
    backbone_radii: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        before = 0.0
        for i, s in enumerate(self.imu_positions):
            if not s > before:
                where = 'the base' if i == 0 else f'{before} m'
                raise GeometryError(f'imu_positions[{i}] = {s} m is not after {where}')
            before = s
        if before > self.arm.length:
            raise GeometryError(
                f'imu_positions[{self.n_imu - 1}] = {before} m is beyond the tip at {self.arm.length} m'
            )
        for i, length in enumerate(self.segment_lengths):
            if not length > 0.0:
                raise GeometryError(f'segment_lengths[{i}] = {length} m, expected a positive number')
        total = sum(self.segment_lengths)
        if self.segment_lengths and abs(total - self.arm.length) > SEGMENTS_TOLERANCE:
            raise GeometryError(
                f'segment_lengths add up to {total} m, expected the length of the arm, {self.arm.length} m'
            )
        if self.stretches and not self.segment_lengths:
            raise GeometryError('segment_lengths is empty, an arm that stretches needs at least one segment')

    @property
    def n_imu(self) -> int:
        """Number of IMUs along the arm."""
        return len(self.imu_positions)

    @property
    def stations(self) -> FloatArray:
        """Arc lengths at which an orientation is known: the base, then the IMUs; (n_imu + 1,), m."""
        return np.array([0.0, *self.imu_positions])

    @property
    def segment_ends(self) -> FloatArray:
        """Arc lengths at which the segments begin and end, base to tip, (n_segments + 1,), m; the last is the tip."""
        ends = np.array([0.0, *np.cumsum(self.segment_lengths)])
        ends[-1] = self.arm.length if self.segment_lengths else 0.0
        return ends

    @property
    def rest_lengths(self) -> FloatArray | None:
        """Lengths of the segments at rest, as if measured, (n_segments,), m; None where none are measured."""
        return np.array(self.segment_lengths) if self.stretches else None
