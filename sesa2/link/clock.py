"""The board's clock in terms of the host's: stamps of measurements without the jitter of their arrival.

A packet arrives late by what the serial line, the USB stack and the scheduler make of it: always late, never
early. So the points (board time, arrival) lie above a straight line, offset + (1 + drift) · board time, and the
fastest packets lie on it. Of all lines below the points, the one with the least sum of distances to them is the edge
of their lower convex hull under their mean (Zhang, Liu, Xia: Clock synchronization algorithms for network
measurements, INFOCOM 2002). That needs no model of the delays, and bursts of late packets do not move it. Here the
points are the fastest packets of each half second in the last minute. Until there are three seconds of them, the
drift is what it was before, at first 0.

A packet before its time, or with a time before its predecessor's, is damaged, or one of the clocks was stepped. One
is not believed, three in a row are. A packet behind its time is late, or one of the clocks was stepped: a reader that
was held up catches up, so it was a step when for a second nothing came nearer to its time. The line is then moved by
the step; the drift, which is the resonator's, stays.
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
_EARLY_NS = 1_000_000  # by so much, and by what drift may make of the time, one packet takes the line down
_WITNESSES = 3  # so many packets in a row are believed whatever they say
_STEP_NS = 50_000_000  # what is less is delay, not a step of a clock
_PATIENCE_NS = NS
_LATE_PACKETS = 5
_SHORTEST_PERIOD_NS = 10_000_000  # of sweeps; what lies between two before that is known
LONGEST_HOLD_NS = 900_000_000
"""Stamps that are ahead by no more wait for the time, at half its pace and so for less than two seconds."""


class _Point(NamedTuple):
    board_ns: int
    excess_ns: int
    """Arrival − board time."""

    @property
    def arrival_ns(self) -> int:
        return self.board_ns + self.excess_ns


class BoardClock:
    """Maps the board's microseconds to the host's nanoseconds.

    Stamps are strictly monotonic, and two of them never lie closer than half of what lies between them on the board's
    clock, so that sweeps do not overlap when the line moves. Only when a clock was stepped and stamps would have to
    wait for longer than 0.9 s do they go back.

    Attributes
    ----------
    jumps
        Times that one of the clocks was stepped, as far as is known.
    doubted
        Packets whose time was not believed; they are stamped by their arrival.
    """

    def __init__(self) -> None:
        self.jumps = self.doubted = 0
        self._last_stamp_ns: int | None = None
        self._drift = 0.0
        self._passed_ns = _SHORTEST_PERIOD_NS
        self.restart()

    def restart(self) -> None:
        """Forget the line, since the board was reset or the link was down; stamps stay monotonic."""
        self._t_us: int | None = None
        self._arrival_ns = 0
        self._board_ns = 0
        self._offset_ns: float | None = None
        self._points: deque[_Point] = deque(maxlen=_BUCKETS)
        self._fastest: _Point | None = None
        self._bucket_ends_ns = _BUCKET_NS
        self._early: deque[_Point] = deque(maxlen=_WITNESSES)
        self._behind: _Point | None = None
        self._first_behind = _Point(0, 0)
        self._n_behind = 0

    def stamp(self, t_us: int, arrival_ns: int) -> int:
        """Host time of a board time, ns.

        Parameters
        ----------
        t_us
            Board clock, µs modulo 2³².
        arrival_ns
            Host clock (`steady_ns`), ns, when the packet had arrived, less what the packet is known to take on its
            way.
        """
        if self._t_us is None:
            self._t_us, self._arrival_ns = t_us, arrival_ns
        # A damaged packet or a stepped clock lets time go back.
        passed_ns = 1000 * ((t_us - self._t_us + _WRAP // 2) % _WRAP - _WRAP // 2)
        elapsed_ns = max(0, arrival_ns - self._arrival_ns)
        usual_ns = min(abs(passed_ns), self._passed_ns)
        board_ns = self._board_ns + passed_ns
        point = _Point(board_ns, arrival_ns - board_ns)
        if self._offset_ns is None:
            self._offset_ns = point.excess_ns - self._drift * board_ns
        if passed_ns < 0 or self._late(point) < -_EARLY_NS - _LARGEST_DRIFT * elapsed_ns:
            self._early.append(point)
            if len(self._early) < _WITNESSES:
                self.doubted += 1
                stamp_ns = self._line(self._board_ns) + elapsed_ns  # as late as its predecessor
                return self._ascending(
                    stamp_ns if passed_ns < 0 else min(stamp_ns, self._line(board_ns)), usual_ns
                )
            witness: _Point | None = sorted(self._early, key=self._late)[_WITNESSES // 2]
        else:
            self._early.clear()
            witness = self._lasting(point)
        if witness:
            point = self._follow(witness, point)
            passed_ns = usual_ns
        self._t_us, self._arrival_ns, self._board_ns = t_us, arrival_ns, point.board_ns
        self._passed_ns = passed_ns or self._passed_ns
        self._learn(point)
        return self._ascending(self._line(point.board_ns), passed_ns)

    def _line(self, board_ns: int) -> int:
        offset_ns = self._offset_ns if self._offset_ns is not None else 0.0
        return board_ns + round(offset_ns + self._drift * board_ns)

    def _late(self, point: _Point) -> int:
        return point.arrival_ns - self._line(point.board_ns)

    def _ascending(self, stamp_ns: int, passed_ns: int) -> int:
        """A stamp that keeps its distance from the last one, which was so long before on the board's clock."""
        if self._last_stamp_ns is not None:
            stamp_ns = max(stamp_ns, self._last_stamp_ns + max(1, passed_ns // 2))
        self._last_stamp_ns = stamp_ns
        return stamp_ns

    def _lasting(self, point: _Point) -> _Point | None:
        """The fastest packet of a second in which all were late and none was catching up, once it has passed."""
        if self._late(point) < _STEP_NS:
            self._behind = None
            return None
        if self._behind is None or point.excess_ns < self._first_behind.excess_ns - _STEP_NS:
            self._behind = self._first_behind = point
            self._n_behind = 0
        elif point.excess_ns < self._behind.excess_ns:
            self._behind = point
        self._n_behind += 1
        lasts = (
            point.arrival_ns - self._first_behind.arrival_ns >= _PATIENCE_NS
            and self._n_behind >= _LATE_PACKETS
        )
        return self._behind if lasts else None

    def _follow(self, witness: _Point, point: _Point) -> _Point:
        """Take the line to a witness; what is to be learned of the newest point, which alone takes no line down."""
        stepped = point.board_ns < self._board_ns or abs(self._late(witness)) >= _STEP_NS
        self.jumps += stepped
        self._offset_ns = witness.excess_ns - self._drift * witness.board_ns
        self._points.clear()
        self._fastest = self._behind = None
        self._bucket_ends_ns = point.board_ns + _BUCKET_NS
        self._early.clear()
        ahead_ns = 0 if self._last_stamp_ns is None else self._last_stamp_ns - self._line(point.board_ns)
        if stepped and ahead_ns > LONGEST_HOLD_NS:
            self._last_stamp_ns = None
        return _Point(point.board_ns, point.excess_ns + max(0, -self._late(point)))

    def _learn(self, point: _Point) -> None:
        board_ns = point.board_ns
        if board_ns >= self._bucket_ends_ns and self._fastest:
            self._points.append(self._fastest)
            self._fit()
            self._fastest = None
            self._bucket_ends_ns = board_ns + _BUCKET_NS
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


def steady_ns() -> int:
    """A host clock that nobody steps, ns; on Linux it goes on while the machine is suspended."""
    boottime = getattr(time, 'CLOCK_BOOTTIME', None)
    return time.monotonic_ns() if boottime is None else time.clock_gettime_ns(boottime)


class WallClock:
    """The wall clock over the steady one: constant, but for the steps that somebody makes.

    Two clocks cannot be read at the same time, which would make every stamp jitter. Their difference is therefore
    held, and followed only when it has changed by more than a reading can be wrong. A step back of up to 0.9 s is
    followed at half the pace of time, so that times keep their order.

    Attributes
    ----------
    steps
        Times that the wall clock was stepped.
    """

    def __init__(self) -> None:
        self.steps = 0
        self._difference_ns = self._held_ns = _difference_ns()
        self._latest_ns: int | None = None

    def of(self, at_ns: int) -> int:
        """Wall time, ns since 1970, of a time of `steady_ns`."""
        if self._held_ns > self._difference_ns and self._latest_ns is not None:
            passed_ns = max(0, at_ns - self._latest_ns)
            self._held_ns = max(self._difference_ns, self._held_ns - passed_ns // 2)
        self._latest_ns = at_ns
        return at_ns + self._held_ns

    def look(self) -> int:
        """See whether the wall clock was stepped, and follow it; by how much, ns. Call it about once a second."""
        difference_ns = _difference_ns()
        step_ns = difference_ns - self._difference_ns
        if abs(step_ns) <= 1_000_000:
            return 0
        self.steps += 1
        self._difference_ns = difference_ns
        if not 0 < self._held_ns - difference_ns <= LONGEST_HOLD_NS:
            self._held_ns = difference_ns
        return step_ns


def _difference_ns() -> int:
    """The closest of a few readings: between the two of a pair, the thread can be interrupted."""
    best = None
    for _ in range(5):
        before = steady_ns()
        wall = time.time_ns()
        after = steady_ns()
        if best is None or after - before < best[0]:
            best = after - before, wall - (before + after) // 2
    assert best is not None
    return best[1]
