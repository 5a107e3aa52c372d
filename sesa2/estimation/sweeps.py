"""Single samples of the IMUs put together into sweeps, by the samples' own stamps alone."""

import math
from collections import Counter, deque
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from sesa2.shape.rotations import FloatArray, slerp
from sesa2.time import NS

# A jump back by more than this is a new recording (a looped bag), less is a late or disordered sample.
RESET_NS = NS
# The chip's own rounding leaves norms within 2e-4 of 1.
NORM_TOLERANCE = 0.02
# The gyroscope's range is 2000°/s = 35 rad/s: a faster turn is a damaged sample. The constant part lets stamps jitter.
MAX_TURN_RATE = 35.0
TURN_SLACK = 0.5

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


class _Imu:
    """What is known of one IMU: the samples that wait for a sweep, and the last that went into one."""

    __slots__ = ('alive', 'last', 'last_ns', 'used', 'used_ns', 'waiting')

    def __init__(self) -> None:
        self.waiting: deque[tuple[int, Quaternion]] = deque()
        self.forget()

    def forget(self) -> None:
        self.alive = True
        self.waiting.clear()
        self.last: Quaternion | None = None
        self.used: Quaternion | None = None
        self.last_ns = self.used_ns = 0

    def use(self) -> None:
        """Take the first waiting sample."""
        self.used_ns, self.used = self.waiting.popleft()


