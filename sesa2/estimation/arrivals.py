"""When messages arrive, against when they were measured: how late they come, and whose clock is off.

What a message takes from its measurement to its arrival, by two clocks that know nothing of each other, says nothing
by itself; its least value over some seconds is the difference of the clocks, and what is more is lateness.
"""

import math
from statistics import median_low

import numpy as np

from sesa2.time import NS

# Two windows are looked at, the present one and the one before.
WINDOW_NS = 10 * NS
# Of a recording there is no hurry: what a sweep may wait for its samples by the clock of recording, s.
OFFLINE_PATIENCE = 5.0
# No message is waited for longer than this; a clock that is off by more is wrong altogether.
PATIENCE_MAX_NS = 5 * NS
# What a lost packet and its repetition take on a link that was well until now.
PATIENCE_MIN_NS = 3 * NS // 10
# At the start nothing is known of the link, and not all topics are connected yet.
_FIRST_LATENESS_NS = NS // 2
# Drivers need some time too; less is no clock of its own.
_DOUBTFUL_LAG_NS = NS // 10
_FEW = 10


class Arrivals:
    """The lateness of messages and the lags of clocks.

    Parameters
    ----------
    n
        number of IMUs.
    patience
        s, instead of what arrivals teach.
    patience_min
        s, the least.
    """

    def __init__(self, n: int, patience: float | None = None, patience_min: float = 0.0):
        self._n = n
        self._fixed_ns = None if patience is None else round(patience * NS)
        self._min_ns = max(PATIENCE_MIN_NS, round(patience_min * NS))
        self.reset()

    def reset(self) -> None:
        """Forget all, as when the stamps begin anew."""
        self._until_ns: int | None = None
        self._least: list[float] = [math.inf] * self._n
        self._least_before = list(self._least)
        self._counts, self._counts_before = [0] * self._n, [0] * self._n
        self._late_ns, self._late_before_ns = 0.0, float(_FIRST_LATENESS_NS)
        self._reference: float = math.inf
        self._learn()

    def forget(self, index: int) -> None:
        """Forget the clock of one, as when its stamps begin anew."""
        self._least[index] = self._least_before[index] = math.inf
        self._counts[index] = self._counts_before[index] = 0

    def observe(self, index: int, stamp_ns: int, arrival_ns: int) -> None:
        """Note a message of an IMU, whether or not it is used."""
        until_ns = self._until_ns
        if until_ns is None or not until_ns - WINDOW_NS <= arrival_ns < until_ns:
            self._turn_over(arrival_ns)
        transit = arrival_ns - stamp_ns
        self._counts[index] += 1
        if self._fixed_ns is not None:
            self._least[index] = min(self._least[index], transit)
            return
        if transit < self._least[index]:
            self._least[index] = transit
            self._refer()
        late = transit - self._reference
        if self._late_ns < late <= 2 * PATIENCE_MAX_NS:
            self._late_ns = late
            self._learn()

    def within_window(self, arrivals_ns: np.ndarray) -> int:
        """How many of these, from the first on, fall into the present window, and can be given to `observe_many`.

        None where patience is learnt: there the order of all messages matters.
        """
        if self._until_ns is None or self._fixed_ns is None:
            return 0
        outside = (arrivals_ns < self._until_ns - WINDOW_NS) | (arrivals_ns >= self._until_ns)
        return int(np.argmax(outside)) if outside.any() else len(arrivals_ns)

    def observe_many(self, index: int, stamps_ns: np.ndarray, arrivals_ns: np.ndarray) -> None:
        """The same of many messages of an IMU, all within the window."""
        self._counts[index] += len(stamps_ns)
        self._least[index] = min(self._least[index], int((arrivals_ns - stamps_ns).min()))

    @property
    def lags(self) -> dict[int, float]:
        """How far stamps of IMUs are behind those of the others, s, where that is doubtful; negative: ahead."""
        transits = {i: self._offset(i) for i in range(self._n) if self._counted(i)}
        found = {}
        for i, transit in transits.items():
            others = [other for k, other in transits.items() if k != i]
            # Of two, the later one is told.
            if others and abs(lag := transit - median_low(others)) > _DOUBTFUL_LAG_NS:
                found[i] = lag / NS
        if len(transits) == 2:
            found = {i: lag for i, lag in found.items() if lag > 0.0}
        return found

    def lags_behind(self, others: 'Arrivals') -> dict[int, float]:
        """How far stamps are behind those of others, s, where that is doubtful; negative: ahead."""
        known = [others._offset(i) for i in range(others._n) if others._counted(i)]
        if not known:
            return {}
        lags = {i: (self._offset(i) - median_low(known)) / NS for i in range(self._n) if self._counted(i)}
        return {i: lag for i, lag in lags.items() if abs(lag) * NS > _DOUBTFUL_LAG_NS}

    def _counted(self, index: int) -> bool:
        return self._counts[index] + self._counts_before[index] >= _FEW

    def _offset(self, index: int) -> float:
        return min(self._least[index], self._least_before[index])

    def _refer(self) -> None:
        """The fastest way of a message; of clocks that are right, or nearly so."""
        offsets = [offset for i in range(self._n) if (offset := self._offset(i)) < math.inf]
        middle = median_low(offsets)
        self._reference = min(offset for offset in offsets if offset >= middle - PATIENCE_MAX_NS)

    def _learn(self) -> None:
        late = max(self._late_ns, self._late_before_ns)
        learnt = min(max(2 * late, self._min_ns), max(PATIENCE_MAX_NS, self._min_ns))
        # How long by the clock a message may be on its way, ns.
        self.patience_ns = learnt if self._fixed_ns is None else self._fixed_ns

    def _turn_over(self, arrival_ns: int) -> None:
        until_ns = self._until_ns
        if until_ns is not None:
            if until_ns <= arrival_ns < until_ns + WINDOW_NS:
                self._least_before, self._counts_before = self._least, self._counts
            else:
                self._least_before, self._counts_before = [math.inf] * self._n, [0] * self._n
            self._late_before_ns = self._late_ns
            self._least, self._counts, self._late_ns = [math.inf] * self._n, [0] * self._n, 0.0
            self._learn()
        self._until_ns = arrival_ns + WINDOW_NS


def lag_in_words(lag: float, others: str = 'the others') -> str:
    """What a lag, s, says about an IMU or a backbone, for people."""
    return (
        f'its stamps are {abs(lag):.2f} s {"behind" if lag > 0.0 else "ahead of"} those of {others}: '
        'separate clocks?'
    )
