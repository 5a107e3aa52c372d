"""Single samples of the IMUs put together into sweeps, by the samples' own stamps alone."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sesa2.shape.rotations import FloatArray, slerp

NS = 1_000_000_000

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
    """What is known of one IMU: its last two samples."""

    __slots__ = ('alive', 'before', 'before_ns', 'last', 'last_ns')

    def __init__(self) -> None:
        self.alive = True
        self.forget()

    def forget(self) -> None:
        self.last: Quaternion | None = None
        self.before: Quaternion | None = None
        self.last_ns = self.before_ns = 0


class SweepAssembler:
    """Gives a sweep when every living IMU has a newer sample, or when the timeout has passed.

    An IMU that a timed-out sweep had to do without is not waited for until it is heard again. Samples that cannot be
    used are counted in `dropped`, by reason.

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
        self._fresh: dict[
            int, int
        ] = {}  # IMUs with a sample since the last sweep, in order of arrival, and its stamp
        self._newest_ns = 0
        self.dropped: Counter[str] = Counter()
        self.resets = 0
        self.reset()

    def reset(self) -> None:
        """Forget all samples, as at the start of a recording."""
        for imu in self._imus:
            imu.alive = True
            imu.forget()
        self._fresh.clear()
        self._newest_ns = 0
        self._n_alive = sum(self._used)

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
        The sweeps that are complete now: none, one, or two where a timeout closed one and this completes another.
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
            sweeps += self.flush()
            self.reset()
            self.resets += 1
        q = self._usable(imu, stamp_ns, x, y, z, w)
        if q is None:
            return sweeps
        if self._fresh and stamp_ns - next(iter(self._fresh.values())) > self._timeout_ns:
            sweeps += self.flush()
        imu.before, imu.before_ns = imu.last, imu.last_ns
        imu.last, imu.last_ns = q, stamp_ns
        self._newest_ns = max(self._newest_ns, stamp_ns)
        if not imu.alive:
            imu.alive = True
            self._n_alive += 1
        self._fresh.setdefault(index, stamp_ns)
        if len(self._fresh) == self._n_alive and self._is_one_sweep():
            sweeps += self._close()
        return sweeps

    def flush(self) -> list[Sweep]:
        """Close the sweep that waits for missing IMUs, if there is one: at a timeout and at the end of a recording."""
        if not self._fresh:
            return []
        for index, imu in enumerate(self._imus):
            if self._used[index] and imu.alive and index not in self._fresh:
                imu.alive = False
                self._n_alive -= 1
        return self._close()

    def waiting_since(self) -> int | None:
        """Stamp of the first sample of a sweep that is not complete, ns."""
        return next(iter(self._fresh.values()), None)

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

    def _is_one_sweep(self) -> bool:
        """Whether the complete set of samples was taken in one go.

        After a lost sample, or when listening began in the middle, the set may begin with the end of one sweep and end
        with the beginning of the next. Then its largest gap is much longer than the pause before the next round would
        be; the samples before the gap are let go, and the set is completed by those that follow.
        """
        stamps = sorted((self._imus[i].last_ns, i) for i in self._fresh)
        span = stamps[-1][0] - stamps[0][0]
        periods = [
            imu.last_ns - imu.before_ns
            for imu in (self._imus[i] for i in self._fresh)
            if imu.before is not None
        ]
        if not periods or 2 * span <= min(periods):
            return True
        gap, cut = max((stamps[k + 1][0] - stamps[k][0], k + 1) for k in range(len(stamps) - 1))
        pause = min(periods) - span
        if gap <= 2 * pause or 4 * gap <= min(periods):
            return True
        for _, index in stamps[:cut]:
            del self._fresh[index]
        self._fresh = {index: stamp for stamp, index in stamps[cut:]}
        self.dropped['of a sweep that was not whole'] += cut
        return False

    def _close(self) -> list[Sweep]:
        if self._has_base and (self._imus[self.n_imu].last is None or set(self._fresh) == {self.n_imu}):
            self.dropped['of a sweep without the base, or with nothing but it'] += len(self._fresh)
            self._fresh.clear()
            return []
        stamps = [self._imus[i].last_ns for i in self._fresh]
        orientations = np.zeros((self.n_imu, 4))
        orientations[:, 3] = 1.0
        measured = np.zeros(self.n_imu, dtype=bool)
        for index in self._fresh:
            if index < self.n_imu:
                orientations[index] = self._imus[index].last
                measured[index] = True
        base = None
        if self._has_base:
            on_base = self._imus[self.n_imu].last
            base = None if on_base is None else np.array(on_base)
        stamp_ns = max(stamps)
        if self._interpolate:
            stamp_ns = min(stamps)
            self._to_instant(stamp_ns, orientations, measured)
            if base is not None:
                base = self._at(self._imus[self.n_imu], stamp_ns)
        self._fresh.clear()
        return [Sweep(stamp_ns, orientations, measured, base)]

    def _to_instant(self, stamp_ns: int, orientations: FloatArray, measured: np.ndarray) -> None:
        for index in np.flatnonzero(measured):
            orientations[index] = self._at(self._imus[index], stamp_ns)

    @staticmethod
    def _at(imu: _Imu, stamp_ns: int) -> FloatArray:
        """Orientation at an instant between the last two samples; the last one where there is no earlier."""
        last = np.array(imu.last)
        if imu.before is None or not imu.before_ns <= stamp_ns < imu.last_ns:
            return last
        return slerp(np.array(imu.before), last, (stamp_ns - imu.before_ns) / (imu.last_ns - imu.before_ns))
