"""Single samples of the IMUs put together into sweeps, by the samples' own stamps and the clock of their arrival.

Over a network a topic's messages may come in bursts, long after those of other topics that were measured later. So
stamps alone do not tell that an IMU is silent: where there is a clock, a sweep waits until it says so too. That clock
goes on while others are heard: when nobody is, the link stands still, and its topics will come back one by one. What it
may cost is a pause when an IMU dies; no sweep is lost by it, and none is given twice or out of order.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from sesa2.estimation.arrivals import Arrivals
from sesa2.estimation.imu_queue import (
    MAX_TURN_RATE,
    NORM_TOLERANCE,
    TURN_SLACK,
    ImuQueue,
    Quaternion,
    WaitingSample,
)
from sesa2.estimation.instants import Member, catch_up, comes_back, left_over, present, went_on
from sesa2.estimation.rounds import whole_rounds
from sesa2.estimation.time_steps import AHEAD_NS, BACK_NS, HeldSample, TimeSteps, step_in_words
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

# At the start, and after a pause of all, the topics come one after another: for so long no sweep is made of a few.
_RESUMING_NS = NS
# By so much the clock goes on between two messages; what is more is a link, or a listener, that stood still.
_PAUSE_NS = NS // 10
# When most fall silent at once it is likelier the link, and what the few that are left say is hardly a shape.
_MOST_PATIENCE_NS = NS
# Why samples are not used.
NOT_WHOLE = 'of a sweep that was not whole'
NO_BASE = 'of a sweep without the orientation of the base'
# Of one IMU; with more that wait, whoever is missing is silent whatever the clock says.
WAITING_MAX = 10_000


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
    lengths : (n_backbones,) or None
        of the backbones at this instant, as they are said (before scale and offset), in the order of the configuration,
        m; NaN: not known. None where the configuration has none.
    fields : (n_magnetometers, 3) or None
        of an instant of magnetometers, which has no orientations: in their own axes, T; NaN: not measured. `measured`
        is theirs then.
    """

    stamp_ns: int
    orientations: FloatArray
    measured: np.ndarray
    base: FloatArray | None
    lengths: FloatArray | None = None
    fields: FloatArray | None = None


