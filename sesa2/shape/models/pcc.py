"""The PCC-extended rigid-body model: constant curvature between IMUs, cut into straight links (paper II-B, eq. 3–7)."""

from collections.abc import Sequence

import numpy as np

from sesa2.shape.arm import Arm, GeometryError
from sesa2.shape.chain import ChainModel
from sesa2.shape.model import with_base
from sesa2.shape.rotations import FloatArray, slerp_along


class Pcc(ChainModel):
    """Each section between stations (the base, then the IMUs) as straight links of equal length.

    Link k of the n of a section is oriented as slerp at (2k + 1) / 2n (eq. 3). Past the last IMU one more link goes
    straight on.

    Parameters
    ----------
    arm
        the arm.
    segments
        links of each section, one number per IMU, each at least 1.
    """

    name = 'pcc'

    def __init__(self, arm: Arm, segments: Sequence[int]):
        stations = arm.stations
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
        self._goes_on = arm.length > stations[-1]
        super().__init__(arm, [*ends, arm.length] if self._goes_on else ends)
        self._section = np.repeat(np.arange(sections), segments)
        self._fraction = np.concatenate([(2.0 * np.arange(n) + 1.0) / (2.0 * n) for n in segments])

    def _orient_links(self, orientations: FloatArray, base: FloatArray) -> FloatArray:
        stations = with_base(orientations, base)
        links = slerp_along(stations, self._section, self._fraction)
        return np.concatenate([links, orientations[..., -1:, :]], axis=-2) if self._goes_on else links
