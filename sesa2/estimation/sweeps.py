"""Single samples of the IMUs put together into sweeps, by the samples' own stamps and the clock of their arrival.

Over a network a topic's messages may come in bursts, long after those of other topics that were measured later. So
stamps alone do not tell that an IMU is silent: where there is a clock, a sweep waits until it says so too. What it may
cost is a pause when an IMU dies; no sweep is lost by it, and none is given twice or out of order.
"""

import math
from collections import Counter, deque
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from sesa2.estimation.arrivals import Arrivals
from sesa2.estimation.rounds import whole_rounds
from sesa2.estimation.time_steps import AHEAD_NS, BACK_NS, HeldSample, TimeSteps, step_in_words
from sesa2.shape.rotations import FloatArray, slerp
from sesa2.time import NS

# The chip's own rounding leaves norms within 2e-4 of 1.
NORM_TOLERANCE = 0.02
# The gyroscope's range is 2000°/s = 35 rad/s: a faster turn is a damaged sample. The constant part lets stamps jitter.
MAX_TURN_RATE = 35.0
TURN_SLACK = 0.5
# At the start, and after a pause of all, the topics come one after another: for so long no sweep is made of a few.
_RESUMING_NS = NS
# Why samples are not used.
NO_BASE = 'of a sweep without the orientation of the base'
# Of one IMU; with more that wait, whoever is missing is silent whatever the clock says.
WAITING_MAX = 10_000

Quaternion = tuple[float, float, float, float]


class Sweep(NamedTuple):
    """One instant of all IMUs.

    Attributes
    ----------
    stamp_ns
        time of the measurement, ns.
    orientations : (n_imu, 4)
        q_WS, x y z w, unit norm; what stands at an IMU that has not measured means nothing.
    measured : (n_imu,)
        true where the IMU has measured.
    base : (4,) or None
        q_WS of the IMU on the base, where there is one.
    """

    stamp_ns: int
    orientations: FloatArray
    measured: np.ndarray
    base: FloatArray | None


class _Waiting(NamedTuple):
    """A sample that waits for its sweep; arrival on the clock, ns."""

    stamp_ns: int
    q: Quaternion
    arrival_ns: int


class _Imu:
    """What is known of one IMU: the samples that wait for a sweep, and the last that went into one."""

    __slots__ = ('alive', 'heard_ns', 'last', 'last_ns', 'unusable_ns', 'used', 'used_ns', 'waiting')

    def __init__(self) -> None:
        self.waiting: deque[_Waiting] = deque()
        self.forget()

    def forget(self) -> None:
        self.alive = True
        self.waiting.clear()
        self.last: Quaternion | None = None
        self.used: Quaternion | None = None
        self.last_ns = self.used_ns = self.heard_ns = self.unusable_ns = 0

    def use(self) -> None:
        """Take the first waiting sample."""
        self.used_ns, self.used, _ = self.waiting.popleft()


