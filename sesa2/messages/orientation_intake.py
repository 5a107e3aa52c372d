"""Orientations out of the IMUs' messages: as a driver measured them, or fused here from what it did measure."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sesa2.configuration import Configuration
from sesa2.configuration.kept_accelerometers import keep_accelerometers
from sesa2.messages.field_messages import read_field
from sesa2.messages.imu_messages import (
    ACCELERATION,
    ANGULAR_VELOCITY,
    NO_ACCELERATION_AT,
    NO_ANGULAR_VELOCITY_AT,
    NO_ORIENTATION_AT,
    ImuNumbers,
    ImuSample,
    is_inertial,
    read_imu_values,
    read_imus,
)
from sesa2.sensing.imu.accelerometer_calibration import KeptAccelerometers
from sesa2.sensing.imu.gravity_check import GravityCheck
from sesa2.sensing.imu.host_fusion import HostFusion
from sesa2.shape.rotations import FloatArray, tangent

NO_ORIENTATION = 'the driver says that it gives no orientation (orientation_covariance[0] is −1)'
ALL_ZERO = 'the driver gives an orientation of zeros alone'
NOTHING_TO_FUSE = 'the driver gives no angular velocity or no acceleration, which imus.fusion needs'

_BLOCKS_LOOKED_AT = 4  # of recordings one of so many blocks is
_LOOKED_AT = 10  # one of so many samples is looked at for whether it can be

_UPRIGHT = 0.5  # cosine of an arm to the vertical that stands or hangs rather than lies

_AS_THEY_ARE = KeptAccelerometers({})


def unaligned_headings(fusion: str, headings: Sequence[float]) -> list[str]:
    """What has to be said where headings that mean nothing yet are taken as they are, for people."""
    if fusion != '6d' or any(headings):
        return []
    text = 'take them from the arm held straight (sesa2 align --headings; live, estimator/align_headings)'
    return [
        f'imus.fusion: 6d gives each IMU a heading of its own at every start; imus.headings are all 0: {text}'
    ]


class TakenOrientations(NamedTuple):
    """What messages tell.

    Attributes
    ----------
    stamps_ns : (n,)
        ns.
    orientations : (n, 4)
        q_WS, x y z w.
    readable : (n,)
        false where it is no message of an IMU.
    usable : (n,)
        true where there is an orientation; it may still be none that is believed.
    """

    stamps_ns: np.ndarray
    orientations: FloatArray
    readable: np.ndarray
    usable: np.ndarray


class OrientationIntake:
    """Stands between messages and sweeps, live and in recordings alike.

    Parameters
    ----------
    fusion
        none, 6d or 9d, as in `imus.fusion`.
    ids
        of the IMUs that are used.
    accelerometers
        calibrations that are applied before fusion.
    base_tells
        whether the base shows if the earth frame points down, so that nothing else need.

    Attributes
    ----------
    refused
        number of samples without orientation of each IMU, by id and reason.

    Raises
    ------
    Sesa2Error
        fusion is wanted, and vqf is not installed.
    """

    def __init__(
        self,
        fusion: str,
        ids: Sequence[int],
        accelerometers: KeptAccelerometers = _AS_THEY_ARE,
        base_tells: bool = False,
    ):
        self._accelerometers = accelerometers
        self.wants_fields = fusion == '9d'
        self._filters = (
            {} if fusion == 'none' else {i: HostFusion(magnetometer=self.wants_fields) for i in ids}
        )
        self._ids = list(ids)
        self.fuses = fusion != 'none'
        self._own: Counter[tuple[int, str]] = Counter()
        self._has_inertial: set[int] = set()
        self._gravity = GravityCheck(base_tells)
        self._taken: Counter[int] = Counter()
        self._n_blocks = 0

    @property
    def refused(self) -> dict[int, Counter[str]]:
        """Number of samples without orientation, by id and reason."""
        found: dict[int, Counter[str]] = defaultdict(Counter)
        for (imu, reason), n in self._own.items():
            found[imu][reason] += n
        for imu, one in self._filters.items():
            if one.refused:
                found[imu].update(one.refused)
        return dict(sorted(found.items()))

    @property
    def reasons(self) -> list[str]:
        """How many samples were refused and why, and what to do, for people."""
        by_reason: Counter[str] = Counter()
        ids: dict[str, list[int]] = defaultdict(list)
        for imu, reasons in self.refused.items():
            by_reason.update(reasons)
            for reason in reasons:
                ids[reason].append(imu)
        return [
            f'{n} samples not used: {reason}{self._remedy(reason, ids[reason])}'
            for reason, n in by_reason.items()
        ]

    @property
    def doubts(self) -> list[str]:
        """What looks wrong with what is fused, for people."""
        return (
            list(self._accelerometers.problems)
            + self._gravity.doubts
            + [f'IMU {imu}: {doubt}' for imu, one in sorted(self._filters.items()) for doubt in one.doubts]
            + [
                f'IMU {imu}: its fusion began anew {one.restarts} times, after pauses or steps of time'
                for imu, one in sorted(self._filters.items())
                if one.restarts
            ]
        )

    def why(self, imu: int) -> str:
        """Why most samples of an IMU were refused, and what to do; empty where none was."""
        reasons = self.refused.get(imu)
        if not reasons:
            return ''
        reason = reasons.most_common(1)[0][0]
        return reason + self._remedy(reason, [imu])

    def _remedy(self, reason: str, ids: Sequence[int]) -> str:
        if reason not in (NO_ORIENTATION, ALL_ZERO):
            return ''
        if self._has_inertial.issuperset(ids):
            return (
                '; it gives angular velocity and acceleration, which imus.fusion: 6d makes an orientation of'
            )
        return '; without angular velocity and acceleration none can be made of it'

    @classmethod
    def of(cls, c: Configuration) -> 'OrientationIntake':
        """As a configuration wants it."""
        upright = abs(float(tangent(np.array(c.arm.base_orientation))[2])) > _UPRIGHT
        base_tells = upright or bool(c.imus.base_id)
        return cls(c.imus.fusion, c.imus.used_ids, keep_accelerometers(c), base_tells)

    def take_field(self, imu: int, data: bytes) -> None:
        """Take a sensor_msgs/MagneticField in CDR.

        Raises
        ------
        Sesa2Error
            it is too short to be one.
        """
        if imu in self._filters:
            self._filters[imu].add_field(*read_field(data))

    def take(self, imu: int, data: bytes) -> ImuSample | None:
        """Take a sensor_msgs/Imu in CDR; its sample, None where it has no orientation, which `refused` counts.

        Raises
        ------
        Sesa2Error
            it is too short to be one.
        """
        stamp_ns, values = read_imu_values(data)
        reason = ''
        orientation: Sequence[float] = values[:4]
        if not self.fuses:
            if values[NO_ORIENTATION_AT] == -1.0:
                reason = NO_ORIENTATION
                self._note_inertial(imu, values)
            elif not any(orientation) and is_inertial(values):
                reason = ALL_ZERO
                self._has_inertial.add(imu)
            elif self._taken[imu] % _LOOKED_AT == 0:
                self._look_at(imu, np.array([values]))
            self._taken[imu] += 1
        elif not is_inertial(values):
            reason = NOTHING_TO_FUSE
        else:
            acceleration = self._corrected(imu, np.array(values[ACCELERATION]))
            fused = self._filters[imu].add(stamp_ns, np.array(values[ANGULAR_VELOCITY]), acceleration)
            if fused is None:
                return None
            orientation = fused.tolist()
        if reason:
            self._own[imu, reason] += 1
            return None
        return ImuSample(stamp_ns, *orientation)

    def _corrected(self, imu: int, accelerations: FloatArray) -> FloatArray:
        calibration = self._accelerometers.calibrations.get(imu)
        return calibration.apply(accelerations) if calibration else accelerations

    def _note_inertial(self, imu: int, values: Sequence[float]) -> None:
        if is_inertial(values):
            self._has_inertial.add(imu)

    def take_many(self, ids: np.ndarray, data: Sequence[bytes]) -> TakenOrientations:
        """Take messages, in the order in which they came.

        Parameters
        ----------
        ids : (n,)
            of the IMUs.
        data
            each a sensor_msgs/Imu in CDR.
        """
        read = read_imus(data)
        ours = np.isin(ids, self._ids) & read.readable
        if not self.fuses:
            return self._as_measured(ids, read, ours)
        # Of IMUs that are not used nobody asks.
        orientations = np.where(np.isin(ids, self._ids)[:, None], np.nan, np.zeros(4))
        self._own.update((i, NOTHING_TO_FUSE) for i in ids[ours & ~read.has_inertial].tolist())
        for imu, one in self._filters.items():
            rows = np.flatnonzero(ours & read.has_inertial & (ids == imu))
            if len(rows):
                orientations[rows] = one.add_many(
                    read.stamps_ns[rows],
                    read.angular_velocities[rows],
                    self._corrected(imu, read.accelerations[rows]),
                )
        return TakenOrientations(
            read.stamps_ns,
            orientations,
            read.readable,
            read.readable & np.isfinite(orientations).all(axis=1),
        )

    def _as_measured(self, ids: np.ndarray, read: ImuNumbers, ours: np.ndarray) -> TakenOrientations:
        absent = ~read.has_orientation
        zero = ~read.values[:, :4].any(axis=1)
        if zero.any():
            zero &= read.has_inertial & ~absent
        none = absent | zero
        self._n_blocks += 1
        if self._n_blocks % _BLOCKS_LOOKED_AT == 1:
            some = np.flatnonzero(ours & ~none)
            for imu in np.unique(ids[some]).tolist():
                self._look_at(imu, read.values[some[ids[some] == imu][::_LOOKED_AT]])
        if not none.any():
            return TakenOrientations(read.stamps_ns, read.orientations, read.readable, read.readable)
        for refused, reason in ((ours & absent, NO_ORIENTATION), (ours & zero, ALL_ZERO)):
            self._own.update((i, reason) for i in ids[refused].tolist())
            self._has_inertial.update(ids[refused & read.has_inertial].tolist())
        return TakenOrientations(read.stamps_ns, read.orientations, read.readable, read.readable & ~none)

    def _look_at(self, imu: int, values: FloatArray) -> None:
        """Whether orientation and acceleration agree."""
        q, w, a = values[:, :4], values[:, ANGULAR_VELOCITY].copy(), values[:, ACCELERATION].copy()
        w[values[:, NO_ANGULAR_VELOCITY_AT] == -1.0] = np.nan
        a[values[:, NO_ACCELERATION_AT] == -1.0] = np.nan
        self._gravity.add(imu, q, w, a)
