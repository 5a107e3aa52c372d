"""The last states of something that is simulated, as somebody may ask for a time that has passed."""

import numpy as np

from sesa2.shape.rotations import FloatArray


class RecentPast:
    """Numbers over time, the last of them kept; linear between two.

    Parameters
    ----------
    kept
        how many times at least.
    time, row : (k,)
        the first.
    """

    def __init__(self, kept: int, time: float, row: FloatArray):
        self._kept = kept
        self._times, self._rows = np.empty(2 * kept), np.empty((2 * kept, len(row)))
        self._n = 0
        self.append(time, row)

    def append(self, time: float, row: FloatArray) -> None:
        """Keep one more; times ascend."""
        if self._n == len(self._times):
            self._times[: self._kept], self._rows[: self._kept] = (
                self._times[-self._kept :],
                self._rows[-self._kept :],
            )
            self._n = self._kept
        self._times[self._n], self._rows[self._n] = time, row
        self._n += 1

    def at(self, time: float | FloatArray) -> FloatArray:
        """Rows at any times, (...) to (...) + (k,); held before the first that is kept and after the last."""
        times, rows = self._times[: self._n], self._rows[: self._n]
        at = np.minimum(np.maximum(time, times[0]), times[-1])
        k = np.minimum(np.searchsorted(times, at, side='right'), self._n - 1)
        before = np.maximum(k - 1, 0)
        passed = times[k] - times[before]
        fraction = np.where(passed > 0.0, (at - times[before]) / np.where(passed > 0.0, passed, 1.0), 0.0)
        return np.asarray(rows[before] + fraction[..., None] * (rows[k] - rows[before]))