class SweepAssembler:
    """Gives a sweep when every living IMU has a newer sample, or when it is known that one is silent.

    An IMU is silent when a sample of the sweep is older than the newest of all by the timeout, and has been there, by
    the clock, for longer than a message may be on its way (`Arrivals`), without a word of that IMU meanwhile, but of
    others: a time in which nothing at all is heard does not count. It is not waited for until it is heard again. Where
    samples come without a time of arrival, stamps alone decide. Where an IMU's own samples show that it was silent in
    between, and at least half of the others were not, the sweeps in between do without it.

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
    queue
        what one sensor's samples wait in, which knows what a sample is.
    arrivals
        what the clock of arrival tells.
    dropped
        number of samples that no sweep could use, by reason.
    resets
        how often time stepped back.
    """

    queue: type[ImuQueue] = ImuQueue

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
        self._imus = [self.queue() for _ in self._used]
        self.arrivals = Arrivals(len(self._used), patience, timeout)
        self._steps = TimeSteps()
        self.dropped: Counter[str] = Counter()
        self.resets = 0
        self._arrived_ns = 0  # when the last message did
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
        self._now_ns: int | None = None  # the clock that counts; None where there is none

    def holds(self, index: int) -> bool:
        """Whether samples of an IMU are held, since their stamps are of another time than the rest."""
        return index in self._steps

    @property
    def holding(self) -> bool:
        """Whether samples of any IMU are held."""
        return len(self._steps) > 0

    @property
    def waiting(self) -> bool:
        """Whether samples wait for their sweep."""
        return self._n_waiting > 0

    @property
    def enabled(self) -> np.ndarray:
        """For each sensor along the arm, whether it is used, (n,)."""
        return np.array(self._used[: self.n_imu], dtype=bool)

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
            self.arrivals.observe(index, stamp_ns, arrival_ns)
            now_ns = arrival_ns if self._now_ns is None else self._now_ns
            self._now_ns = now_ns + min(max(0, arrival_ns - self._arrived_ns), _PAUSE_NS)
            self._arrived_ns, arrival_ns = arrival_ns, self._now_ns
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
        imus = [index for index, alive in enumerate(self.alive) if alive]
        m = len(imus)
        quiet = not (self._n_waiting or self._steps or self._interpolate)
        if (
            not quiet
            or (self._has_base and self.n_imu not in imus)
            or not 1 <= m <= len(indices) // 2
            or any(self._imus[i].used is None for i in imus)
        ):
            return [], 0
        # The last round, which was taken one by one or here, is what the first of these is compared with.
        last = [self._imus[i] for i in indices[:m].tolist()]
        if any(imu.last is None for imu in last):
            return [], 0
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
        passed_ns = np.diff(arrivals_ns[: n * m], prepend=self._arrived_ns).clip(0, _PAUSE_NS)
        clock_ns = (arrivals_ns[0] if self._now_ns is None else self._now_ns) + passed_ns.cumsum()
        for place, index in enumerate(order):
            self.arrivals.observe_many(index, stamps[:, place], arrivals_ns[place : n * m : m])
            imu = self._imus[index]
            imu.last_ns = imu.used_ns = int(stamps[-1, place])
            imu.last = imu.used = tuple(q[-1, place].tolist())
            imu.heard_ns = int(clock_ns[place - m])
        self._now_ns, self._arrived_ns = int(clock_ns[-1]), int(arrivals_ns[n * m - 1])
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

    def flush(self) -> list[Sweep]:
        """Close the sweeps that wait for missing IMUs: at the end of a recording."""
        sweeps: list[Sweep] = []
        while self._n_waiting:
            self._give_up(self._silent(whatever_the_clock=True))
            sweeps += self._complete(whatever_the_clock=True)
        return sweeps

    def _take(
        self, imu: ImuQueue, stamp_ns: int, x: float, y: float, z: float, w: float, arrival_ns: int | None
    ) -> list[Sweep]:
        """Take a sample of the present time."""
        q = imu.usable(stamp_ns, x, y, z, w)
        if isinstance(q, str):
            self.dropped[q] += 1
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
        imu.waiting.append(WaitingSample(stamp_ns, q, arrival_ns))
        if not imu.alive:
            imu.alive = True
            self._n_alive += 1
        if self._n_waiting < self._n_alive and len(imu.waiting) > WAITING_MAX:
            self._give_up(self._silent(whatever_the_clock=True))
        return self._close(whatever_the_clock=len(imu.waiting) > WAITING_MAX)

    def _close(self, *, whatever_the_clock: bool) -> list[Sweep]:
        """The sweeps that are complete, or that are known to stay without an IMU."""
        sweeps: list[Sweep] = []
        assert self.newest_ns is not None
        while self._n_waiting:
            if self._n_waiting < self._n_alive:
                if self.newest_ns - self._oldest_ns <= self._timeout_ns or not (silent := self._silent()):
                    break
                self._give_up(silent)
            if self._n_waiting == self._n_alive:
                sweeps += self._complete(whatever_the_clock=whatever_the_clock)
                if self._n_waiting == self._n_alive:
                    break
        return sweeps

    def _silent(self, *, whatever_the_clock: bool = False) -> list[ImuQueue]:
        """Living IMUs of which no sample waits, and none has come for long enough, or one that is no measurement."""
        missing = [
            imu
            for imu, used in zip(self._imus, self._used, strict=True)
            if used and imu.alive and not imu.waiting
        ]
        if whatever_the_clock or self._now_ns is None:
            return missing
        patience_ns = self.arrivals.patience_ns
        if 2 * len(missing) > self._n_alive:
            patience_ns = max(patience_ns, _MOST_PATIENCE_NS)
        long_ago = self._now_ns - patience_ns
        waited = self._since_ns < long_ago
        return [
            imu
            for imu in missing
            if (waited and imu.heard_ns < long_ago) or imu.unusable_ns > self._oldest_ns
        ]

    def _give_up(self, silent: list[ImuQueue]) -> None:
        for imu in silent:
            imu.alive = False
            self._n_alive -= 1

    def _hold(self, sample: HeldSample) -> list[Sweep]:
        """Keep a sample of another time, and go over to that time if it is to be believed."""
        assert self.newest_ns is not None
        self._let_go_of_held(self._steps.hold(sample, self.newest_ns))
        held = self._steps.believed(
            sample.imu, self.newest_ns, self._n_alive, begun=self._closed_ns is not None
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
            sweeps += self._take(self._imus[one.imu], *one[1:])
        return sweeps

    def _let_go_of_held(self, samples: Sequence[HeldSample | WaitingSample]) -> None:
        assert self.newest_ns is not None
        for sample in samples:
            self.dropped[step_in_words(sample.stamp_ns, self.newest_ns)] += 1

    def _complete(self, *, whatever_the_clock: bool) -> list[Sweep]:
        """Sweeps, as long as every living IMU has a sample that waits, and it is known what the next one is."""
        sweeps: list[Sweep] = []
        while self._n_waiting and self._n_waiting == self._n_alive:
            members = [
                (imu.waiting[0].stamp_ns, index) for index, imu in enumerate(self._imus) if imu.waiting
            ]
            there = present(members, self._imus, self._timeout_ns)
            if len(there) < len(members) and self._resuming(members):
                self._let_go([index for _, index in there])
                self.dropped['before there were samples of all'] += len(there)
                continue
            most = 2 * len(there) >= len(members)
            if len(there) < len(members) and not (
                most and (on := went_on(there, self._imus, self._timeout_ns))
            ):
                if most and on is None and not whatever_the_clock and self._may_go_on(there):
                    break
                # No IMU was silent while most others measured: the link was cut in the middle of a sweep.
                self._let_go([index for _, index in there])
                self.dropped[NOT_WHOLE] += len(there)
                continue
            members = catch_up(there, self._imus)
            left_out = left_over(members, self._imus)
            most = 2 * len(left_out) >= len(members)
            if most and all(
                comes_back(m, members, self._imus, self._timeout_ns) for m in members if m not in left_out
            ):
                members = left_out
            elif left_out:
                self._let_go([index for _, index in left_out])
                self.dropped[NOT_WHOLE] += len(left_out)
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

    def _may_go_on(self, members: list[Member]) -> bool:
        """Whether any of these was heard of late, or may be on its way."""
        if self._now_ns is None:
            return False
        long_ago = self._now_ns - self.arrivals.patience_ns
        return any(self._imus[index].heard_ns >= long_ago for _, index in members)

    def _resuming(self, members: list[Member]) -> bool:
        """Whether no sweep came just before, and those who are not here yet will be soon."""
        oldest, newest = min(members)[0], max(members)[0]
        begins = self._closed_ns is None or oldest - self._closed_ns > self._timeout_ns
        return begins and newest - oldest <= _RESUMING_NS

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

    def _on_base(self, members: list[Member]) -> Quaternion | None:
        """Orientation of the IMU on the base; the last one within a short gap, None beyond."""
        imu = self._imus[self.n_imu]
        if any(index == self.n_imu for _, index in members):
            return imu.waiting[0].q
        return imu.used if min(members)[0] - imu.used_ns <= self._timeout_ns else None

    def _sweep(self, members: list[Member]) -> Sweep:
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
                q = imu.between(imu.used, imu.waiting[0].q, fraction)
            if index < self.n_imu:
                orientations[index] = q
                measured[index] = True
            else:
                base = np.array(q)
        return Sweep(stamp_ns, orientations, measured, base)
