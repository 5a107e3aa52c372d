"""IMUs that are stuck: the same quaternion, to the last digit, for seconds while others turn."""

import numpy as np

from sesa2.shape.rotations import FloatArray

# A fused orientation that is alive changes in its last digits even at rest, or its neighbours rest too.
STUCK_FOR = 2.0  # s
STUCK_WHILE = np.deg2rad(15.0)  # of turning of another IMU meanwhile

_WATCHED = 10.0  # Hz


def stuck_spans(
    stamps: FloatArray, orientations: FloatArray, measured: np.ndarray
) -> list[list[tuple[float, float]]]:
    """When each IMU of a recording was stuck.

    Parameters
    ----------
    stamps : (n,)
        s.
    orientations : (n, n_imu, 4)
        q_WS, x y z w, unit norm.
    measured : (n, n_imu)
        true where the IMU has measured.

    Returns
    -------
    Of each IMU the spans, s, from the first of the equal samples to the last.
    """
    spans: list[list[tuple[float, float]]] = []
    for i in range(measured.shape[1]):
        own = np.flatnonzero(measured[:, i])
        found: list[tuple[float, float]] = []
        turns = (np.diff(orientations[own, i], axis=0) != 0.0).any(axis=1)
        # Of what was between two parts of a recording nothing is known.
        moves = np.flatnonzero(turns | (np.diff(stamps[own]) >= STUCK_FOR)) + 1
        starts, ends = np.append(0, moves), np.append(moves, len(own))
        if len(own):
            long = stamps[own[ends - 1]] - stamps[own[starts]] >= STUCK_FOR
            for start, end in zip(own[starts[long]], own[ends[long] - 1], strict=True):
                there = measured[start : end + 1] & measured[start]
                cosines = np.abs(np.einsum('tik,ik->ti', orientations[start : end + 1], orientations[start]))
                turned = 2.0 * np.arccos(np.clip(np.where(there, cosines, 1.0), 0.0, 1.0))
                if turned.max() >= STUCK_WHILE:
                    found.append((float(stamps[start]), float(stamps[end])))
        spans.append(found)
    return spans


def stuck_in_words(seconds: float) -> str:
    """For people."""
    return f'stuck: the same quaternion for {seconds:.1f} s while others turned'


# Of a long recording, parts of ten minutes, so that memory does not grow with it; a span over their border is two.
_KEPT = 600 * _WATCHED


class StuckWatch:
    """Looks for stuck IMUs over a recording that comes block by block; ten sweeps a second are enough.

    Attributes
    ----------
    seconds : (n_imu,)
        how long each was stuck, s, of the parts that `end` has closed.
    """

    def __init__(self, n_imu: int):
        self.seconds = np.zeros(n_imu)
        self._forget()

    def _forget(self) -> None:
        self._kept: list[tuple[FloatArray, FloatArray, np.ndarray]] = []
        self._n, self._slot = 0, -np.inf

    def add(self, stamps: FloatArray, orientations: FloatArray, measured: np.ndarray) -> None:
        """Take sweeps; parameters as of `stuck_spans`."""
        slots = np.floor(stamps * _WATCHED)
        new = np.flatnonzero(np.diff(slots, prepend=self._slot) > 0.0)
        if len(new):
            self._kept.append((stamps[new], orientations[new], measured[new]))
            self._n += len(new)
            self._slot = slots[new[-1]]
        if self._n >= _KEPT:
            self.end()

    def end(self) -> None:
        """Close a part: what follows may be of another time."""
        if self._kept:
            stamps, orientations, measured = (np.concatenate(of) for of in zip(*self._kept, strict=True))
            for i, spans in enumerate(stuck_spans(stamps, orientations, measured)):
                self.seconds[i] += sum(end - begin for begin, end in spans)
        self._forget()
