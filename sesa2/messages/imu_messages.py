"""sensor_msgs/Imu as bytes."""

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sesa2.errors import Sesa2Error
from sesa2.messages.cdr import LITTLE_ENDIAN, CdrLayout
from sesa2.messages.header_bytes import read_header
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

TYPE = 'sensor_msgs/msg/Imu'
_STAMP, _FOUR = struct.Struct('<iI'), struct.Struct('<4d')
_SHORTEST = 16  # bytes that tell the layout
# Orientation (4), covariance (9), angular velocity (3), covariance (9), linear acceleration (3), covariance (9).
N_NUMBERS = 37
ANGULAR_VELOCITY, ACCELERATION = slice(13, 16), slice(25, 28)
# Where a covariance begins with −1, what it is of is absent (REP-145).
NO_ORIENTATION_AT, NO_ANGULAR_VELOCITY_AT, NO_ACCELERATION_AT = 4, 16, 28


class ImuSample(NamedTuple):
    """Stamp, ns, and orientation q_WS of a message."""

    stamp_ns: int
    x: float
    y: float
    z: float
    w: float


class ImuNumbers(NamedTuple):
    """What messages hold.

    Attributes
    ----------
    stamps_ns : (n,)
        ns.
    values : (n, 37)
        each message's numbers, in the order of its definition.
    readable : (n,)
        false where it is no message of an IMU.
    """

    stamps_ns: np.ndarray
    values: FloatArray
    readable: np.ndarray

    @property
    def orientations(self) -> FloatArray:
        """q_WS, (n, 4), x y z w; all zero where the driver says that there is none."""
        there = self.has_orientation
        return self.values[:, :4] if there.all() else np.where(there[:, None], self.values[:, :4], 0.0)

    @property
    def angular_velocities(self) -> FloatArray:
        """In the sensor's axes, (n, 3), rad/s."""
        return self.values[:, ANGULAR_VELOCITY]

    @property
    def accelerations(self) -> FloatArray:
        """With gravity, in the sensor's axes, (n, 3), m/s²."""
        return self.values[:, ACCELERATION]

    @property
    def has_orientation(self) -> np.ndarray:
        """Whether the driver does not say that there is no orientation, (n,)."""
        return self.values[:, NO_ORIENTATION_AT] != -1.0

    @property
    def has_inertial(self) -> np.ndarray:
        """Whether there are angular velocity and acceleration, (n,)."""
        absent = self.values[:, [NO_ANGULAR_VELOCITY_AT, NO_ACCELERATION_AT]] == -1.0
        return ~absent.any(axis=1) & self.accelerations.any(axis=1)


def is_inertial(values: Sequence[float]) -> bool:
    """Whether the 37 numbers of a message hold an angular velocity and an acceleration."""
    absent = values[NO_ANGULAR_VELOCITY_AT] == -1.0 or values[NO_ACCELERATION_AT] == -1.0
    return not absent and any(values[ACCELERATION])


def read_imu(data: bytes) -> ImuSample:
    """Read stamp and orientation; the orientation is all zero where the driver says that there is none.

    Parameters
    ----------
    data
        the serialised message, either byte order.

    Raises
    ------
    Sesa2Error
        it is too short to be one.
    """
    stamp_ns, values = read_imu_values(data)
    return ImuSample(stamp_ns, *(values[:4] if values[NO_ORIENTATION_AT] != -1.0 else (0.0, 0.0, 0.0, 0.0)))


def read_imu_values(data: bytes) -> tuple[int, tuple[float, ...]]:
    """Read stamp, ns, and all 37 numbers, in the order of the definition.

    Parameters
    ----------
    data
        the serialised message, either byte order.

    Raises
    ------
    Sesa2Error
        it is too short to be one.
    """
    try:
        order, stamp_ns, at = read_header(data)
        return stamp_ns, struct.unpack_from(f'{order}{N_NUMBERS}d', data, at)
    except (IndexError, struct.error):
        raise _too_short(data) from None


