"""One IMU on its way into sweeps: the samples that wait, and which of them can be used."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from sesa2.shape.rotations import FloatArray, slerp
from sesa2.time import NS

# The chip's own rounding leaves norms within 2e-4 of 1.
NORM_TOLERANCE = 0.02
# The gyroscope's range is 2000°/s = 35 rad/s: a faster turn is a damaged sample. The constant part lets stamps jitter.
MAX_TURN_RATE = 35.0
TURN_SLACK = 0.5
Quaternion = tuple[float, float, float, float]


class WaitingSample(NamedTuple):
    """A sample that waits for its sweep; arrival on the clock, ns."""

    stamp_ns: int
    q: Quaternion
    arrival_ns: int


class ImuQueue:
    """What is known of one IMU: the samples that wait for a sweep, and the last that went into one."""

    __slots__ = ('alive', 'heard_ns', 'last', 'last_ns', 'unusable_ns', 'used', 'used_ns', 'waiting')

    def __init__(self) -> None:
        self.waiting: deque[WaitingSample] = deque()
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self.alive = True
        self.waiting.clear()
        self.last: Quaternion | None = None
        self.used: Quaternion | None = None
        self.last_ns = self.used_ns = self.heard_ns = self.unusable_ns = 0

    def use(self) -> None:
        """Take the first waiting sample."""
        self.used_ns, self.used, _ = self.waiting.popleft()

    @staticmethod
    def between(before: Quaternion, after: Quaternion, fraction: float) -> FloatArray:
        """What it would have measured between two samples."""
        return slerp(np.array(before), np.array(after), fraction)

    def usable(self, stamp_ns: int, x: float, y: float, z: float, w: float) -> Quaternion | str:
        """A sample's unit quaternion, or why it has none."""
        norm2 = x * x + y * y + z * z + w * w
        if norm2 == 0.0:
            return 'all zero, not measured'
        if not abs(norm2 - 1.0) < 2.0 * NORM_TOLERANCE:
            return 'norm is not 1' if math.isfinite(norm2) else 'not a number'
        scale = 1.0 / math.sqrt(norm2)
        x, y, z, w = x * scale, y * scale, z * scale, w * scale
        if self.last is not None:
            lx, ly, lz, lw = self.last
            cosine = abs(x * lx + y * ly + z * lz + w * lw)
            allowed = TURN_SLACK + MAX_TURN_RATE * (stamp_ns - self.last_ns) / NS
            if cosine < 1.0 and allowed < math.pi and 2.0 * math.acos(cosine) > allowed:
                return 'turned faster than the sensor can'
        return x, y, z, w
