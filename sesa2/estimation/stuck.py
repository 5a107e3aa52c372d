"""IMUs that are stuck: the same quaternion, to the last digit, for seconds while others turn."""

import numpy as np

from sesa2.shape.rotations import FloatArray

# A fused orientation that is alive changes in its last digits even at rest, or its neighbours rest too.
STUCK_FOR = 2.0  # s
STUCK_WHILE = np.deg2rad(15.0)  # of turning of another IMU meanwhile


class StuckImus:
    """Watches sweeps for IMUs whose quaternion stays the same while another IMU turns.

    Parameters
    ----------
    n_imu
        number of IMUs along the arm.

    Attributes
    ----------
    stuck : (n_imu,)
        true where the IMU is stuck now.
    seconds : (n_imu,)
        for how long each was stuck, in all, s.
    """

    def __init__(self, n_imu: int):
        self.stuck = np.zeros(n_imu, dtype=bool)
        self.seconds = np.zeros(n_imu)
        self._held: FloatArray | None = None  # the quaternion that each shows
        self._last = 0.0
        self._since = np.zeros(n_imu)  # when it began to show it, s
        self._then = np.zeros((n_imu, n_imu, 4))  # all IMUs' orientations at that time
        self._turned = np.zeros(n_imu)  # the farthest that any other has turned since, rad

    def add(self, stamp: float, orientations: FloatArray, measured: np.ndarray) -> np.ndarray:
        """Take a sweep; one that is older than the last begins anew.

        Parameters
        ----------
        stamp
            s.
        orientations : (n_imu, 4)
            q_WS, x y z w, unit norm.
        measured : (n_imu,)
            true where the IMU has measured; the others are left as they were.

        Returns
        -------
        (n_imu,), true where the IMU is stuck.
        """
        if self._held is None or stamp < self._since.max():
            self._held = np.full(orientations.shape, np.nan)
            self.stuck[:] = False
        changed = measured & (orientations != self._held).any(axis=1)
        for i in np.flatnonzero(changed):
            self._held[i] = orientations[i]
            self._since[i] = stamp
            self._then[i] = np.where(measured[:, None], orientations, np.nan)
        self._turned[changed] = 0.0
        cosines = np.abs(np.einsum('ijk,jk->ij', self._then, orientations))
        cosines[:, ~measured] = 1.0
        turned = 2.0 * np.arccos(np.clip(np.nan_to_num(cosines, nan=1.0), -1.0, 1.0))
        self._turned = np.maximum(self._turned, turned.max(axis=1))
        held_for = stamp - self._since
        stuck = measured & ~changed & (held_for >= STUCK_FOR) & (self._turned >= STUCK_WHILE)
        newly, lasting = stuck & ~self.stuck, stuck & self.stuck
        self.seconds[newly] += held_for[newly]
        self.seconds[lasting] += stamp - self._last
        self.stuck, self._last = stuck, stamp
        return stuck


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
        moves = np.flatnonzero((np.diff(orientations[own, i], axis=0) != 0.0).any(axis=1)) + 1
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
