"""The measured length of one backbone over time, and what it was at any instant."""

from collections import Counter

import numpy as np

from sesa2.estimation.time_steps import AHEAD_NS, BACK_NS, HELD_MAX, step_in_words
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

NOT_NEWER = 'not newer than the last of its backbone'
# What is kept of the past, by the stamps: no sweep is waited for longer.
_KEPT_NS = 2 * AHEAD_NS
_FIRST_CAPACITY = 256
# No backbone of a soft arm is driven faster, m/s.
RATE_MAX = 1.0
# What a length may jump by however short the time is, m: the grain of sensors, and the jitter of stamps.
_JITTER = 1e-3


def interpolated(
    at_ns: np.ndarray, stamps_ns: np.ndarray, lengths: FloatArray, timeout_ns: int
) -> FloatArray:
    """Lengths at some instants, by the stamps alone.

    Between samples that are at most the timeout apart it is linear. Where they are further apart, and after the last,
    a sample holds for the timeout. Elsewhere there is none: NaN.

    Parameters
    ----------
    at_ns : (m,)
        ns.
    stamps_ns : (n,)
        strictly increasing, ns.
    lengths : (n,)
        m.
    timeout_ns
        ns.

    Returns
    -------
    (m,), m.
    """
    found = np.full(len(at_ns), np.nan)
    if not len(stamps_ns):
        return found
    after = np.searchsorted(stamps_ns, at_ns)  # the first that is not older
    before = np.maximum(after - 1, 0)
    after = np.minimum(after, len(stamps_ns) - 1)
    since, gap = at_ns - stamps_ns[before], stamps_ns[after] - stamps_ns[before]
    held = (since >= 0) & (since <= timeout_ns)
    found[held] = lengths[before[held]]
    between = held & (gap > 0) & (gap <= timeout_ns)
    a, b = before[between], after[between]
    found[between] += since[between] / gap[between] * (lengths[b] - lengths[a])
    exact = stamps_ns[after] == at_ns
    found[exact] = lengths[after[exact]]
    return found


