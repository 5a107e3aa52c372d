"""The board as the PC sees it: commands that are answered, while packets stream in."""

import time
from collections.abc import Callable

from sesa2.link.clock import steady_ns
from sesa2.link.framing import FrameDecoder, encode_frame
from sesa2.link.link_errors import CommandError, LinkError, PacketError, ProtocolVersionError
from sesa2.link.packets import VERSION, Packet, decode_stream
from sesa2.link.requests import (
    BoardConfiguration,
    Command,
    Hello,
    Reply,
    Request,
    Result,
    Stats,
    Stream,
    decode_reply,
    is_reply,
)
from sesa2.link.serial_port import SerialPort
from sesa2.sensing.imu.addresses import address_of, imu_id_at
from sesa2.sensing.imu.bno055.offsets import Offsets

HELLO_PATIENCE_S = 3.0
"""Opening the port resets a Mega, whose boot loader then waits for a new program."""
_HELLO_TIMEOUT_S = 0.1
_REPLY_TIMEOUT_S = 0.5
_BUSY_PATIENCE_S = 3.0
_BUSY_PAUSE_S = 0.02
_TRIES = 4

UPLOAD = 'make -C firmware upload'
"""Puts this package's firmware on a board."""

PacketHandler = Callable[[Packet, int], None]
"""Takes a packet and the time at which its last byte was read, ns of `steady_ns`."""


