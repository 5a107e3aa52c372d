"""A backbone that is a smooth curve; on the ROS graph straight links of equal arc length stand for it."""

import numpy as np

from sesa2.shape.arm import GeometryError
from sesa2.shape.layout import Layout
from sesa2.shape.model import Kept, Model
from sesa2.shape.options import LinkOptions
from sesa2.shape.rotations import FloatArray


class CurveModel(Model[Kept]):
    """A model whose backbone is a curve; its links are oriented as it is at their middles, so that the chain that they
    make agrees with the curve as 1/links².
    """

    Options = LinkOptions

    def __init__(self, layout: Layout, options: LinkOptions):
        if options.links < 1:
            raise GeometryError(f'links = {options.links}, expected at least 1')
        super().__init__(layout, options)
        self._set_link_ends(np.linspace(0.0, layout.arm.length, options.links + 1))

    def _sections(self, s: FloatArray) -> tuple[np.ndarray, FloatArray]:
        """Section that each s is in, (n,), 0 before the first IMU, and the fraction of it that lies before s, (n,).

        Past the last IMU: the last section, and a fraction above 1.
        """
        stations = self.layout.stations
        section = np.searchsorted(stations[1:-1], s, side='left')
        return section, (s - stations[section]) / np.diff(stations)[section]
