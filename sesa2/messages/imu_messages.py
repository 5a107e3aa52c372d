"""sensor_msgs/Imu as bytes."""

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sesa2.errors import Sesa2Error
from sesa2.messages.cdr import CdrLayout
from sesa2.time import NS

TYPE = 'sensor_msgs/msg/Imu'
_SHORTEST = 16  # bytes that tell the layout


class ImuSample(NamedTuple):
    """Stamp, ns, and orientation q_WS of a message."""

    stamp_ns: int
    x: float
    y: float
    z: float
    w: float


def read_imu(data: bytes) -> ImuSample:
    """Read stamp and orientation.

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
        order = '<' if data[1] & 1 else '>'
        seconds, nanoseconds, length = struct.unpack_from(f'{order}iII', data, 4)
        at = 4 + (12 + length + 7) // 8 * 8
        return ImuSample(seconds * NS + nanoseconds, *struct.unpack_from(f'{order}4d', data, at))
    except (IndexError, struct.error):
        raise _too_short(data) from None


def read_imus(data: Sequence[bytes]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Read stamps and orientations of many messages.

    Parameters
    ----------
    data
        the serialised messages, as in `read_imu`.

    Returns
    -------
    stamps_ns : (n,), int64, orientations : (n, 4) and readable : (n,), false where it is no message of an IMU.
    """
    n = len(data)
    stamps, orientations = np.zeros(n, np.int64), np.zeros((n, 4))
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
            if at + 32 <= size:
                seconds, nanoseconds = raw[:, 4:12].copy().view('<u4').T
                stamps[rows] = seconds.astype('<i4').astype(np.int64) * NS + nanoseconds
                orientations[rows] = raw[:, at : at + 32].copy().view('<f8')
                continue
        for k in rows.tolist():
            try:
                stamps[k], *orientations[k] = read_imu(data[k])
            except Sesa2Error:
                readable[k] = False
    return stamps, orientations, readable


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
        order = '<' if data[1] & 1 else '>'
        (length,) = struct.unpack_from(f'{order}I', data, 12)
        at = 4 + (12 + length + 7) // 8 * 8 + 8 * 25
        changed = bytearray(data)
        struct.pack_into(f'{order}4d', changed, at, 0.0, 0.0, 0.0, -1.0)
    except (IndexError, struct.error):
        raise _too_short(data) from None
    return bytes(changed)


def _too_short(data: bytes) -> Sesa2Error:
    return Sesa2Error(f'a {TYPE} message of {len(data)} bytes, expected at least 316')


class ImuMessages:
    """Makes the messages of one IMU, as REP-145 wants them: covariance unknown, absent fields −1 first."""

    # orientation (4), covariance (9), angular velocity (3), covariance (9), linear acceleration (3), covariance (9)
    _N = 37
    _NO_ANGULAR_VELOCITY, _ACCELERATION, _NO_ACCELERATION = 16, slice(25, 28), 28

    def __init__(self, frame_id: str):
        self._template = CdrLayout().header(frame_id).doubles(self._N).template()

    def make(self, stamp_ns: int, orientation: np.ndarray, acceleration: np.ndarray | None = None) -> bytes:
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
        values = self._values(np.asarray(orientation, dtype=float)[None])
        if acceleration is not None:
            values[0, self._NO_ACCELERATION] = 0.0
            values[0, self._ACCELERATION] = acceleration
        return self._template.make(np.array([stamp_ns]), values)[0].tobytes()

    def make_many(self, stamps_ns: np.ndarray, orientations: np.ndarray) -> np.ndarray:
        """Messages without acceleration at stamps (n,), ns, of q_WS (n, 4): a message a row, (n, size), uint8."""
        return self._template.make(stamps_ns, self._values(orientations))

    def _values(self, orientations: np.ndarray) -> np.ndarray:
        values = np.zeros((len(orientations), self._N))
        values[:, :4] = orientations
        values[:, [self._NO_ANGULAR_VELOCITY, self._NO_ACCELERATION]] = -1.0
        return values
