"""What feedback may not be steered by: old, repeated, frozen, jumped, or at odds with the encoders."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from sesa2.shape.rotations import FloatArray

# An IMU that repeats itself to the last bit for so long, s, while what carries it turned by so much, rad, is frozen: a
# chip of an arm that has arrived repeats itself too.
FROZEN_S = 0.1
_TURNED = 0.05
_CARRIED = 0.15
# Slip lets an IMU's bend follow that of the encoders by anything from nearly nothing to all of it, and not the same in
# all directions; errors of heading turn it against theirs, and a push moves it besides. In the last seconds it may have
# gone this much farther than all that the encoders did, rad, there and back; and where they bent the segment by more
# than this, it has to have followed by some share.
WINDOW_S = 3.0
DISAGREEMENT = 0.8
_FOLLOWED = 0.03
_EVERY_S = 0.05
# A tip may move a few times as fast as it is driven, and as far as this at once, m: noise, a push.
_TIMES_FASTER = 3.0
_AT_ONCE = 0.012


class FeedbackWatch:
    """Judges feedback by the steady clock of its receipt; stamps only have to go on.

    Parameters
    ----------
    timeout
        age of receipt at which feedback is too old, s.
    tip_speed
        at which the tip is driven, m/s.
    imu_places
        by IMU, its material arc length as a fraction of each segment, (m,): 0 before it, 1 beyond it.
    """

    def __init__(self, timeout: float, tip_speed: float, imu_places: dict[int, FloatArray]):
        self._timeout, self._tip_speed, self._places = timeout, tip_speed, imu_places
        self._inwards = sorted(imu_places, key=lambda i: float(imu_places[i].sum()))
        self.begin()

    def begin(self) -> None:
        """Forget what was: what is heard from now on counts."""
        self._tip: FloatArray | None = None
        self._tip_stamp = self._lengths_stamp = -1
        self._heard: dict[str, float] = {}
        self._encoders: FloatArray | None = None
        self._bends: deque[tuple[float, FloatArray, FloatArray]] = deque()
        self._quaternions: dict[int, tuple[bytes, float, FloatArray | None, dict[int, FloatArray]]] = {}
        self._latest: dict[int, FloatArray] = {}
        self._fault = ''

    def hear_tip(self, now: float, stamp_ns: int, tip: FloatArray, bends: FloatArray) -> None:
        """An estimate: when it was received, s; of which instant, ns; tip, (3,), m; bends, (m, 2), rad."""
        if stamp_ns <= self._tip_stamp:
            return  # stamps that stand still are no news
        if self._tip is not None:
            dt = (stamp_ns - self._tip_stamp) * 1e-9
            jump, most = (
                float(np.linalg.norm(tip - self._tip)),
                _TIMES_FASTER * self._tip_speed * dt + _AT_ONCE,
            )
            if jump > most:
                self._say(
                    f'the estimated tip jumped by {1e3 * jump:.0f} mm in {1e3 * dt:.0f} ms (at most {1e3 * most:.0f}): '
                    'an IMU was knocked, or aligned anew'
                )
        self._tip, self._tip_stamp = tip, stamp_ns
        self._heard['the estimate of the tip'] = now
        if self._encoders is not None:
            self._compare(now, bends, self._encoders)

    def _compare(self, now: float, by_imu: FloatArray, by_encoders: FloatArray) -> None:
        if self._bends and now - self._bends[-1][0] < _EVERY_S:
            return
        self._bends.append((now, by_imu, by_encoders))
        while now - self._bends[0][0] > WINDOW_S:
            self._bends.popleft()
        imu, encoders = (np.array(of) for of in list(zip(*self._bends, strict=True))[1:])
        went, way = by_imu - imu, ((by_encoders - encoders) ** 2).sum(axis=-1)
        # What racks slip on the way stays where they come back, so the whole way counts.
        strides = np.linalg.norm(np.diff(encoders, axis=0), axis=-1)
        path = np.concatenate([np.cumsum(strides[::-1], axis=0)[::-1], np.zeros((1, len(by_imu)))])
        astray = np.linalg.norm(went, axis=-1) - path
        far = way > DISAGREEMENT**2
        excursion = np.maximum.accumulate((went**2).sum(axis=-1)[::-1])[::-1]  # since then, and now
        still = far & (excursion < _FOLLOWED**2 * way)
        if still.any():
            _, k = np.argwhere(still)[0]
            self._say(
                f'segment {k + 1}: the encoders bent it by more than {DISAGREEMENT:g} rad within {WINDOW_S:g} s and '
                'its IMU saw nothing of it: it is frozen, or the racks have lost their hold'
            )
        elif (astray > DISAGREEMENT).any():
            _, k = np.unravel_index(int(np.argmax(astray)), astray.shape)
            self._say(
                f'segment {k + 1}: within {WINDOW_S:g} s its bend by IMU went {astray.max():.1f} rad farther than by '
                f'the encoders (at most {DISAGREEMENT:g}): an IMU is loose'
            )

    def hear_lengths(self, now: float, stamp_ns: int, bends: FloatArray) -> None:
        """Measured lengths that are in order: when, s; of which instant, ns; bends that they tell, (m, 2), rad."""
        if stamp_ns <= self._lengths_stamp:
            return
        self._lengths_stamp = stamp_ns
        self._heard['the lengths of the backbones'] = now
        self._encoders = bends

    def hear_imu(self, now: float, imu_id: int, orientation: Sequence[float]) -> None:
        """What an IMU measures, x y z w, as it came."""
        q = np.asarray(orientation, dtype=float)
        raw = q.tobytes()
        self._latest[imu_id] = q
        before = self._quaternions.get(imu_id)
        if before is None or before[0] != raw:
            self._quaternions[imu_id] = (raw, now, self._encoders, dict(self._latest))
            return
        _, since, encoders, others = before
        if now - since < FROZEN_S:
            return
        if encoders is None and self._encoders is not None:
            self._quaternions[imu_id] = (raw, since, self._encoders, others)
        elif encoders is not None and self._encoders is not None:
            places = self._places[imu_id]
            turned = float(np.linalg.norm(places @ (self._encoders - encoders)))
            if turned > _TURNED:
                self._say(
                    f'IMU {imu_id} is frozen: the same orientation for {now - since:.1f} s, in which the encoders '
                    f'turned it by {np.degrees(turned):.0f}°'
                )
        for other in self._inwards[: self._inwards.index(imu_id)]:
            if other in others and other in self._latest:
                turned = _angle(others[other], self._latest[other])
                if turned > _CARRIED:
                    self._say(
                        f'IMU {imu_id} is frozen: the same orientation for {now - since:.1f} s, in which IMU {other}, '
                        f'nearer to the base, turned by {np.degrees(turned):.0f}°'
                    )

    def _say(self, fault: str) -> None:
        self._fault = self._fault or fault

    def fault(self, now: float) -> str:
        """Why it may not be steered by now, s; empty where it may."""
        if self._fault:
            return self._fault
        for what in ('the estimate of the tip', 'the lengths of the backbones'):
            at = self._heard.get(what)
            if at is None:
                return f'{what} is not there' if what.endswith('tip') else f'{what} are not there'
            if now - at > self._timeout:
                return f'{what}: nothing new for {now - at:.1f} s (at most {self._timeout:g})'
        return ''


def _angle(p: FloatArray, q: FloatArray) -> float:
    return 2.0 * float(np.arccos(np.clip(abs(p @ q), 0.0, 1.0)))
