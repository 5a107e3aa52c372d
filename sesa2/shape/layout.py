"""An arm and where its sensors sit on it."""

from dataclasses import dataclass

import numpy as np

from sesa2.shape.arm import Arm, GeometryError
from sesa2.shape.rotations import FloatArray


@dataclass(frozen=True)
class Layout:
    """Where what is measured is measured; a kind of sensor that is not there has no places.

    Attributes
    ----------
    arm
        the arm.
    imu_positions
        arc lengths of the IMUs, m, strictly increasing in (0, arm.length].
    """

    arm: Arm
    imu_positions: tuple[float, ...] = ()

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

    @property
    def n_imu(self) -> int:
        """Number of IMUs along the arm."""
        return len(self.imu_positions)

    @property
    def stations(self) -> FloatArray:
        """Arc lengths at which an orientation is known: the base, then the IMUs; (n_imu + 1,), m."""
        return np.array([0.0, *self.imu_positions])
