"""The PCC-extended rigid-body model: constant curvature between IMUs, cut into straight links (paper II-B, eq. 3–7)."""

from dataclasses import dataclass, replace

import numpy as np

from sesa2.shape.arm import GeometryError
from sesa2.shape.chain import ChainModel
from sesa2.shape.layout import Layout
from sesa2.shape.options import REQUIRED, ModelOptions, parameter
from sesa2.shape.rotations import FloatArray, SlerpPlaces, slerp_along

_LINKS_OF_A_SECTION = 2


@dataclass(frozen=True)
class PccOptions(ModelOptions):
    """Options of the model `pcc`.

    Attributes
    ----------
    segments
        links of each section, one number per IMU, each at least 1.
    """

    segments: tuple[int, ...] = parameter(
        REQUIRED, 'number of links of each section, one per IMU', low=1, high=1000
    )

    def filled(self, n_imu: int) -> 'PccOptions':
        """Two links of each section where nothing was said."""
        return self if self.segments else replace(self, segments=(_LINKS_OF_A_SECTION,) * n_imu)


class Pcc(ChainModel):
    """Each section between stations (the base, then the IMUs) as straight links of equal length.

    Link k of the n of a section is oriented as slerp at (2k + 1) / 2n (eq. 3). Past the last IMU one more link goes
    straight on.
    """

    name = 'pcc'
    Options = PccOptions

    def __init__(self, layout: Layout, options: PccOptions):
        super().__init__(layout, options)
        segments, stations, length = options.segments, layout.stations, layout.arm.length
        sections = len(stations) - 1
        if len(segments) != sections:
            raise GeometryError(
                f'segments has {len(segments)} entries, expected {sections}: one per section, and each ends at an IMU'
            )
        for i, n in enumerate(segments):
            if n < 1:
                raise GeometryError(f'segments[{i}] = {n}, expected at least 1')
        ends = [0.0]
        for i, n in enumerate(segments):
            ends.extend(stations[i] + (stations[i + 1] - stations[i]) * np.arange(1, n + 1) / n)
        section = np.repeat(np.arange(sections), segments)
        fraction = np.concatenate([(2.0 * np.arange(n) + 1.0) / (2.0 * n) for n in segments])
        if length > stations[-1]:
            ends.append(length)
            section, fraction = np.append(section, sections - 1), np.append(fraction, 1.0)
        self._middles = SlerpPlaces(section, fraction)
        self._set_link_ends(ends)

    def _orient_links(self, stations: FloatArray) -> FloatArray:
        return slerp_along(stations, self._middles)
