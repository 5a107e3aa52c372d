"""What the PC asks of the board and what the board answers (firmware/PROTOCOL.md, 'PC → board')."""

from enum import IntEnum
from struct import Struct
from typing import NamedTuple

from sesa2.link.link_errors import PacketError
from sesa2.link.packets import VERSION

FIRMWARE = (1, 1)
"""Major and minor number of the firmware that belongs to this package."""

_REPLY = 0x80


class Command(IntEnum):
    """First byte of a command; its reply has the top bit set."""

    HELLO = 10
    CONFIGURE = 11
    STREAM = 12
    WRITE_OFFSETS = 13
    READ_OFFSETS = 14
    RESET_IMU = 15
    STATS = 16


class Result(IntEnum):
    """The board's answer to a command."""

    OK = 0
    BAD_ARGUMENT = 1
    ABSENT = 2
    BUSY = 3
    I2C_ERROR = 4


class FusionMode(IntEnum):
    """Modes of the chip in which it measures, register 0x3D."""

    RAW = 0x07
    """No fusion: all nine axes as they are measured, uncompensated, for fusion on the host. The datasheet's AMG."""
    IMU = 0x08
    """Gyroscope and accelerometer only: iron nearby does no harm, but the heading is relative and drifts."""
    NDOF_FMC_OFF = 0x0B
    """All nine axes, without fast magnetometer calibration."""
    NDOF = 0x0C
    """All nine axes."""

    @property
    def loses_heading(self) -> bool:
        """Whether a chip that starts anew has another earth frame: one by its gyroscope alone, not by north."""
        return self is FusionMode.IMU


class Stream:
    """Flags of STREAM."""

    STOP = 0
    QUATERNIONS = 1
    ACCELERATION = 2
    RAW = 4
    """Angular velocity and acceleration, in the mode RAW alone."""
    MAGNETOMETER = 8
    """In the mode RAW alone."""
    ALL = 15


class BoardConfiguration(NamedTuple):
    """Arguments of CONFIGURE."""

    mask: int
    """Channels in use."""
    rate_hz: int
    """Sweeps per second, 1 to 100."""
    mode: int
    """A `FusionMode`."""
    i2c_100khz: int
    """0: the bus runs at 400 kHz; 1: at 100 kHz."""

    def pack(self) -> bytes:
        """The arguments as bytes."""
        return bytes(self)


class Hello(NamedTuple):
    """Reply to HELLO."""

    firmware_major: int
    firmware_minor: int
    channels: int
    """Mask of the channels on which a BNO055 answers now."""
    uptime_ms: int
    """Since the board started: a value that went back is a reset."""

    @property
    def firmware(self) -> str:
        """The firmware's version as people write it."""
        return f'{self.firmware_major}.{self.firmware_minor}'

    @property
    def outdated(self) -> bool:
        """Whether the firmware is older than the one that belongs to this package."""
        return self[:2] < FIRMWARE

    def pack(self) -> bytes:
        """The fields as bytes."""
        return _HELLO.pack(*self)

    @classmethod
    def unpack(cls, fields: bytes) -> 'Hello':
        """From the fields of a reply."""
        return cls(*_HELLO.unpack(fields))


class Stats(NamedTuple):
    """Reply to STATS: what the board counted since it started."""

    sweeps: int
    late: int
    """Sweeps that began more than one millisecond after their time."""
    max_scan_us: int
    bus_recoveries: int
    """Clock pulses sent to free a stuck bus."""
    rx_bad: int
    """Frames from the PC that the board dropped."""
    rx_overflow: int
    """Bytes from the PC that the board lost."""
    tx_dropped: int
    """Packets not sent because the send buffer was full."""
    reset_cause: int
    """MCUSR at the start."""
    comebacks: tuple[int, ...]
    """Times that each channel's chip came back, saturating at 255."""
    errors: tuple[int, ...]
    """I2C errors of each channel, saturating at 65535."""

    def pack(self) -> bytes:
        """The fields as bytes."""
        return _STATS.pack(*self[:8], *self.comebacks, *self.errors)

    @classmethod
    def unpack(cls, fields: bytes) -> 'Stats':
        """From the fields of a reply."""
        values = _STATS.unpack(fields)
        return cls._make((*values[:8], values[8:16], values[16:24]))