class Board:
    """Client of the board on an open port. All its methods belong to one thread.

    Stream packets go to the handler as soon as they are read, also those that arrive while a command waits for its
    reply, so that none is lost or late. The handler gives no commands itself.

    Parameters
    ----------
    port
        The open port; the caller closes it.
    on_packet
        Called with every intact stream packet.
    decoder
        To go on counting damaged frames over several connections, hand over the same one.
    number
        Which board it is, from 0: its IMUs have the ids from 8 · number + 1 on.

    Attributes
    ----------
    malformed
        Intact frames that were no packet of this protocol.
    retries
        Commands sent again because no reply came in time.
    """

    def __init__(
        self,
        port: SerialPort,
        on_packet: PacketHandler,
        decoder: FrameDecoder | None = None,
        number: int = 0,
    ) -> None:
        self.port = port
        self.number = number
        self.decoder = decoder or FrameDecoder()
        self.malformed = 0
        self.retries = 0
        self._on_packet = on_packet
        self._replies: list[Reply] = []
        self._token = 0
        self._received = 0

    def poll(self, timeout_s: float) -> bool:
        """Read once, waiting up to a time, and hand on what arrived; whether anything did."""
        portion = self.port.read(timeout_s)
        arrival_ns = steady_ns()
        self._received += len(portion)
        for body in self.decoder.feed(portion):
            try:
                packet = decode_reply(body) if is_reply(body) else decode_stream(body, self.number)
            except PacketError:
                self.malformed += 1
                continue
            if isinstance(packet, Reply):
                self._replies.append(packet)
            else:
                self._on_packet(packet, arrival_ns)
        return bool(portion)

    def hello(self, patience_s: float = HELLO_PATIENCE_S) -> Hello:
        """Say hello until the board answers.

        Raises
        ------
        LinkError
            If it does not within the patience.
        ProtocolVersionError
            If it speaks another version.
        """
        deadline = time.monotonic() + patience_s
        while True:
            reply = self._try(Command.HELLO, b'', _HELLO_TIMEOUT_S)
            if reply and reply.result is Result.OK:
                return Hello.unpack(reply.fields)
            if time.monotonic() > deadline:
                raise LinkError(self._unanswered(patience_s))

    def configure(self, configuration: BoardConfiguration) -> None:
        """Say which channels to read, how often and how."""
        self._command(Command.CONFIGURE, configuration.pack())

    def stream(self, flags: int) -> None:
        """Start (the sum of flags of `Stream`) or stop (0) the stream."""
        self._command(Command.STREAM, bytes((flags,)))

    def hush(self) -> None:
        """Stop the stream without waiting for the reply: the last that is said before the port is closed."""
        self.port.write(b'\x00' + encode_frame(Request(Command.STREAM, 0, bytes((Stream.STOP,))).encode()))

    def write_offsets(self, imu_id: int, offsets: Offsets) -> bool:
        """Give a chip its offsets, and the board the same to keep; False if the chip is absent now."""
        arguments = self._channel(imu_id) + offsets.to_registers()
        return self._command(Command.WRITE_OFFSETS, arguments, absent_is_fine=True).result is Result.OK

    def read_offsets(self, imu_id: int) -> Offsets:
        """The offsets that a chip works with. It does not measure for about 40 ms meanwhile."""
        return Offsets.from_registers(self._command(Command.READ_OFFSETS, self._channel(imu_id)).fields)

    def reset_imu(self, imu_id: int) -> None:
        """Reset a chip; the board brings it back with its mode and offsets."""
        self._command(Command.RESET_IMU, self._channel(imu_id))

    def stats(self) -> Stats:
        """What the board has counted since it started."""
        return Stats.unpack(self._command(Command.STATS).fields)

    def _command(self, command: Command, arguments: bytes = b'', *, absent_is_fine: bool = False) -> Reply:
        busy_until = time.monotonic() + _BUSY_PATIENCE_S
        tries = 0
        while True:
            reply = self._try(command, arguments, _REPLY_TIMEOUT_S)
            if reply is None:
                tries += 1
                if tries == _TRIES:
                    raise LinkError(
                        f'{self.port.path}: no answer to {command.name} in {_TRIES} tries of {_REPLY_TIMEOUT_S} s'
                    )
                self.retries += 1
            elif reply.result is Result.BUSY and time.monotonic() < busy_until:
                self._wait(_BUSY_PAUSE_S)
            elif reply.result is Result.OK or (reply.result is Result.ABSENT and absent_is_fine):
                return reply
            else:
                raise CommandError(self._refused(command, arguments, reply.result))

    def _try(self, command: Command, arguments: bytes, timeout_s: float) -> Reply | None:
        """Send once, with a token of its own, and wait for the reply that carries it."""
        self._token = (self._token + 1) % 256
        self._replies.clear()
        # The leading delimiter ends whatever a disturbed line has left in the board's buffer.
        self.port.write(b'\x00' + encode_frame(Request(command, self._token, arguments).encode()))
        deadline = time.monotonic() + timeout_s
        while (remaining := deadline - time.monotonic()) > 0:
            self.poll(remaining)
            for reply in self._replies:
                if (reply.command, reply.token) == (command, self._token):
                    if reply.version != VERSION:
                        raise ProtocolVersionError(
                            f'{self.port.path}: the board speaks protocol version {reply.version}, this package '
                            f'version {VERSION}; flash the firmware of this package ({UPLOAD})'
                        )
                    return reply
            self._replies.clear()
        return None

    def _wait(self, duration_s: float) -> None:
        deadline = time.monotonic() + duration_s
        while (remaining := deadline - time.monotonic()) > 0:
            self.poll(remaining)

    def _unanswered(self, patience_s: float) -> str:
        errors = self.decoder.errors.total
        if self._received and errors:
            hint = f'{self._received} bytes came, and {errors} frames were damaged: is {self.port.baud} its baud rate?'
        elif self._received:
            hint = f"{self._received} bytes came, but no reply: is this package's firmware on it ({UPLOAD})?"
        else:
            hint = f'nothing came: is it the right port, and is the firmware on the board ({UPLOAD})?'
        return f'{self.port.path}: no board answered HELLO within {patience_s:g} s; {hint}'

    def _channel(self, imu_id: int) -> bytes:
        board, channel = address_of(imu_id)
        if board != self.number:
            raise CommandError(
                f'{self.port.path}: IMU {imu_id} is on board {board}, and this is board {self.number}'
            )
        return bytes((channel,))

    def _refused(self, command: Command, arguments: bytes, result: Result) -> str:
        why = {
            Result.BAD_ARGUMENT: f'bad argument in {arguments.hex(" ")}',
            Result.ABSENT: 'the chip is absent',
            Result.BUSY: f'the chip was still busy after {_BUSY_PATIENCE_S:g} s',
            Result.I2C_ERROR: 'error on the I2C bus',
        }[result]
        if command in (Command.WRITE_OFFSETS, Command.READ_OFFSETS, Command.RESET_IMU):
            return f'{command.name} of IMU {imu_id_at(self.number, arguments[0])}: {why}'
        return f'{command.name}: {why}'