class SweepAssembler:
    """Gives a sweep when every living IMU has a newer sample, or when the timeout has passed.

    An IMU that a timed-out sweep had to do without is not waited for until it is heard again. Samples that cannot be
    used are counted in `dropped`, by reason. Between IMUs samples may arrive in any order, as DDS may bring them.

    Parameters
    ----------
    enabled
        for each IMU, whether it is used.
    has_base
        whether another IMU, of index n_imu, sits on the base.
    timeout : s
        by the samples' stamps.
    interpolate
        take all orientations at the stamp of the sweep's first sample, instead of as they come.
    latency : s
        taken off the stamps.
    """

    def __init__(
        self,
        enabled: Sequence[bool],
        *,
        has_base: bool = False,
        timeout: float = 0.05,
        interpolate: bool = False,
        latency: float = 0.0,
    ):
        self.n_imu = len(enabled)
        self._used = [*enabled, True] if has_base else list(enabled)
        self._has_base = has_base
        self._timeout_ns = round(timeout * NS)
        self._interpolate = interpolate
        self._latency_ns = round(latency * NS)
        self._imus = [_Imu() for _ in self._used]
        self.dropped: Counter[str] = Counter()
        self.resets = 0
        self.reset()

    def reset(self) -> None:
        """Forget all samples, as at the start of a recording."""
        for imu in self._imus:
            imu.forget()
        self._n_alive = sum(self._used)
        self._n_waiting = 0  # IMUs with a sample that waits; all of them are alive
        self._oldest_ns = 0  # stamp of the first sample that waits
        self._newest_ns = 0

    @property
    def alive(self) -> list[bool]:
        """For each IMU (the base's last), whether sweeps wait for it."""
        return [imu.alive and used for imu, used in zip(self._imus, self._used, strict=True)]

    def add(self, index: int, stamp_ns: int, x: float, y: float, z: float, w: float) -> list[Sweep]:
        """Take one sample.

        Parameters
        ----------
        index
            of the IMU along the arm; n_imu is the IMU on the base.
        stamp_ns
            time of the measurement, ns.
        x, y, z, w
            the measured quaternion q_WS.

        Returns
        -------
        The sweeps that are complete now, in order of time: mostly none or one; several after a timeout.
        """
        if not self._used[index]:
            return []
        sweeps: list[Sweep] = []
        stamp_ns -= self._latency_ns
        imu = self._imus[index]
        if stamp_ns <= imu.last_ns and imu.last is not None:
            if self._newest_ns - stamp_ns <= RESET_NS:
                self.dropped['not newer than the last of its IMU'] += 1
                return []
            sweeps = self.flush()
            self.reset()
            self.resets += 1
        q = self._usable(imu, stamp_ns, x, y, z, w)
        if q is None:
            return sweeps
        imu.last, imu.last_ns = q, stamp_ns
        if not imu.waiting:
            self._oldest_ns = min(self._oldest_ns, stamp_ns) if self._n_waiting else stamp_ns
            self._n_waiting += 1
        imu.waiting.append((stamp_ns, q))
        if stamp_ns > self._newest_ns:
            self._newest_ns = stamp_ns
        if not imu.alive:
            imu.alive = True
            self._n_alive += 1
        if self._n_waiting < self._n_alive:
            if self._newest_ns - self._oldest_ns <= self._timeout_ns:
                return sweeps
            self._give_up_the_silent()
        return sweeps + self._complete()

    def flush(self) -> list[Sweep]:
        """Close the sweeps that wait for missing IMUs: at a timeout by the clock, and at the end of a recording."""
        sweeps: list[Sweep] = []
        while self._n_waiting:
            self._give_up_the_silent()
            sweeps += self._complete()
        return sweeps

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

    def _give_up_the_silent(self) -> None:
        for imu, used in zip(self._imus, self._used, strict=True):
            if used and imu.alive and not imu.waiting:
                imu.alive = False
                self._n_alive -= 1

    def _complete(self) -> list[Sweep]:
        """Sweeps, as long as every living IMU has a sample that waits."""
        sweeps: list[Sweep] = []
        while self._n_waiting and self._n_waiting == self._n_alive:
            members = [(imu.waiting[0][0], index) for index, imu in enumerate(self._imus) if imu.waiting]
            members = self._catch_up(members)
            left_out = self._left_over(members)
            if left_out:
                self._let_go(left_out)
                self.dropped['of a sweep that was not whole'] += len(left_out)
            elif self._has_base and self._on_base() is None:
                self._let_go([index for _, index in members])
                self.dropped['of a sweep without the orientation of the base'] += len(members)
            else:
                sweep = self._sweep(members)
                self._let_go([index for _, index in members])
                if sweep.measured.any():
                    sweeps.append(sweep)
        return sweeps

    def _catch_up(self, members: list[tuple[int, int]]) -> list[tuple[int, int]]:
        """Pass over samples of faster IMUs that are older than need be; (stamp, index) of the first waiting ones."""
        newest = max(members)[0]
        out = []
        for _, index in members:
            imu = self._imus[index]
            while len(imu.waiting) > 1 and imu.waiting[1][0] <= newest:
                imu.use()
            out.append((imu.waiting[0][0], index))
        return out

    def _left_over(self, members: list[tuple[int, int]]) -> list[int]:
        """IMUs whose sample is the end of the sweep before.

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
        return [index for _, index in members[:cut]]

    def _let_go(self, indices: Iterable[int]) -> None:
        for index in indices:
            imu = self._imus[index]
            imu.use()
            self._n_waiting -= not imu.waiting
        self._oldest_ns = min((imu.waiting[0][0] for imu in self._imus if imu.waiting), default=0)

    def _on_base(self) -> Quaternion | None:
        imu = self._imus[self.n_imu]
        return imu.waiting[0][1] if imu.waiting else imu.used

    def _sweep(self, members: list[tuple[int, int]]) -> Sweep:
        orientations = np.zeros((self.n_imu, 4))
        orientations[:, 3] = 1.0
        measured = np.zeros(self.n_imu, dtype=bool)
        stamp_ns = min(members)[0] if self._interpolate else max(members)[0]
        base = np.array(self._on_base()) if self._has_base else None
        for stamp, index in members:
            imu = self._imus[index]
            q: Quaternion | FloatArray = imu.waiting[0][1]
            if self._interpolate and imu.used is not None and stamp > stamp_ns >= imu.used_ns:
                fraction = (stamp_ns - imu.used_ns) / (stamp - imu.used_ns)
                q = slerp(np.array(imu.used), np.array(q), fraction)
            if index < self.n_imu:
                orientations[index] = q
                measured[index] = True
            else:
                base = np.array(q)
        return Sweep(stamp_ns, orientations, measured, base)
