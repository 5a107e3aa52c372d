"""A backbone that is a smooth curve; on the ROS graph straight links of equal arc length stand for it."""

import numpy as np

from sesa2.shape.arm import Arm, GeometryError
from sesa2.shape.model import Model
from sesa2.shape.rotations import FloatArray


class CurveModel(Model):
    """A model whose backbone is a curve; its links are oriented as it is at their middles, so that the chain that they
    make agrees with the curve as 1/links².
    """

    def __init__(self, arm: Arm, links: int = 64):
        if links < 1:
            raise GeometryError(f'links = {links}, expected at least 1')
        super().__init__(arm, np.linspace(0.0, arm.length, links + 1))

    def _sections(self, s: FloatArray) -> tuple[np.ndarray, FloatArray]:
        """Section that each s is in, (n,), 0 before the first IMU, and the fraction of it that lies before s, (n,).

        Past the last IMU: the last section, and a fraction above 1.
        """
        self.arm.check_on_arm(s)
        stations = self.arm.stations
        section = np.searchsorted(stations[1:-1], s, side='left')
        return section, (s - stations[section]) / np.diff(stations)[section]
