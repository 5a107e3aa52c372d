"""Single samples of the magnetometers put together into sweeps, by the same rules as those of the IMUs."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sesa2.estimation.imu_queue import NORM_TOLERANCE, ImuQueue, Quaternion
from sesa2.estimation.instants import Member
from sesa2.estimation.sweeps import NO_BASE, Sweep, SweepAssembler
from sesa2.shape.rotations import FloatArray

NO_FIELD = 'not a number, no field was measured'
_NO_ORIENTATIONS = np.zeros((0, 4))


class FieldQueue(ImuQueue):
    """One magnetometer on its way into sweeps: a sample is x, y, z, T, and a fourth number that means nothing."""

    __slots__ = ()

    @staticmethod
    def between(before: Quaternion, after: Quaternion, fraction: float) -> FloatArray:
        """What it would have measured between two samples."""
        return (1.0 - fraction) * np.array(before) + fraction * np.array(after)

    def usable(self, stamp_ns: int, x: float, y: float, z: float, w: float) -> Quaternion | str:
        """A sample with a field on any axis, or why it is none. What a field may be is the model's to judge."""
        del stamp_ns
        return NO_FIELD if math.isnan(x) and math.isnan(y) and math.isnan(z) else (x, y, z, w)


class FieldSweepAssembler(SweepAssembler):
    """A sweep when every living magnetometer has a newer sample, or when it is known that one is silent.

    Arms that have IMUs too have sweeps of their own for each kind: the kinds have rates of their own, and no model
    needs both. All that magnetometers take from an IMU is how the base is turned in the earth's field: the one on the
    base is taken as it was heard last.

    Parameters
    ----------
    enabled
        for each magnetometer, whether it is used.
    wants_base
        whether there is an IMU on the base; before it is heard there is no sweep.
    options
        as of SweepAssembler.

    Attributes
    ----------
    base : (4,) or None
        q_WS of the IMU on the base, as it was measured last.
    """

    queue = FieldQueue

    def __init__(self, enabled: Sequence[bool], *, wants_base: bool = False, **options: Any):
        super().__init__(enabled, **options)
        self._wants_base = wants_base
        self.base: FloatArray | None = None

    def take(
        self, index: int, stamp_ns: int, field: Sequence[float], arrival_ns: int | None = None
    ) -> list[Sweep]:
        """Take one sample, (3,), T, NaN on axes that are not there; see `add`."""
        x, y, z = field
        return self.add(index, stamp_ns, x, y, z, 0.0, arrival_ns)

    def hear_base(self, q: Sequence[float] | FloatArray) -> None:
        """Take what the IMU on the base measured, q_WS, (4,), x y z w; what is none is passed over."""
        norm = math.sqrt(sum(float(value) ** 2 for value in q))
        if abs(norm - 1.0) < NORM_TOLERANCE:
            self.base = np.array(q) / norm

    def _complete(self, *, whatever_the_clock: bool) -> list[Sweep]:
        sweeps = super()._complete(whatever_the_clock=whatever_the_clock)
        if self._wants_base and self.base is None:
            self.dropped[NO_BASE] += sum(int(np.count_nonzero(sweep.measured)) for sweep in sweeps)
            return []
        return sweeps

    def _sweep(self, members: list[Member]) -> Sweep:
        sweep = super()._sweep(members)
        fields = np.where(sweep.measured[:, None], sweep.orientations[:, :3], np.nan)
        return Sweep(sweep.stamp_ns, _NO_ORIENTATIONS, sweep.measured, self.base, fields=fields)
