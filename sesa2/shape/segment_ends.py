"""Which IMUs feel the ends of an arm's segments, and which are between them."""

from typing import NamedTuple

import numpy as np

from sesa2.shape.layout import Layout
from sesa2.shape.rotations import FloatArray, SlerpPlaces, slerp_along

# An IMU as near as this to an end of a segment, m, feels it.
FELT_WITHIN = 0.005 + 1e-9


class InnerImu(NamedTuple):
    """An IMU between the ends of a segment: number of the segment and station, from 0, and where in the segment."""

    segment: int
    station: int
    fraction: float


class SegmentEnds:
    """The segments of a layout; where it has none each section between its stations is one, and what is past the last.

    An end that no IMU feels is interpolated between its neighbours; past the last IMU the orientation is held.

    Parameters
    ----------
    layout
        with at least one IMU.

    Attributes
    ----------
    lengths : (m,)
        of the segments at rest, m.
    inner
        the IMUs between ends.
    doubts
        of what is interpolated or not used, for people.
    """

    def __init__(self, layout: Layout):
        stations = layout.stations
        sections = len(stations) - 1
        if layout.segment_lengths:
            ends = layout.segment_ends
        else:
            ends = stations if stations[-1] == layout.arm.length else np.append(stations, layout.arm.length)
        self.lengths = np.diff(ends)
        before = np.clip(np.searchsorted(stations, ends, side='right') - 1, 0, sections - 1)
        fraction = np.clip((ends - stations[before]) / np.diff(stations)[before], 0.0, 1.0)
        doubts = []
        felt = [0]
        for k, end in enumerate(ends[1:], start=1):
            nearest = 1 + int(np.argmin(np.abs(stations[1:] - end)))
            if abs(stations[nearest] - end) <= FELT_WITHIN:
                felt.append(nearest)
                before[k], fraction[k] = nearest - 1, 1.0
            elif layout.segment_lengths:
                how = 'interpolated' if end < stations[-1] else 'taken as straight past the last IMU'
                doubts.append(
                    f'segment {k} ends at {end:g} m, where no IMU is (the nearest is at {stations[nearest]:g} m): {how}'
                )
        self._places = SlerpPlaces(before, fraction)
        self._whole = before + fraction.astype(int) if np.isin(fraction, (0.0, 1.0)).all() else None
        inner = []
        for i, s in enumerate(stations):
            k = int(np.searchsorted(ends[1:-1], s, side='left'))
            if s <= FELT_WITHIN and i:
                doubts.append(f'the IMU at {s:g} m is at the base of segment 1 and is not used')
            elif i not in felt and layout.segment_lengths:
                inner.append(InnerImu(k, i, float((s - ends[k]) / self.lengths[k])))
        self.inner, self.doubts = tuple(inner), tuple(doubts)

    def orientations(self, stations: FloatArray) -> FloatArray:
        """Of the base and the segments' ends, batch + (m + 1, 4), of those of the stations, batch + (n_imu + 1, 4)."""
        if self._whole is None:
            return slerp_along(stations, self._places)
        if len(self._whole) == stations.shape[-2]:
            return stations
        return stations.take(self._whole, axis=-2)