def read_imus(data: Sequence[bytes]) -> ImuNumbers:
    """Read many messages.

    Parameters
    ----------
    data
        the serialised messages, as in `read_imu`.
    """
    n = len(data)
    stamps, values = np.zeros(n, np.int64), np.empty((n, N_NUMBERS))
    readable = np.ones(n, dtype=bool)
    sizes = np.fromiter(map(len, data), np.int64, n)
    for size in np.unique(sizes).tolist():
        rows = np.flatnonzero(sizes == size)
        raw = np.frombuffer(b''.join([data[k] for k in rows.tolist()]), np.uint8).reshape(len(rows), size)
        # Those of the same size mostly are of the same layout.
        if (
            size >= _SHORTEST
            and raw[0, 1] & 1
            and (raw[:, [1, 12, 13, 14, 15]] == raw[0, [1, 12, 13, 14, 15]]).all()
        ):
            at = 4 + (12 + int(raw[0, 12:16].view('<u4')[0]) + 7) // 8 * 8
            if at + 8 * N_NUMBERS <= size:
                seconds, nanoseconds = raw[:, 4:12].copy().view('<u4').T
                stamps[rows] = seconds.astype('<i4').astype(np.int64) * NS + nanoseconds
                numbers = raw[:, at : at + 8 * N_NUMBERS].copy().view('<f8')
                if len(rows) == n:
                    values = numbers
                else:
                    values[rows] = numbers
                continue
        for k in rows.tolist():
            try:
                stamps[k], values[k] = read_imu_values(data[k])
            except Sesa2Error:
                values[k], readable[k] = 0.0, False
    return ImuNumbers(stamps, values, readable)


def without_acceleration(data: bytes) -> bytes:
    """The message with its acceleration marked as absent (REP-145), for whoever does not want it recorded.

    Parameters
    ----------
    data
        the serialised message, either byte order.

    Raises
    ------
    Sesa2Error
        it is too short to be one.
    """
    try:
        order, _, at = read_header(data)
        changed = bytearray(data)
        struct.pack_into(f'{order}4d', changed, at + 8 * ACCELERATION.start, 0.0, 0.0, 0.0, -1.0)
    except (IndexError, struct.error):
        raise _too_short(data) from None
    return bytes(changed)


def _too_short(data: bytes) -> Sesa2Error:
    return Sesa2Error(f'a {TYPE} message of {len(data)} bytes, expected at least 316')


class ImuMessages:
    """Makes the messages of one IMU, as REP-145 wants them: covariance unknown, absent fields −1 first."""

    def __init__(self, frame_id: str):
        self._template = CdrLayout().header(frame_id).doubles(N_NUMBERS).template()
        # A message that is made alone is put together of these, which is much faster than numpy is with one.
        message = self._template.make(np.zeros(1, np.int64), self._values(np.zeros((1, 4))))[0].tobytes()
        at = read_header(message).doubles_at
        q, a, end = (at + 8 * k for k in (4, ACCELERATION.start, NO_ACCELERATION_AT + 1))
        self._frame, self._middle = message[12:at], message[q:a]
        self._no_acceleration, self._rest = message[a:end], message[end:]

    def make(
        self,
        stamp_ns: int,
        orientation: FloatArray | Sequence[float],
        acceleration: FloatArray | Sequence[float] | None = None,
    ) -> bytes:
        """One message.

        Parameters
        ----------
        stamp_ns
            time of the measurement, ns.
        orientation : (4,)
            q_WS, x y z w.
        acceleration : (3,), optional
            with gravity, in the sensor's axes, m/s².
        """
        accelerated = self._no_acceleration if acceleration is None else _FOUR.pack(*acceleration, 0.0)
        stamp = _STAMP.pack(*divmod(stamp_ns, NS))
        q = _FOUR.pack(*orientation)
        return b''.join((LITTLE_ENDIAN, stamp, self._frame, q, self._middle, accelerated, self._rest))

    def make_many(self, stamps_ns: np.ndarray, orientations: np.ndarray) -> np.ndarray:
        """Messages without acceleration at stamps (n,), ns, of q_WS (n, 4): a message a row, (n, size), uint8."""
        return self._template.make(stamps_ns, self._values(orientations))

    def make_raw(
        self,
        stamps_ns: np.ndarray,
        angular_velocities: FloatArray,
        accelerations: FloatArray,
        orientations: FloatArray | None = None,
    ) -> np.ndarray:
        """Messages of an IMU without orientation, unless there is one too.

        Parameters
        ----------
        stamps_ns : (n,)
            ns.
        angular_velocities, accelerations : (n, 3)
            rad/s and, with gravity, m/s², in the sensor's axes.
        orientations : (n, 4)
            q_WS, x y z w.

        Returns
        -------
        A message a row, (n, size), uint8.
        """
        absent = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (len(stamps_ns), 4))
        values = self._values(absent if orientations is None else orientations)
        values[:, NO_ORIENTATION_AT] = -1.0 if orientations is None else 0.0
        values[:, [NO_ANGULAR_VELOCITY_AT, NO_ACCELERATION_AT]] = 0.0
        values[:, ANGULAR_VELOCITY], values[:, ACCELERATION] = angular_velocities, accelerations
        return self._template.make(stamps_ns, values)

    def _values(self, orientations: np.ndarray) -> np.ndarray:
        values = np.zeros((len(orientations), N_NUMBERS))
        values[:, :4] = orientations
        values[:, NO_ANGULAR_VELOCITY_AT] = values[:, NO_ACCELERATION_AT] = -1.0
        return values