class SweepAssembler:
    """Gives a sweep when every living IMU has a newer sample, or when it is known that one is silent.

    An IMU is silent when a sample of the sweep is older than the newest of all by the timeout, and has been there, by
    the clock, for longer than a message may be on its way (`Arrivals`), without a word of that IMU meanwhile. It is
    not waited for until it is heard again. Where samples come without a time of arrival, stamps alone decide. Where an
    IMU's own samples show that it was silent in between, the sweeps in between do without it.

    Sweeps leave in order of their stamps. Samples that cannot be used are counted in `dropped`, by reason. Between IMUs
    samples may arrive in any order.

    Parameters
    ----------
    enabled
        for each IMU, whether it is used.
    has_base
        whether another IMU, of index n_imu, sits on the base. Without it there is no sweep, but for gaps within the
        timeout.
    timeout : s
        by the samples' stamps.
    interpolate
        take all orientations at the stamp of the sweep's first sample, instead of as they come.
    latency : s
        taken off the stamps.
    patience : s
        how long, by the clock, a message may be on its way; None: arrivals teach it.

    Attributes
    ----------
    arrivals
        what the clock of arrival tells.
    dropped
        number of samples that no sweep could use, by reason.
    resets
        how often time stepped back.
    """

    def __init__(
        self,
        enabled: Sequence[bool],
        *,
        has_base: bool = False,
        timeout: float = 0.05,
        interpolate: bool = False,
        latency: float = 0.0,
        patience: float | None = None,
    ):
        self.n_imu = len(enabled)
        self._used = [*enabled, True] if has_base else list(enabled)
        self._has_base = has_base
        self._timeout_ns = round(timeout * NS)
        self._interpolate = interpolate
        self._latency_ns = round(latency * NS)
        self._imus = [_Imu() for _ in self._used]
        self.arrivals = Arrivals(len(self._used), patience, timeout)
        self._steps = TimeSteps()
        self.dropped: Counter[str] = Counter()
        self.resets = 0
        self.reset()

    def reset(self) -> None:
        """Forget all samples, as at the start of a recording."""
        for imu in self._imus:
            imu.forget()
        self.arrivals.reset()
        self._steps = TimeSteps()
        self._n_alive = sum(self._used)
        self._n_waiting = 0  # IMUs with a sample that waits; all of them are alive
        self._oldest_ns = 0  # stamp of the first sample that waits, and when it arrived
        self._since_ns = 0
        self.newest_ns: int | None = None  # of all samples of the present time
        self._closed_ns: int | None = None  # newest sample of the last sweep
        self._now_ns: int | None = None  # None where there is no clock

    def holds(self, index: int) -> bool:
        """Whether samples of an IMU are held, since their stamps are of another time than the rest."""
        return index in self._steps

    @property
    def holding(self) -> bool:
        """Whether samples of any IMU are held."""
        return len(self._steps) > 0

    @property
    def alive(self) -> list[bool]:
        """For each IMU (the base's last), whether sweeps wait for it."""
        return [imu.alive and used for imu, used in zip(self._imus, self._used, strict=True)]

    def add(
        self, index: int, stamp_ns: int, x: float, y: float, z: float, w: float, arrival_ns: int | None = None
    ) -> list[Sweep]:
        """Take one sample.

        Parameters
        ----------
        index
            of the IMU along the arm; n_imu is the IMU on the base.
        stamp_ns
            time of the measurement, ns.
        x, y, z, w
            the measured quaternion q_WS.
        arrival_ns
            when it arrived, ns of a clock that does not step; None where nobody knows.

        Returns
        -------
        The sweeps that are complete now, in order of time: mostly none or one; several after a burst. After a step
        back those of before it come first.
        """
        if not self._used[index]:
            return []
        stamp_ns -= self._latency_ns
        if arrival_ns is not None:
            self._now_ns = arrival_ns
            self.arrivals.observe(index, stamp_ns, arrival_ns)
        imu, newest_ns = self._imus[index], self.newest_ns
        if newest_ns is not None:
            if stamp_ns > newest_ns + AHEAD_NS:
                return self._hold(HeldSample(index, stamp_ns, x, y, z, w, arrival_ns))
            if imu.last is None:
                if stamp_ns < newest_ns - AHEAD_NS:
                    return self._hold(HeldSample(index, stamp_ns, x, y, z, w, arrival_ns))
            elif stamp_ns <= imu.last_ns:
                if imu.last_ns - stamp_ns > BACK_NS or index in self._steps:
                    return self._hold(HeldSample(index, stamp_ns, x, y, z, w, arrival_ns))
                self.dropped['not newer than the last of its IMU'] += 1
                return []
        if self._steps:
            self._let_go_of_held(self._steps.drop(index))
            self._steps.others_go_on()
        return self._take(imu, stamp_ns, x, y, z, w, arrival_ns)

    def add_many(
        self, indices: np.ndarray, stamps_ns: np.ndarray, orientations: FloatArray, arrivals_ns: np.ndarray
    ) -> tuple[list[Sweep], int]:
        """Take the samples up to the first that needs a second look, with the same result as one by one, but faster.

        Parameters
        ----------
        indices, stamps_ns, arrivals_ns : (n,) and orientations : (n, 4)
            as in `add`; all of IMUs that are used.

        Returns
        -------
        The sweeps, and how many samples were taken: mostly all or none.
        """
        imus = [index for index, used in enumerate(self._used) if used]
        m = len(imus)
        quiet = not (self._n_waiting or self._steps or self._interpolate) and self._n_alive == m
        if not quiet or len(indices) < 2 * m or any(self._imus[i].used is None for i in imus):
            return [], 0
        # The last round, which was taken one by one or here, is what the first of these is compared with.
        last = [self._imus[i] for i in indices[:m].tolist()]
        rounds = whole_rounds(
            np.concatenate([indices[:m], indices]),
            np.concatenate([[imu.last_ns for imu in last], stamps_ns - self._latency_ns]),
            np.concatenate([np.array([imu.last for imu in last]), orientations]),
            imus=imus,
            timeout_ns=min(self._timeout_ns, AHEAD_NS),
            norm_tolerance=NORM_TOLERANCE,
            turn_rate=MAX_TURN_RATE,
            turn_slack=TURN_SLACK,
        )
        if rounds is None or len(rounds.stamps_ns) < 2 or any(imu.used_ns != imu.last_ns for imu in last):
            return [], 0
        n = min(len(rounds.stamps_ns) - 1, self.arrivals.within_window(arrivals_ns) // m)
        if not n:
            return [], 0
        stamps, q = rounds.stamps_ns[1 : n + 1], rounds.orientations[1 : n + 1]
        order = rounds.indices.tolist()
        for place, index in enumerate(order):
            arrived = arrivals_ns[place : n * m : m]
            self.arrivals.observe_many(index, stamps[:, place], arrived)
            imu = self._imus[index]
            imu.last_ns = imu.used_ns = int(stamps[-1, place])
            imu.last = imu.used = tuple(q[-1, place].tolist())
            imu.heard_ns = int(arrived[-1])
        self._now_ns = int(arrivals_ns[n * m - 1])
        self.newest_ns = self._closed_ns = int(stamps[-1, -1])
        along = [place for place, index in enumerate(order) if index < self.n_imu]
        orientations = np.zeros((n, self.n_imu, 4))
        orientations[..., 3] = 1.0
        orientations[:, rounds.indices[along]] = q[:, along]
        measured = np.zeros((n, self.n_imu), dtype=bool)
        measured[:, rounds.indices[along]] = True
        bases = q[:, order.index(self.n_imu)] if self._has_base else [None] * n
        if not along:
            return [], n * m
        return list(map(Sweep, stamps[:, -1].tolist(), orientations, measured, bases)), n * m

    def close_overdue(self, arrival_ns: int) -> list[Sweep]:
        """Sweeps that need not wait any longer by the clock; to be asked for regularly, as samples may stop coming."""
        if self._now_ns is None or self.newest_ns is None:
            return []
        self._now_ns = max(self._now_ns, arrival_ns)
        return self._close()

    def flush(self) -> list[Sweep]:
        """Close the sweeps that wait for missing IMUs: at the end of a recording."""
        sweeps: list[Sweep] = []
        while self._n_waiting:
            self._give_up(self._silent(whatever_the_clock=True))
            sweeps += self._complete()
        return sweeps

    def _take(
        self, imu: _Imu, stamp_ns: int, x: float, y: float, z: float, w: float, arrival_ns: int | None
    ) -> list[Sweep]:
        """Take a sample of the present time."""
        q = self._usable(imu, stamp_ns, x, y, z, w)
        if q is None:
            imu.unusable_ns = stamp_ns
            return []
        imu.last, imu.last_ns = q, stamp_ns
        if self.newest_ns is None or stamp_ns > self.newest_ns:
            self.newest_ns = stamp_ns
        if self._closed_ns is not None and stamp_ns <= self._closed_ns:
            self.dropped['later than its sweep could wait'] += 1
            return []
        arrival_ns = 0 if arrival_ns is None else arrival_ns
        imu.heard_ns = arrival_ns
        if not imu.waiting:
            if not self._n_waiting or stamp_ns < self._oldest_ns:
                self._oldest_ns, self._since_ns = stamp_ns, arrival_ns
            self._n_waiting += 1
        imu.waiting.append(_Waiting(stamp_ns, q, arrival_ns))
        if not imu.alive:
            imu.alive = True
            self._n_alive += 1
        if self._n_waiting < self._n_alive and len(imu.waiting) > WAITING_MAX:
            self._give_up(self._silent(whatever_the_clock=True))
        return self._close()

    def _close(self) -> list[Sweep]:
        """The sweeps that are complete, or that are known to stay without an IMU."""
        sweeps: list[Sweep] = []
        assert self.newest_ns is not None
        while self._n_waiting:
            if self._n_waiting < self._n_alive:
                if self.newest_ns - self._oldest_ns <= self._timeout_ns or not (silent := self._silent()):
                    break
                self._give_up(silent)
            if self._n_waiting == self._n_alive:
                sweeps += self._complete()
        return sweeps

    def _silent(self, *, whatever_the_clock: bool = False) -> list[_Imu]:
        """Living IMUs of which no sample waits, and none has come for long enough, or one that is no measurement."""
        missing = [
            imu
            for imu, used in zip(self._imus, self._used, strict=True)
            if used and imu.alive and not imu.waiting
        ]
        if whatever_the_clock or self._now_ns is None:
            return missing
        long_ago = self._now_ns - self.arrivals.patience_ns
        waited = self._since_ns < long_ago
        return [
            imu
            for imu in missing
            if (waited and imu.heard_ns < long_ago) or imu.unusable_ns > self._oldest_ns
        ]

    def _give_up(self, silent: list[_Imu]) -> None:
        for imu in silent:
            imu.alive = False
            self._n_alive -= 1

    def _hold(self, sample: HeldSample) -> list[Sweep]:
        """Keep a sample of another time, and go over to that time if it is to be believed."""
        assert self.newest_ns is not None
        self._let_go_of_held(self._steps.hold(sample, self.newest_ns))
        held = self._steps.believed(
            sample.index, self.newest_ns, self._n_alive, begun=self._closed_ns is not None
        )
        if not held:
            return []
        sweeps: list[Sweep] = []
        if self._closed_ns is None:  # it began with a stamp of another time
            self._let_go_of_held([w for imu in self._imus for w in imu.waiting])
            self.reset()
        elif sample.stamp_ns < self.newest_ns:
            sweeps = self.flush()
            self.resets += 1
            self.reset()
        self._now_ns = sample.arrival_ns
        for one in sorted(held, key=lambda h: h.stamp_ns):
            sweeps += self._take(self._imus[one.index], *one[1:])
        return sweeps

    def _let_go_of_held(self, samples: Sequence[HeldSample | _Waiting]) -> None:
        assert self.newest_ns is not None
        for sample in samples:
            self.dropped[step_in_words(sample.stamp_ns, self.newest_ns)] += 1

    def _usable(self, imu: _Imu, stamp_ns: int, x: float, y: float, z: float, w: float) -> Quaternion | None:
        """The sample's unit quaternion, or None after counting why it is none."""
        norm2 = x * x + y * y + z * z + w * w
        if norm2 == 0.0:
            self.dropped['all zero, not measured'] += 1
            return None
        if not abs(norm2 - 1.0) < 2.0 * NORM_TOLERANCE:
            self.dropped['norm is not 1' if math.isfinite(norm2) else 'not a number'] += 1
            return None
        scale = 1.0 / math.sqrt(norm2)
        x, y, z, w = x * scale, y * scale, z * scale, w * scale
        if imu.last is not None:
            lx, ly, lz, lw = imu.last
            cosine = abs(x * lx + y * ly + z * lz + w * lw)
            allowed = TURN_SLACK + MAX_TURN_RATE * (stamp_ns - imu.last_ns) / NS
            if cosine < 1.0 and allowed < math.pi and 2.0 * math.acos(cosine) > allowed:
                self.dropped['turned faster than the sensor can'] += 1
                return None
        return x, y, z, w

    def _complete(self) -> list[Sweep]:
        """Sweeps, as long as every living IMU has a sample that waits."""
        sweeps: list[Sweep] = []
        while self._n_waiting and self._n_waiting == self._n_alive:
            members = [
                (imu.waiting[0].stamp_ns, index) for index, imu in enumerate(self._imus) if imu.waiting
            ]
            there = self._present(members)
            if len(there) < len(members) and self._resuming(members):
                self._let_go([index for _, index in there])
                self.dropped['before there were samples of all'] += len(there)
                continue
            members = self._catch_up(there)
            left_out = self._left_over(members)
            if left_out and all(self._comes_back(m, members) for m in members if m not in left_out):
                members = left_out
            elif left_out:
                self._let_go([index for _, index in left_out])
                self.dropped['of a sweep that was not whole'] += len(left_out)
                continue
            if self._has_base and self._on_base(members) is None:
                self.dropped[NO_BASE] += len(members)
            else:
                sweep = self._sweep(members)
                if sweep.measured.any():
                    sweeps.append(sweep)
            self._closed_ns = max(members)[0]
            self._let_go([index for _, index in members])
        return sweeps

    def _present(self, members: list[tuple[int, int]]) -> list[tuple[int, int]]:
        """Those that measured at the time of the oldest sample; of the others only later ones wait."""
        oldest = min(members)[0]
        if max(members)[0] - oldest > self._timeout_ns:
            members = [m for m in members if m[0] - oldest <= self._timeout_ns]
        # An IMU that comes back from its silence does not belong to the rounds before.
        next_ns = min(members)[0] + self._period(members)
        return [m for m in members if m[0] < next_ns or not self._comes_back(m, members)]

    def _period(self, members: list[tuple[int, int]]) -> int:
        """Time of a round, as those tell it who were in the last one; 0 where none was."""
        return min(
            (stamp - self._imus[index].used_ns for stamp, index in members if self._imus[index].used),
            default=0,
        )

    def _comes_back(self, member: tuple[int, int], members: list[tuple[int, int]]) -> bool:
        """Whether this is an IMU's first sample after a silence in which others went on."""
        imu = self._imus[member[1]]
        silence = member[0] - imu.used_ns
        return imu.used is not None and silence > self._timeout_ns + self._period(members)

    def _resuming(self, members: list[tuple[int, int]]) -> bool:
        """Whether no sweep came just before, and those who are not here yet will be soon."""
        oldest, newest = min(members)[0], max(members)[0]
        begins = self._closed_ns is None or oldest - self._closed_ns > self._timeout_ns
        return begins and newest - oldest <= _RESUMING_NS

    def _catch_up(self, members: list[tuple[int, int]]) -> list[tuple[int, int]]:
        """Pass over samples of faster IMUs that are older than need be; (stamp, index) of the first waiting ones."""
        newest = max(members)[0]
        out = []
        for _, index in members:
            imu = self._imus[index]
            while len(imu.waiting) > 1 and imu.waiting[1].stamp_ns <= newest:
                imu.use()
            out.append((imu.waiting[0].stamp_ns, index))
        return out

    def _left_over(self, members: list[tuple[int, int]]) -> list[tuple[int, int]]:
        """Members whose sample is the end of the sweep before.

        After a lost sample, or when listening began in the middle, a full set may begin with the end of one sweep and
        end with the beginning of the next. Then its largest gap is much longer than the pause before the next round
        would be; the samples before the gap are let go, and the set is completed by those that follow.
        """
        members = sorted(members)
        span = members[-1][0] - members[0][0]
        imus = [(self._imus[index], stamp) for stamp, index in members]
        periods = [stamp - imu.used_ns for imu, stamp in imus if imu.used is not None]
        if not periods or 2 * span <= min(periods):
            return []
        gap, cut = max((members[k + 1][0] - members[k][0], k + 1) for k in range(len(members) - 1))
        pause = min(periods) - span
        if gap <= 2 * pause or 2.5 * gap <= min(periods):
            return []
        return members[:cut]

    def _let_go(self, indices: Iterable[int]) -> None:
        for index in indices:
            imu = self._imus[index]
            imu.use()
            self._n_waiting -= not imu.waiting
        self._look_for_oldest()

    def _look_for_oldest(self) -> None:
        first = min((imu.waiting[0] for imu in self._imus if imu.waiting), default=None)
        if first is not None:
            self._oldest_ns, _, self._since_ns = first

    def _on_base(self, members: list[tuple[int, int]]) -> Quaternion | None:
        """Orientation of the IMU on the base; the last one within a short gap, None beyond."""
        imu = self._imus[self.n_imu]
        if any(index == self.n_imu for _, index in members):
            return imu.waiting[0].q
        return imu.used if min(members)[0] - imu.used_ns <= self._timeout_ns else None

    def _sweep(self, members: list[tuple[int, int]]) -> Sweep:
        orientations = np.zeros((self.n_imu, 4))
        orientations[:, 3] = 1.0
        measured = np.zeros(self.n_imu, dtype=bool)
        stamp_ns = min(members)[0] if self._interpolate else max(members)[0]
        base = np.array(self._on_base(members)) if self._has_base else None
        for stamp, index in members:
            imu = self._imus[index]
            q: Quaternion | FloatArray = imu.waiting[0].q
            if self._interpolate and imu.used is not None and stamp > stamp_ns >= imu.used_ns:
                fraction = (stamp_ns - imu.used_ns) / (stamp - imu.used_ns)
                q = slerp(np.array(imu.used), np.array(q), fraction)
            if index < self.n_imu:
                orientations[index] = q
                measured[index] = True
            else:
                base = np.array(q)
        return Sweep(stamp_ns, orientations, measured, base)
