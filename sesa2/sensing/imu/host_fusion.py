"""Orientation of an IMU from its angular velocity, acceleration and magnetic field, by the library vqf (extra `raw`).

Source: Laidig and Seel, VQF: highly accurate IMU orientation estimation with bias estimation and magnetic disturbance
rejection, Information Fusion 91 (2023).

The filter wants a fixed period. It is the median of the first intervals; until that is known, a first guess stands in.
Each angular velocity is scaled by the true interval over the period, so that what is integrated is the angle that was
turned, however irregular the stamps are. Gaps up to `FILLED_NS` are filled with straight lines between the samples.
"""

import math
from collections import Counter, deque
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from sesa2.errors import Sesa2Error
from sesa2.shape.rotations import FloatArray, multiply
from sesa2.time import NS

if TYPE_CHECKING:
    from vqf import VQF

FILLED_NS = NS // 2  # a longer gap is a pause, in which the IMU may have turned anyhow
BACK_NS = NS  # a step back by more than this is another time, less is a late or repeated sample
_AHEAD_NS = 10 * NS  # a step ahead by more than this is doubtful
_LEARNT_FROM = 11  # samples
_FIRST_GUESS = 0.01  # s
_SHORTEST = 0.0005  # s
_STALE_NS = NS  # a heading without a magnetic field for longer drifts
_FIELDS_MAX = 10_000
# A gyroscope's range is 2000°/s; of an accelerometer that tells m/s², gravity alone is 9.8.
_FASTEST = 36.0
_GRAVITY_FROM, _GRAVITY_TO = 3.0, 40.0
_W_LAST = [1, 2, 3, 0]

# Why a sample gives no orientation.
NOT_NEWER = 'not newer than the last of its IMU'
ANOTHER_TIME = 'stamped at another time than the rest of its IMU'
NO_FIELD_YET = 'before the first magnetic field of its IMU'
NOT_FINITE = 'angular velocity or acceleration is not a number'
NO_ACCELERATION = 'acceleration is all zero'
TOO_FAST = 'angular velocity is beyond 36 rad/s: is it in degrees per second?'


