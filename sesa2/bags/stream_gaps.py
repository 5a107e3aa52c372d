"""What a stream of stamps lacks: a queue that overflowed says nothing, the stamps do."""

from collections import deque

# A pause of so many usual intervals is a gap; irregular drivers have shorter ones.
_GAP = 2.5
_USUAL = 15  # intervals that the usual one is the median of
_OFTEN = 5  # after so many of these it is found anew


class StreamGaps:
    """Counts what is missing in a stream of messages at a rate of its own.

    Attributes
    ----------
    n_gaps
        number of pauses that are too long.
    n_missing
        number of messages that would have been in them, at the rate of those before.
    """

    def __init__(self) -> None:
        self.n_gaps = self.n_missing = 0
        self._last_ns = 0
        self._intervals: deque[int] = deque(maxlen=_USUAL)
        self._usual_ns = 0.0
        self._age = 0

    def take(self, stamp_ns: int) -> None:
        """A message of this stamp, ns; one without (0), or older than the last, begins anew."""
        interval, self._last_ns = stamp_ns - self._last_ns, stamp_ns
        if interval <= 0 or interval == stamp_ns:
            return
        if self._usual_ns and interval > _GAP * self._usual_ns:
            self.n_gaps += 1
            self.n_missing += round(interval / self._usual_ns) - 1
        self._intervals.append(interval)
        self._age += 1
        if len(self._intervals) == _USUAL and self._age >= _OFTEN:
            self._usual_ns, self._age = float(sorted(self._intervals)[_USUAL // 2]), 0
