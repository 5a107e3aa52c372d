"""What the board sends unasked: orientations and accelerations, one packet a sweep (firmware/PROTOCOL.md).

The wire counts multiplexer channels and puts a quaternion's scalar first; both end here: everywhere else an IMU is
known by its id (sensing/imu/addresses.py), and quaternions are x y z w.
"""

from enum import IntEnum
from struct import Struct
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sesa2.link.framing import FRAMING_BYTES
from sesa2.link.link_errors import PacketError
from sesa2.sensing.imu.addresses import ids_of
from sesa2.sensing.imu.bno055.scores import Scores

VERSION = 1
"""The protocol version that this package speaks."""

_DATA, _ACCELERATION = 1, 2
_HEAD = Struct('<BBHIHB')  # type, version, seq, t_us, scan_us, mask
_ENTRY = np.dtype([('health', 'u1'), ('calib', 'u1'), ('quaternion', '<i2', 4)])
_XYZW, _WXYZ = [1, 2, 3, 0], [3, 0, 1, 2]
_QUATERNION_LSB = 2.0**-14
_ACCELERATION_LSB = 0.01
_NOT_MEASURED = -32768


class State(IntEnum):
    """Where the board is with a chip."""

    ABSENT = 0
    TO_CONFIG = 1
    TO_NDOF = 2
    """On its way to the fusion mode, whichever was asked for."""
    RUN = 3


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
        return [State(health & 0x0F) for health in self.health]

    @property
    def errors(self) -> list[int]:
        """I2C errors of each IMU since it last ran, saturating at 15."""
        return [health >> 4 for health in self.health]

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
        return FRAMING_BYTES + _HEAD.size + 6 * len(self.accelerations)


def decode_stream(body: bytes, board: int = 0) -> Data | Acceleration:
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
        _check_length(body, _ENTRY.itemsize * n, 'DATA', n)
        health = body[_HEAD.size :: _ENTRY.itemsize]
        if any(value & 0x0F > State.RUN for value in health):
            raise PacketError(
                f'DATA packet with a state beyond {State.RUN:d} in health bytes {health.hex(" ")}'
            )
        raw = np.frombuffer(body, _ENTRY, n, _HEAD.size)['quaternion']
        calib = body[_HEAD.size + 1 :: _ENTRY.itemsize]
        return Data(sweep, raw[:, _XYZW] * _QUATERNION_LSB, health, calib)
    if kind == _ACCELERATION:
        _check_length(body, 6 * n, 'ACCELERATION', n)
        raw = np.frombuffer(body, '<i2', 3 * n, _HEAD.size).reshape(n, 3)
        measured = (raw != _NOT_MEASURED).any(axis=1, keepdims=True)
        return Acceleration(sweep, np.where(measured, raw * _ACCELERATION_LSB, np.nan))
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
    lsb = np.rint(np.asarray(accelerations, float) / _ACCELERATION_LSB)
    raw = np.where(np.isnan(lsb), _NOT_MEASURED, lsb).astype('<i2')
    return _HEAD.pack(_ACCELERATION, VERSION, *sweep[:4]) + raw.tobytes()


def _check_length(body: bytes, entries: int, name: str, n: int) -> None:
    if len(body) != _HEAD.size + entries:
        raise PacketError(f'{name} packet of {n} IMUs has {_HEAD.size + entries} bytes, got {len(body)}')