class HostFusion:
    """The filter of one IMU: samples in order of time in, q_WS out.

    W is z up. With a magnetometer its y points to magnetic north; without one the heading is what it happens to be at
    the start, and drifts by what is left of the gyroscope's bias (0.01 to 0.1°/s). After a pause of more than
    `FILLED_NS` the heading and the bias go on, and the inclination begins anew; after a step back in time, all does.
    One sample alone that is stamped far from the rest is left out.

    Parameters
    ----------
    magnetometer
        whether its magnetic field gives the heading.

    Attributes
    ----------
    refused
        number of samples without orientation, by reason.
    restarts
        how often it began anew.
    without_field
        number of orientations whose heading had drifted for more than 1 s without a magnetic field.

    Raises
    ------
    Sesa2Error
        vqf is not installed.
    """

    def __init__(self, *, magnetometer: bool = False):
        try:
            from vqf import VQF
        except ImportError:
            raise Sesa2Error(
                "imus.fusion: fusing on the host needs the package vqf: pip install 'sesa2[raw]'"
            ) from None
        self._make = VQF
        self._magnetometer = magnetometer
        self.refused: Counter[str] = Counter()
        self.restarts = self.without_field = 0
        self._mean_acceleration: float | None = None
        self._fields: deque[tuple[int, FloatArray]] = deque()
        self._begin()

    def _begin(self) -> None:
        self._set_up(_FIRST_GUESS)
        self._learning: list[tuple[int, FloatArray, FloatArray]] | None = []
        self._used_fields: list[tuple[int, FloatArray]] = []  # while it learns
        self._doubtful_ns: int | None = None

    def _set_up(self, period: float) -> None:
        self._filter: VQF = self._make(period)
        self._period = period
        self._last: tuple[int, FloatArray, FloatArray] | None = None
        self._field_ns: int | None = None

    @property
    def bias(self) -> FloatArray:
        """The gyroscope's bias as it is estimated, (3,), rad/s."""
        return np.array(self._filter.getBiasEstimate()[0])

    @property
    def doubts(self) -> list[str]:
        """What looks wrong with its samples, for people."""
        mean = self._mean_acceleration
        found = []
        if mean is not None and not _GRAVITY_FROM < mean < _GRAVITY_TO:
            hint = ': is it in g?' if mean < _GRAVITY_FROM else ''
            found.append(f'its acceleration is {mean:.3g} m/s², expected about 9.8 with gravity{hint}')
        if self.without_field:
            found.append(
                f'{self.without_field} orientations of a heading that drifts, without a magnetic field for over 1 s'
            )
        return found

    def add_field(self, stamp_ns: int, field: FloatArray) -> None:
        """Take a magnetic field in the sensor's axes, (3,), of any unit; it may arrive before or after its sample."""
        x, y, z = field.tolist()
        if 0.0 < x * x + y * y + z * z < math.inf:
            self._fields.append((stamp_ns, field))
            if len(self._fields) > _FIELDS_MAX:
                self._fields.popleft()

    def add(self, stamp_ns: int, angular_velocity: FloatArray, acceleration: FloatArray) -> FloatArray | None:
        """Take a sample.

        Parameters
        ----------
        stamp_ns
            time of the measurement, ns.
        angular_velocity : (3,)
            rad/s, in the sensor's axes.
        acceleration : (3,)
            with gravity, which at rest points up: m/s², in the sensor's axes.

        Returns
        -------
        q_WS, (4,), x y z w; None where there is none, which `refused` counts.
        """
        if reason := self._unfit(angular_velocity, acceleration) or self._out_of_time(stamp_ns):
            self.refused[reason] += 1
            return None
        self._step(stamp_ns, angular_velocity, acceleration)
        if self._learning is not None:
            self._learn(stamp_ns, angular_velocity, acceleration)
        if not self._magnetometer:
            return self._filter.getQuat6D()[_W_LAST]
        if self._field_ns is None:
            self.refused[NO_FIELD_YET] += 1
            return None
        self.without_field += stamp_ns - self._field_ns > _STALE_NS
        return self._filter.getQuat9D()[_W_LAST]

    def add_many(
        self, stamps_ns: np.ndarray, angular_velocities: FloatArray, accelerations: FloatArray
    ) -> FloatArray:
        """Take many samples, with the same result as one by one.

        Parameters
        ----------
        stamps_ns : (n,), angular_velocities : (n, 3) and accelerations : (n, 3)
            as in `add`.

        Returns
        -------
        q_WS, (n, 4), x y z w; NaN where there is none.
        """
        out = np.full((len(stamps_ns), 4), np.nan)
        k = 0
        while k < len(stamps_ns):
            rest = slice(k, None)
            n, scales = self._without_doubt(stamps_ns[rest], angular_velocities[rest], accelerations[rest])
            if n > 1:
                rows = slice(k, k + n)
                gyr = angular_velocities[rows] * scales[:, None]
                out[rows] = self._add_regular(gyr, accelerations[rows])
                k += n
                self._last = (int(stamps_ns[k - 1]), angular_velocities[k - 1], accelerations[k - 1])
                continue
            q = self.add(int(stamps_ns[k]), angular_velocities[k], accelerations[k])
            if q is not None:
                out[k] = q
            k += 1
        return out

    def _without_doubt(
        self, stamps_ns: np.ndarray, gyr: FloatArray, acc: FloatArray
    ) -> tuple[int, FloatArray]:
        """How many samples follow each other without any that needs a second look, and by what each is scaled."""
        if self._learning is not None or self._last is None or self._doubtful_ns is not None:
            return 0, np.empty(0)
        intervals = np.diff(stamps_ns, prepend=self._last[0])
        scales = intervals / NS / self._period
        with np.errstate(invalid='ignore'):
            good = (scales > 0.0) & (scales < 1.5) & ((gyr**2).sum(axis=1) <= _FASTEST**2)
            good &= np.isfinite(acc).all(axis=1) & acc.any(axis=1)
        if self._magnetometer:
            # One field to each sample, beginning with that of the last one before these.
            n = min(len(self._fields) - 1, len(good))
            if n < 1 or self._field_ns is None:
                return 0, scales
            fields_ns = np.fromiter((f[0] for f in islice(self._fields, n + 1)), np.int64, n + 1)
            until_ns = stamps_ns[:n] - intervals[:n] + self._reach_ns(intervals[:n])
            good = good[:n] & (fields_ns[:-1] <= until_ns)
            good &= (fields_ns[1:] > until_ns) & (fields_ns[1:] <= stamps_ns[:n])
        n = len(good) if good.all() else int(np.argmin(good))
        return n, scales[:n]

    def _add_regular(self, scaled: FloatArray, acc: FloatArray) -> FloatArray:
        """Take samples that follow each other without doubt; q_WS, (n, 4), x y z w."""
        gyr, acc = np.ascontiguousarray(scaled), np.ascontiguousarray(acc, dtype=float)
        if not self._magnetometer:
            return self._filter.updateBatch(gyr, acc)['quat6D'][:, _W_LAST]
        # vqf takes a row's field after its sample: so the fields of the samples before are one row ahead.
        self._filter.updateMag(np.array(self._fields.popleft()[1], dtype=float))
        first = self._filter.getDelta()
        fields = [self._fields.popleft() for _ in range(len(gyr))]
        self._field_ns = fields[-1][0]
        found = self._filter.updateBatch(gyr, acc, np.array([f[1] for f in fields], dtype=float))
        headings = np.append(first, found['delta'][:-1])
        about_z = np.zeros((len(gyr), 4))
        about_z[:, 2], about_z[:, 3] = np.sin(0.5 * headings), np.cos(0.5 * headings)
        return multiply(about_z, found['quat6D'][:, _W_LAST])

    @staticmethod
    def _unfit(gyr: FloatArray, acc: FloatArray) -> str:
        (x, y, z), (a, b, c) = gyr.tolist(), acc.tolist()
        rate2, acceleration2 = x * x + y * y + z * z, a * a + b * b + c * c
        if not math.isfinite(rate2 + acceleration2):
            return NOT_FINITE
        if acceleration2 == 0.0:
            return NO_ACCELERATION
        return TOO_FAST if rate2 > _FASTEST**2 else ''

    def _out_of_time(self, stamp_ns: int) -> str:
        """Why a sample is left out for its stamp; begins anew where the time of the samples is another one."""
        if self._last is None:
            return ''
        interval = stamp_ns - self._last[0]
        if -BACK_NS <= interval <= 0:
            return NOT_NEWER
        if -BACK_NS <= interval <= _AHEAD_NS:
            self._doubtful_ns = None
            if interval > FILLED_NS:
                self._go_on()
            return ''
        doubtful, self._doubtful_ns = self._doubtful_ns, stamp_ns
        if doubtful is None or not 0 < stamp_ns - doubtful <= FILLED_NS:
            return ANOTHER_TIME
        self._doubtful_ns = None
        while self._fields and abs(self._fields[0][0] - stamp_ns) > BACK_NS:
            self._fields.popleft()  # of the time before
        if interval > 0:
            self._go_on()
        else:
            self.restarts += 1
            self._begin()
        return ''

    def _go_on(self) -> None:
        """Keep heading and bias; the mean acceleration, which tells the inclination, begins anew."""
        self.restarts += 1
        if self._learning is not None:
            self._begin()
            return
        if self._last is not None:
            self._take_fields(self._last[0] + int(self._reach_ns(FILLED_NS)))
        state = self._filter.state
        state['accLpState'] = np.full_like(state['accLpState'], np.nan)
        self._filter.state = state
        self._last = None

    def _step(self, stamp_ns: int, gyr: FloatArray, acc: FloatArray) -> None:
        if self._last is None:
            self._filter.update(np.zeros(3), np.array(acc, dtype=float))
        else:
            last_ns, last_gyr, last_acc = self._last
            self._take_fields(last_ns + int(self._reach_ns(stamp_ns - last_ns)))
            interval = (stamp_ns - last_ns) / NS / self._period
            n = max(1, int(interval + 0.5))
            scale = interval / n
            for i in range(1, n):
                part = i / n
                self._filter.update(
                    (last_gyr + part * (gyr - last_gyr)) * scale, last_acc + part * (acc - last_acc)
                )
            self._filter.update(gyr * scale, np.array(acc, dtype=float))
        self._last = (stamp_ns, gyr, acc)

    def _reach_ns(self, intervals_ns: Any) -> Any:
        """How long after a sample a field is still its own, and not the next one's."""
        return np.minimum(intervals_ns // 2, round(0.5 * self._period * NS))

    def _take_fields(self, until_ns: int) -> None:
        """Those of a time are taken when the next sample comes: by then they have arrived, live as in a recording."""
        while self._magnetometer and self._fields and self._fields[0][0] <= until_ns:
            self._field_ns, field = self._fields.popleft()
            self._filter.updateMag(np.array(field, dtype=float))
            if self._learning is not None:
                self._used_fields.append((self._field_ns, field))

    def _learn(self, stamp_ns: int, gyr: FloatArray, acc: FloatArray) -> None:
        """The period from the first samples, which then are taken once more."""
        assert self._learning is not None
        self._learning.append((stamp_ns, gyr, acc))
        if len(self._learning) < _LEARNT_FROM:
            return
        samples, self._learning = self._learning, None
        self._mean_acceleration = float(np.mean([np.linalg.norm(a) for _, _, a in samples]))
        intervals = np.diff([stamp for stamp, _, _ in samples]) / NS
        # Samples that come in bursts tell their period in the mean alone.
        period = float(np.median(intervals))
        period = period if period > 0.5 * intervals.mean() else float(intervals.mean())
        self._fields.extendleft(reversed(self._used_fields))
        self._set_up(max(period, _SHORTEST))
        for sample in samples:
            self._step(*sample)
