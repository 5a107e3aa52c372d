"""What the board sends unasked: what its IMUs measure, a packet of each kind a sweep (firmware/PROTOCOL.md).

The wire counts multiplexer channels and puts a quaternion's scalar first; both end here: everywhere else an IMU is
known by its id (sensing/imu/addresses.py), and quaternions are x y z w.
"""

from enum import IntEnum
from functools import cache, lru_cache
from struct import Struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sesa2.link.framing import FRAMING_BYTES
from sesa2.link.link_errors import PacketError
from sesa2.sensing.imu.addresses import ids_of
from sesa2.sensing.imu.bno055.scores import Scores

VERSION = 2
"""The protocol version that this package speaks."""

_DATA, _ACCELERATION, _RAW, _MAGNETOMETER = 1, 2, 3, 4
_HEAD = Struct('<BBHIHB')  # type, version, seq, t_us, scan_us, mask
_ENTRY = np.dtype([('health', 'u1'), ('calib', 'u1'), ('quaternion', '<i2', 4)])
_RAW_ENTRY = np.dtype([('health', 'u1'), ('angular_velocity', '<i2', 3), ('acceleration', '<i2', 3)])
_VECTOR = np.dtype(('<i2', 3))
_XYZW, _WXYZ = np.array([1, 2, 3, 0]), np.array([3, 0, 1, 2])
_QUATERNION_LSB = 2.0**-14
_ACCELERATION_LSB = 0.01
_ANGULAR_VELOCITY_LSB = np.deg2rad(1 / 16)
_FIELD_LSB = 1e-6 / 16
_NOT_MEASURED = -32768


class State(IntEnum):
    """Where the board is with a chip."""

    ABSENT = 0
    TO_CONFIG = 1
    TO_NDOF = 2
    """On its way to the mode that was asked for, NDOF or another."""
    RUN = 3


@cache
def scores_of(register: int) -> Scores:
    """Calibration scores in a value of register 0x35."""
    return Scores(register >> 6, register >> 4 & 3, register >> 2 & 3, register & 3)


def register_of(scores: Scores) -> int:
    """The value of register 0x35 with these scores."""
    return scores.sys << 6 | scores.gyro << 4 | scores.accel << 2 | scores.mag


