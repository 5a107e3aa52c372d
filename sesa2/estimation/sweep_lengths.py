"""Measured lengths of backbones put to the sweeps of the IMUs.

A sweep waits for its lengths as it waits for its IMUs: until each backbone has a sample that is not older, or until the
clock says that none will come. What it is given then depends on the stamps alone, so that a replay gives what live
gave; had a length been held or extrapolated at once, the order in which two messages happened to arrive would show.
What it costs is a delay of at most the lengths' period, and a pause when they end.
"""

import math
from collections import Counter, deque
from collections.abc import Iterable, Sequence

import numpy as np

from sesa2.estimation.arrivals import Arrivals
from sesa2.estimation.length_track import RATE_MAX, LengthTrack
from sesa2.estimation.sweeps import Sweep
from sesa2.estimation.time_steps import AHEAD_NS
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

# Sweeps that may wait; with more, whoever is missing is silent whatever the clock says.
SWEEPS_WAITING_MAX = 10_000


class SweepLengths:
    """Gives sweeps their lengths, in the order in which they were put.

    A backbone is silent when the clock says so of a sweep that waits for it. Then it is not waited for until a sample
    has come that is not older than the newest sweep by the timeout. One whose stamps are always behind those of the
    IMUs by more than that is not waited for and has no lengths: they are too old when they come.

    Parameters
    ----------
    n
        number of backbones.
    timeout : s
        how long a sample holds, by the stamps.
    imus
        what the clock of arrival tells of the IMUs.
    patience : s
        how long, by the clock, a sweep waits; None: arrivals of lengths teach it.
    rate_max : m/s
        as for `LengthTrack`.

    Attributes
    ----------
    tracks
        of each backbone.
    arrivals
        what the clock of arrival tells of each backbone.
    n_without
        number of sweeps that had no length of a backbone, by its index.
    """

    def __init__(
        self,
        n: int,
        *,
        timeout: float,
        imus: Arrivals,
        patience: float | None = None,
        rate_max: float = RATE_MAX,
    ):
        self._timeout_ns = round(timeout * NS)
        self._imus = imus
        self.arrivals = Arrivals(n, patience, timeout)
        self.tracks = [LengthTrack(rate_max) for _ in range(n)]
        self.n_without: Counter[int] = Counter()
        self._alive = [True] * n
        self._late: list[int] = []  # always, by more than the timeout
        self._waiting: deque[tuple[Sweep, int]] = deque()  # and since when, by the clock
        self._sweeps_ns: int | None = None  # newest of all sweeps

    def add(
        self, backbones: Sequence[int], stamps_ns: np.ndarray, lengths: FloatArray, arrivals_ns: np.ndarray
    ) -> None:
        """Take samples of some backbones, in the order in which they came; what they complete is `ready` then.

        Parameters
        ----------
        backbones : (m,)
            indices of the backbones.
        stamps_ns, arrivals_ns : (n,)
            when they were measured, and when they arrived by the clock of the IMUs' arrivals, ns.
        lengths : (n, m)
            m.
        """
        if not len(stamps_ns):
            return
        for column, index in enumerate(backbones):
            track = self.tracks[index]
            restarts = track.restarts
            track.add(stamps_ns, lengths[:, column], self._sweeps_ns)
            if track.restarts != restarts:
                self.arrivals.forget(index)
            if not self._alive[index] and self._is_recent(track):
                self._alive[index] = True
                self.arrivals.forget(index)  # it may have another clock by now
        self._observe(backbones, stamps_ns, arrivals_ns)

    def put(self, sweeps: Iterable[Sweep], arrival_ns: int) -> list[Sweep]:
        """Let sweeps wait, which came at a time, ns, by a clock that may rest; those that have their lengths now."""
        out: list[Sweep] = []
        for sweep in sweeps:
            last = self._sweeps_ns
            if last is not None and not last < sweep.stamp_ns <= last + AHEAD_NS:
                out += self.flush()
                for track in self.tracks:
                    track.step(sweep.stamp_ns)
                self._alive = [True] * len(self.tracks)
                self.arrivals.reset()
            self._sweeps_ns = sweep.stamp_ns
            self._waiting.append((sweep, arrival_ns))
        return out + self.ready(arrival_ns)

    def ready(self, now_ns: int) -> list[Sweep]:
        """Sweeps that need not wait any longer; to be asked for regularly, as samples may stop coming."""
        out: list[Sweep] = []
        if self._waiting:
            self._late = [i for i, lag in self.lags.items() if lag * NS > self._timeout_ns]
        while self._waiting:
            until_ns = self._complete_until()
            n = next(
                (k for k, (s, _) in enumerate(self._waiting) if s.stamp_ns > until_ns), len(self._waiting)
            )
            if not n:
                sweep, since_ns = self._waiting[0]
                if (
                    now_ns - since_ns <= self.arrivals.patience_ns
                    and len(self._waiting) <= SWEEPS_WAITING_MAX
                ):
                    break
                self._give_up(sweep.stamp_ns)
                continue
            out += self._with_lengths([self._waiting.popleft()[0] for _ in range(n)])
        return out

    def flush(self) -> list[Sweep]:
        """All that wait, with what there is: at the end of a recording."""
        waiting = [sweep for sweep, _ in self._waiting]
        self._waiting.clear()
        return self._with_lengths(waiting)

    @property
    def waiting(self) -> bool:
        """Whether sweeps wait for their lengths."""
        return bool(self._waiting)

    @property
    def lags(self) -> dict[int, float]:
        """How far stamps of backbones are behind those of the IMUs, s, where that is doubtful; negative: ahead."""
        return self.arrivals.lags_behind(self._imus)

    def _complete_until(self) -> float:
        """The stamp up to which every backbone that is waited for has samples, ns."""
        until: float = math.inf
        for index, track in enumerate(self.tracks):
            if self._alive[index] and index not in self._late:
                until = min(until, -math.inf if track.newest_ns is None else track.newest_ns)
        return until

    def _is_recent(self, track: LengthTrack) -> bool:
        newest_ns, sweeps_ns = track.newest_ns, self._sweeps_ns
        return newest_ns is not None and (sweeps_ns is None or newest_ns >= sweeps_ns - self._timeout_ns)

    def _give_up(self, stamp_ns: int) -> None:
        for index, track in enumerate(self.tracks):
            if track.newest_ns is None or track.newest_ns < stamp_ns:
                self._alive[index] = False

    def _with_lengths(self, sweeps: list[Sweep]) -> list[Sweep]:
        if not sweeps:
            return []
        stamps = np.array([sweep.stamp_ns for sweep in sweeps])
        lengths = np.stack([track.at(stamps, self._timeout_ns) for track in self.tracks], axis=-1)
        lengths[:, self._late] = np.nan
        missing = np.isnan(lengths)
        if missing.any():
            self.n_without.update(dict(enumerate(missing.sum(axis=0).tolist())))
        return [sweep._replace(lengths=own) for sweep, own in zip(sweeps, lengths, strict=True)]

    def _observe(self, backbones: Sequence[int], stamps_ns: np.ndarray, arrivals_ns: np.ndarray) -> None:
        """Of a recording many at once, as far as the window of arrivals goes."""
        while len(stamps_ns):
            n = self.arrivals.within_window(arrivals_ns)
            for index in backbones:
                if n:
                    self.arrivals.observe_many(index, stamps_ns[:n], arrivals_ns[:n])
                else:
                    self.arrivals.observe(index, int(stamps_ns[0]), int(arrivals_ns[0]))
            n = max(n, 1)
            stamps_ns, arrivals_ns = stamps_ns[n:], arrivals_ns[n:]
