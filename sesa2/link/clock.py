"""The board's clock in terms of the host's: stamps of measurements without the jitter of their arrival.

A packet arrives late by what the serial line, the USB stack and the scheduler make of it: always late, never
early. So the points (board time, arrival) lie above a straight line, offset + (1 + drift) · board time, and the
fastest packets lie on it. Of all lines below the points, the one with the least sum of distances to them is the edge
of their lower convex hull under their mean (Zhang, Liu, Xia: Clock synchronization algorithms for network
measurements, INFOCOM 2002). That needs no model of the delays, and bursts of late packets do not move it. Here the
points are the fastest packets of each half second in the last minute. Until there are three seconds of them, the
drift is taken as 0.
"""

import time
from collections import deque
from typing import NamedTuple

from sesa2.time import NS

_WRAP = 1 << 32
_BUCKET_NS = 500_000_000
_BUCKETS = 120
_BUCKETS_FOR_DRIFT = 6
_LARGEST_DRIFT = 0.01  # a ceramic resonator stays within 0.5 %
_AHEAD_NS = 100_000_000  # a packet this much before its time: one of the two clocks was stepped
_BEHIND_NS = NS  # and this much behind it, for so long
_PATIENCE_NS = 2 * NS


class _Point(NamedTuple):
    board_ns: int
    excess_ns: int
    """Arrival − board time."""


class BoardClock:
    """Maps the board's microseconds to the host's nanoseconds.

    Stamps are strictly monotonic, and two of them never lie closer than half of what lies between them on the board's
    clock, so that sweeps do not overlap when the line moves.

    Attributes
    ----------
    jumps
        Times that one of the clocks jumped, which made the line start anew.
    """

    def __init__(self) -> None:
        self.jumps = 0
        self._last_stamp_ns: int | None = None
        self.restart()

    def stamp(self, t_us: int, arrival_ns: int) -> int:
        """Host time of a board time, ns.

        Parameters
        ----------
        t_us
            Board clock, µs modulo 2³².
        arrival_ns
            Host clock, ns, when the packet had arrived, less what the packet is known to take on its way. It
            must be a steady clock (`time.monotonic_ns`): a step is survived, but followed only forwards.
        """
        passed_ns = self._advance(t_us)
        if passed_ns is None:
            self.jumps += 1
            self.restart()
            passed_ns = self._advance(t_us) or 0
        late_ns = arrival_ns - self._line(self._board_ns)
        if self._jumped(late_ns, arrival_ns):
            self.jumps += 1
            self.restart()
            self._advance(t_us)
        self._learn(arrival_ns)
        stamp = self._line(self._board_ns)
        if self._last_stamp_ns is not None:
            stamp = max(stamp, self._last_stamp_ns + max(1, passed_ns // 2))
        self._last_stamp_ns = stamp
        return stamp

    def restart(self) -> None:
        """Forget the line, since the board was reset or the link was down; stamps stay monotonic."""
        self._t_us: int | None = None
        self._board_ns = 0
        self._offset_ns: float | None = None
        self._drift = 0.0
        self._points: deque[_Point] = deque(maxlen=_BUCKETS)
        self._fastest: _Point | None = None
        self._bucket_ends_ns = _BUCKET_NS
        self._behind_since_ns: int | None = None

    def _advance(self, t_us: int) -> int | None:
        """Take the board's clock on, through its wrap; what has passed, ns, or None if it went back."""
        passed_us = 0 if self._t_us is None else (t_us - self._t_us) % _WRAP
        if passed_us >= _WRAP // 2:
            return None
        self._t_us = t_us
        self._board_ns += passed_us * 1000
        return passed_us * 1000

    def _line(self, board_ns: int) -> int:
        offset_ns = self._offset_ns if self._offset_ns is not None else 0.0
        return board_ns + round(offset_ns + self._drift * board_ns)

    def _jumped(self, late_ns: int, arrival_ns: int) -> bool:
        if self._offset_ns is None:
            return False
        if late_ns < -_AHEAD_NS:
            return True
        if late_ns < _BEHIND_NS:
            self._behind_since_ns = None
        elif self._behind_since_ns is None:
            self._behind_since_ns = arrival_ns
        else:
            # A reader that was held up finds late packets too, but it catches up.
            return arrival_ns - self._behind_since_ns > _PATIENCE_NS
        return False

    def _learn(self, arrival_ns: int) -> None:
        board_ns = self._board_ns
        if board_ns >= self._bucket_ends_ns and self._fastest:
            self._points.append(self._fastest)
            self._fit()
            self._fastest = None
            self._bucket_ends_ns = board_ns + _BUCKET_NS
        point = _Point(board_ns, arrival_ns - board_ns)
        if self._fastest is None or point.excess_ns < self._fastest.excess_ns:
            self._fastest = point
        # Nothing arrives before it was sent: a packet below the line takes the line down with it, at once.
        offset_ns = point.excess_ns - self._drift * board_ns
        if self._offset_ns is None or offset_ns < self._offset_ns:
            self._offset_ns = offset_ns

    def _fit(self) -> None:
        points = self._points
        if len(points) >= _BUCKETS_FOR_DRIFT:
            mean_ns = sum(point.board_ns for point in points) / len(points)
            hull = _lower_hull(points)
            edge = next(k for k in range(1, len(hull)) if hull[k].board_ns >= mean_ns)
            rise = hull[edge].excess_ns - hull[edge - 1].excess_ns
            run = hull[edge].board_ns - hull[edge - 1].board_ns
            self._drift = max(-_LARGEST_DRIFT, min(_LARGEST_DRIFT, rise / run))
        self._offset_ns = min(point.excess_ns - self._drift * point.board_ns for point in points)


def _lower_hull(points: deque[_Point]) -> list[_Point]:
    """Lower convex hull of points in ascending order (Andrew's monotone chain)."""
    hull: list[_Point] = []
    for point in points:
        while len(hull) > 1 and _turns_down(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    return hull


def _turns_down(a: _Point, b: _Point, c: _Point) -> bool:
    ab, ac = ((p.board_ns - a.board_ns, p.excess_ns - a.excess_ns) for p in (b, c))
    return ab[0] * ac[1] <= ac[0] * ab[1]


class WallClock:
    """The wall clock over the steady one: constant, but for the steps that somebody makes.

    Two clocks cannot be read at the same time, which would make every stamp jitter. Their difference is therefore
    held, and followed only when it has changed by more than a reading can be wrong.
    """

    def __init__(self) -> None:
        self.steps = 0
        self._held_ns = _difference_ns()

    def of(self, monotonic_ns: int) -> int:
        """Wall time, ns since 1970, of a time of `time.monotonic_ns`."""
        return monotonic_ns + self._held_ns

    def look(self) -> bool:
        """See whether the wall clock was stepped, and follow it; call it about once a second."""
        difference_ns = _difference_ns()
        stepped = abs(difference_ns - self._held_ns) > 1_000_000
        if stepped:
            self._held_ns = difference_ns
            self.steps += 1
        return stepped


def _difference_ns() -> int:
    """The closest of a few readings: between the two of a pair, the thread can be interrupted."""
    best = None
    for _ in range(5):
        before = time.monotonic_ns()
        wall = time.time_ns()
        after = time.monotonic_ns()
        if best is None or after - before < best[0]:
            best = after - before, wall - (before + after) // 2
    assert best is not None
    return best[1]