class LengthTrack:
    """The samples of one backbone, in order of their stamps.

    A sample whose stamp is of another time than those before is believed where it is nearer to the time of the sweeps;
    else it is held until these have stepped too, and let go when the present time goes on.

    Parameters
    ----------
    rate_max : m/s
        a length that changes faster is counted in `jumps`.

    Attributes
    ----------
    newest_ns
        stamp of the newest sample, ns; None before the first.
    n_taken
        number of samples that were used.
    jumps
        number of samples that lie further from the one before than the limit allows.
    restarts
        how often a sample of another time was believed.
    dropped
        number of samples that were not used, by reason.
    """

    def __init__(self, rate_max: float = RATE_MAX):
        self.rate_max = rate_max
        self.newest_ns: int | None = None
        self.n_taken = self.jumps = self.restarts = 0
        self.dropped: Counter[str] = Counter()
        self._begin, self._n = 0, 0
        self._stamps = np.empty(_FIRST_CAPACITY, dtype=np.int64)
        self._lengths = np.empty(_FIRST_CAPACITY)
        self._held: list[tuple[int, float]] = []

    def add(self, stamps_ns: np.ndarray, lengths: FloatArray, sweeps_ns: int | None) -> None:
        """Take samples, (n,), in the order in which they came; sweeps_ns: the time that the sweeps have come to, ns."""
        if len(stamps_ns) > 1 and not self._held:
            before = stamps_ns[0] - 1 if self.newest_ns is None else self.newest_ns
            steps = np.diff(stamps_ns, prepend=before)
            if steps.min() > 0 and steps.max() <= AHEAD_NS:
                self._append(stamps_ns, lengths)
                return
        for stamp_ns, length in zip(stamps_ns.tolist(), lengths.tolist(), strict=True):
            self._add_one(stamp_ns, length, sweeps_ns)

    def at(self, at_ns: np.ndarray, timeout_ns: int) -> FloatArray:
        """The length at some instants, (n,), m; as `interpolated`."""
        there = slice(self._begin, self._n)
        return interpolated(at_ns, self._stamps[there], self._lengths[there], timeout_ns)

    def step(self, sweeps_ns: int) -> None:
        """The time of the sweeps has stepped: what is of that time counts from now on."""
        last, held = self.newest_ns, self._held
        if last is not None and abs(last - sweeps_ns) <= BACK_NS:  # they stepped before, and were believed
            return
        self._held = []
        self._begin = self._n = 0
        self.newest_ns = None
        for stamp_ns, length in held:
            self._add_one(stamp_ns, length, sweeps_ns)

    def _add_one(self, stamp_ns: int, length: float, sweeps_ns: int | None) -> None:
        last = self.newest_ns
        if last is not None and last - BACK_NS <= stamp_ns <= last:
            self.dropped[NOT_NEWER] += 1
            return
        if last is not None and not last < stamp_ns <= last + AHEAD_NS:
            if sweeps_ns is not None and abs(last - sweeps_ns) <= abs(stamp_ns - sweeps_ns):
                self._hold(stamp_ns, length)
                return
            self.restarts += 1
            # What is not before it was of no time, or of one that is over.
            self._n = self._begin + int(np.searchsorted(self._stamps[self._begin : self._n], stamp_ns))
        self._let_go()
        self._append_one(stamp_ns, length)

    def _append_one(self, stamp_ns: int, length: float) -> None:
        n = self._n
        if n == len(self._stamps):
            self._make_room(1)
            n = self._n
        self._stamps[n], self._lengths[n] = stamp_ns, length
        if n > self._begin:
            allowed = self.rate_max * (stamp_ns - int(self._stamps[n - 1])) / NS + _JITTER
            self.jumps += abs(length - float(self._lengths[n - 1])) > allowed
        self._n = n + 1
        self.n_taken += 1
        self.newest_ns = stamp_ns

    def _hold(self, stamp_ns: int, length: float) -> None:
        if self._held and not 0 < stamp_ns - self._held[-1][0] <= AHEAD_NS:
            self._let_go()
        self._held.append((stamp_ns, length))
        if len(self._held) > HELD_MAX:
            self._count_gone(self._held.pop(0)[0])

    def _let_go(self) -> None:
        for stamp_ns, _ in self._held:
            self._count_gone(stamp_ns)
        self._held.clear()

    def _count_gone(self, stamp_ns: int) -> None:
        assert self.newest_ns is not None
        self.dropped[step_in_words(stamp_ns, self.newest_ns)] += 1

    def _append(self, stamps_ns: np.ndarray, lengths: FloatArray) -> None:
        n = len(stamps_ns)
        if self._n + n > len(self._stamps):
            self._make_room(n)
        end = self._n + n
        self._stamps[self._n : end], self._lengths[self._n : end] = stamps_ns, lengths
        first = max(self._n - 1, self._begin)
        self.jumps += n_jumps(self._stamps[first:end], self._lengths[first:end], self.rate_max)
        self._n = end
        self.n_taken += n
        self.newest_ns = int(stamps_ns[-1])

    def _make_room(self, n: int) -> None:
        """Forget what is too old, and move the rest to the front of arrays that are large enough."""
        if self._n > self._begin:
            oldest = self._stamps[self._n - 1] - _KEPT_NS
            self._begin += int(np.searchsorted(self._stamps[self._begin : self._n], oldest))
        kept = slice(self._begin, self._n)
        stamps, lengths = self._stamps[kept].copy(), self._lengths[kept].copy()
        m = len(stamps)
        if 2 * (m + n) > len(self._stamps):
            self._stamps, self._lengths = np.empty(2 * (m + n), dtype=np.int64), np.empty(2 * (m + n))
        self._stamps[:m], self._lengths[:m] = stamps, lengths
        self._begin, self._n = 0, m


def n_jumps(stamps_ns: np.ndarray, lengths: FloatArray, rate_max: float) -> int:
    """How many of samples in a row, (n,) ns and m, change faster than a rate, m/s, by more than what jitters."""
    allowed = rate_max * np.diff(stamps_ns) / NS + _JITTER
    return int(np.count_nonzero(np.abs(np.diff(lengths)) > allowed))
