"""The arm as the models see it: a length and the places of the IMUs."""

from dataclasses import dataclass

import numpy as np

from sesa2.errors import Sesa2Error
from sesa2.shape.rotations import FloatArray


class GeometryError(Sesa2Error):
    """An arm, a link or an arc length that cannot be."""


@dataclass(frozen=True)
class Arm:
    """An arm clamped at its base, arc length 0.

    Attributes
    ----------
    length
        arc length of the tip, m.
    imu_positions
        arc lengths of the IMUs, m, strictly increasing in (0, length].
    """

    length: float
    imu_positions: tuple[float, ...]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.length) and self.length > 0.0):
            raise GeometryError(f'length = {self.length} m, expected a positive number')
        if not self.imu_positions:
            raise GeometryError('imu_positions is empty, expected at least one IMU')
        before = 0.0
        for i, s in enumerate(self.imu_positions):
            if not s > before:
                where = 'the base' if i == 0 else f'{before} m'
                raise GeometryError(f'imu_positions[{i}] = {s} m is not after {where}')
            before = s
        if before > self.length:
            raise GeometryError(
                f'imu_positions[{len(self.imu_positions) - 1}] = {before} m is beyond the tip at {self.length} m'
            )

    @property
    def stations(self) -> FloatArray:
        """Arc lengths at which an orientation is known: the base, then the IMUs; (n_imu + 1,), m."""
        return np.array([0.0, *self.imu_positions])

    def check_on_arm(self, s: FloatArray) -> None:
        """Refuse arc lengths that are not on the arm.

        Parameters
        ----------
        s : (n,)
            m.

        Raises
        ------
        GeometryError
            one is negative, beyond the tip or not a number.
        """
        outside = ~((s >= 0.0) & (s <= self.length * (1.0 + 1e-12)))
        if outside.any():
            raise GeometryError(f'arc length {s[outside][0]} m is not on the arm, 0 to {self.length} m')