class SweepHeader(NamedTuple):
    """When and of which IMUs a packet is."""

    seq: int
    """Counts sweeps modulo 2¹⁶."""
    t_us: int
    """Board clock at the start of the sweep, µs modulo 2³²."""
    scan_us: int
    """Length of the sweep, µs."""
    mask: int
    """Channels in the packet."""
    board: int = 0
    """Which board's; not on the wire."""

    @property
    def ids(self) -> tuple[int, ...]:
        """Ids of the n IMUs in the packet, in the order of its rows."""
        return ids_of(self.mask, self.board)

    def read_ns(self) -> list[int]:
        """When each IMU was read, ns after the start of the sweep."""
        n = len(self.ids)
        return [self.scan_us * 500 * (2 * k + 1) // n for k in range(n)]


class Data(NamedTuple):
    """Orientations of one sweep.

    Attributes
    ----------
    orientations
        Shape (n, 4), x y z w: q_WS of each IMU as the chip gave it, in steps of 2⁻¹⁴, not normalised; all
        zero where the chip has not measured.
    health
        n bytes, ``errors << 4 | state``; see `states` and `errors`.
    calib
        n bytes, register 0x35; see `scores`. One IMU's is refreshed per sweep.
    """

    sweep: SweepHeader
    orientations: NDArray[np.float64]
    health: bytes
    calib: bytes

    @property
    def line_bytes(self) -> int:
        """Bytes of the packet's frame."""
        return FRAMING_BYTES + _HEAD.size + _ENTRY.itemsize * len(self.health)

    @property
    def states(self) -> list[State]:
        """State of each IMU."""
        return list(_states(self.health))

    @property
    def errors(self) -> list[int]:
        """I2C errors of each IMU since it last ran, saturating at 15."""
        return _errors(self.health)

    @property
    def scores(self) -> list[Scores]:
        """Calibration scores of each IMU."""
        return [scores_of(calib) for calib in self.calib]


class Acceleration(NamedTuple):
    """Accelerations of one sweep.

    Attributes
    ----------
    accelerations
        Shape (n, 3), m/s², in the sensor's frame, gravity included; NaN where the chip has not measured.
    """

    sweep: SweepHeader
    accelerations: NDArray[np.float64]

    @property
    def line_bytes(self) -> int:
        """Bytes of the packet's frame."""
        return FRAMING_BYTES + _HEAD.size + _VECTOR.itemsize * len(self.accelerations)


class RawData(NamedTuple):
    """What gyroscopes and accelerometers measured in one sweep, uncompensated.

    Attributes
    ----------
    angular_velocities
        Shape (n, 3), rad/s, in the sensor's frame; NaN where the chip has not measured.
    accelerations
        Shape (n, 3), m/s², in the sensor's frame, gravity included; NaN where the chip has not measured.
    health
        n bytes, as in `Data`.
    """

    sweep: SweepHeader
    angular_velocities: NDArray[np.float64]
    accelerations: NDArray[np.float64]
    health: bytes

    @property
    def line_bytes(self) -> int:
        """Bytes of the packet's frame."""
        return FRAMING_BYTES + _HEAD.size + _RAW_ENTRY.itemsize * len(self.health)

    @property
    def states(self) -> list[State]:
        """State of each IMU."""
        return list(_states(self.health))

    @property
    def errors(self) -> list[int]:
        """I2C errors of each IMU since it last ran, saturating at 15."""
        return _errors(self.health)

    @property
    def scores(self) -> list[None]:
        """No calibration scores: they are the fusion's."""
        return [None] * len(self.health)


class MagneticFields(NamedTuple):
    """Magnetic fields of one sweep, uncompensated.

    Attributes
    ----------
    fields
        Shape (n, 3), T, in the sensor's frame; NaN where the chip has not measured.
    """

    sweep: SweepHeader
    fields: NDArray[np.float64]

    @property
    def line_bytes(self) -> int:
        """Bytes of the packet's frame."""
        return FRAMING_BYTES + _HEAD.size + _VECTOR.itemsize * len(self.fields)


Packet = Data | Acceleration | RawData | MagneticFields


def decode_stream(body: bytes, board: int = 0) -> Packet:
    """The packet in an intact frame's body, which came from a board.

    Raises
    ------
    PacketError
        If type, version, state or length are none of this protocol.
    """
    if len(body) < _HEAD.size:
        raise PacketError(f'a stream packet has at least {_HEAD.size} bytes, got {len(body)}')
    kind, version, seq, t_us, scan_us, mask = _HEAD.unpack_from(body)
    if version != VERSION:
        raise PacketError(f'stream packet of protocol version {version}, expected {VERSION}')
    sweep = SweepHeader(seq, t_us, scan_us, mask, board)
    n = mask.bit_count()
    if kind == _DATA:
        entries, health = _entries(body, _ENTRY, 'DATA', n)
        calib = body[_HEAD.size + 1 :: _ENTRY.itemsize]
        return Data(sweep, entries['quaternion'].take(_XYZW, axis=1) * _QUATERNION_LSB, health, calib)
    if kind == _RAW:
        entries, health = _entries(body, _RAW_ENTRY, 'RAW', n)
        velocities = _si(entries['angular_velocity'], _ANGULAR_VELOCITY_LSB)
        return RawData(sweep, velocities, _si(entries['acceleration'], _ACCELERATION_LSB), health)
    if kind == _ACCELERATION:
        return Acceleration(sweep, _si(_vectors(body, 'ACCELERATION', n), _ACCELERATION_LSB))
    if kind == _MAGNETOMETER:
        return MagneticFields(sweep, _si(_vectors(body, 'MAGNETOMETER', n), _FIELD_LSB))
    raise PacketError(f'unknown packet type {kind}')


def encode_data(sweep: SweepHeader, orientations: ArrayLike, health: bytes, calib: bytes) -> bytes:
    """Body of a DATA packet: the inverse of `decode_stream`, rounding to steps of 2⁻¹⁴."""
    entries = np.empty(len(sweep.ids), _ENTRY)
    entries['health'] = list(health)
    entries['calib'] = list(calib)
    entries['quaternion'] = np.rint(np.asarray(orientations)[:, _WXYZ] / _QUATERNION_LSB)
    return _HEAD.pack(_DATA, VERSION, *sweep[:4]) + entries.tobytes()


def encode_acceleration(sweep: SweepHeader, accelerations: ArrayLike) -> bytes:
    """Body of an ACCELERATION packet: the inverse of `decode_stream`, rounding to 0.01 m/s²."""
    return _HEAD.pack(_ACCELERATION, VERSION, *sweep[:4]) + _lsb(accelerations, _ACCELERATION_LSB).tobytes()


def encode_raw(
    sweep: SweepHeader, angular_velocities: ArrayLike, accelerations: ArrayLike, health: bytes
) -> bytes:
    """Body of a RAW packet: the inverse of `decode_stream`, rounding to 1/16 °/s and 0.01 m/s²."""
    entries = np.empty(len(sweep.ids), _RAW_ENTRY)
    entries['health'] = list(health)
    entries['angular_velocity'] = _lsb(angular_velocities, _ANGULAR_VELOCITY_LSB)
    entries['acceleration'] = _lsb(accelerations, _ACCELERATION_LSB)
    return _HEAD.pack(_RAW, VERSION, *sweep[:4]) + entries.tobytes()


def encode_magnetometer(sweep: SweepHeader, fields: ArrayLike) -> bytes:
    """Body of a MAGNETOMETER packet: the inverse of `decode_stream`, rounding to 1/16 µT."""
    return _HEAD.pack(_MAGNETOMETER, VERSION, *sweep[:4]) + _lsb(fields, _FIELD_LSB).tobytes()


@lru_cache
def _states(health: bytes) -> tuple[State, ...]:
    """Sweep for sweep they are mostly the same."""
    return tuple(State(value & 0x0F) for value in health)


def _errors(health: bytes) -> list[int]:
    return [value >> 4 for value in health]


def _entries(body: bytes, entry: np.dtype, name: str, n: int) -> tuple[NDArray[Any], bytes]:
    """Entries that begin with a byte of health, and these bytes."""
    _check_length(body, entry.itemsize * n, name, n)
    health = body[_HEAD.size :: entry.itemsize]
    try:
        _states(health)
    except ValueError:
        raise PacketError(
            f'{name} packet with a state beyond {State.RUN:d} in health bytes {health.hex(" ")}'
        ) from None
    return np.frombuffer(body, entry, n, _HEAD.size), health


def _vectors(body: bytes, name: str, n: int) -> NDArray[Any]:
    _check_length(body, _VECTOR.itemsize * n, name, n)
    return np.frombuffer(body, '<i2', 3 * n, _HEAD.size).reshape(n, 3)


def _si(raw: NDArray[Any], lsb: float) -> NDArray[np.float64]:
    """Vectors (n, 3) in SI units; NaN for those that say that they were not measured."""
    measured = (raw != _NOT_MEASURED).any(axis=1, keepdims=True)
    return np.where(measured, raw * lsb, np.nan)


def _lsb(vectors: ArrayLike, lsb: float) -> NDArray[Any]:
    """Vectors (n, 3) as a chip has them: rounded, at the end of its range where they go beyond; NaN is not measured."""
    steps = np.clip(np.rint(np.asarray(vectors, float) / lsb), -32768, 32767)
    return np.where(np.isnan(steps), _NOT_MEASURED, steps).astype('<i2')


def _check_length(body: bytes, entries: int, name: str, n: int) -> None:
    if len(body) != _HEAD.size + entries:
        raise PacketError(f'{name} packet of {n} IMUs has {_HEAD.size + entries} bytes, got {len(body)}')