_HELLO = Struct('<BBBI')
_STATS = Struct('<IIHHHHHB8B8H')

OFFSET_BYTES = 22

_ARGUMENT_BYTES = {
    Command.HELLO: 0,
    Command.CONFIGURE: 4,
    Command.STREAM: 1,
    Command.WRITE_OFFSETS: 1 + OFFSET_BYTES,
    Command.READ_OFFSETS: 1,
    Command.RESET_IMU: 1,
    Command.STATS: 0,
}
_FIELD_BYTES = {
    Command.HELLO: _HELLO.size,
    Command.CONFIGURE: 0,
    Command.STREAM: 0,
    Command.WRITE_OFFSETS: 0,
    Command.READ_OFFSETS: OFFSET_BYTES,
    Command.RESET_IMU: 0,
    Command.STATS: _STATS.size,
}


class Request(NamedTuple):
    """A command on its way to the board."""

    command: int
    """A `Command`, or one that this protocol does not have: the board answers that too."""
    token: int
    """0 to 255, chosen anew for every try: the reply carries it."""
    arguments: bytes = b''
    version: int = VERSION

    def encode(self) -> bytes:
        """Body of its frame."""
        return bytes((self.command, self.version, self.token)) + self.arguments


class Reply(NamedTuple):
    """The board's answer to a `Request`."""

    command: int
    token: int
    result: Result
    fields: bytes = b''
    version: int = VERSION

    def encode(self) -> bytes:
        """Body of its frame."""
        return bytes((_REPLY | self.command, self.version, self.token, self.result)) + self.fields


def decode_request(body: bytes) -> Request:
    """The command in an intact frame's body; the board's side.

    A command of another version or an unknown one is let through with whatever arguments it has, since the board
    answers it.

    Raises
    ------
    PacketError
        If the length does not fit.
    """
    if len(body) < 3:
        raise PacketError(f'a command has at least 3 bytes, got {len(body)}')
    code, version, token, arguments = body[0], body[1], body[2], body[3:]
    if version != VERSION or code not in _ARGUMENT_BYTES:
        return Request(code, token, arguments, version)
    command = Command(code)
    if len(arguments) != _ARGUMENT_BYTES[command]:
        raise PacketError(
            f'{command.name} has {_ARGUMENT_BYTES[command]} argument bytes, got {len(arguments)}'
        )
    return Request(command, token, arguments, version)


def is_reply(body: bytes) -> bool:
    """Whether a body from the board answers a command (or is a stream packet)."""
    return bool(body[0] & _REPLY)


def decode_reply(body: bytes) -> Reply:
    """The reply in an intact frame's body.

    A reply of another version is let through with whatever fields it has: the user is told both versions.

    Raises
    ------
    PacketError
        If command or result are unknown or the length does not fit.
    """
    if len(body) < 4:
        raise PacketError(f'a reply has at least 4 bytes, got {len(body)}')
    if not is_reply(body):
        raise PacketError(f'{body[0]} is no reply to a command')
    try:
        command, result = Command(body[0] & ~_REPLY), Result(body[3])
    except ValueError as error:
        raise PacketError(f'reply {body.hex(" ")}: {error}') from None
    version, token, fields = body[1], body[2], body[4:]
    expected = _FIELD_BYTES[command] if result is Result.OK else 0
    if version == VERSION and len(fields) != expected:
        raise PacketError(
            f'{command.name} is answered {result.name} with {expected} bytes, got {len(fields)}'
        )
    return Reply(command, token, result, fields, version)
