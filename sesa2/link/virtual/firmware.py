"""The virtual board's firmware: answers commands, reads chips, sends sweeps. No port and no clock of its own.

Time is handed in, µs since the board started, so that the same code runs in a test step by step and on a
pseudo-terminal by the clock.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sesa2.link.framing import FrameDecoder, encode_frame
from sesa2.link.link_errors import PacketError
from sesa2.link.packets import (
    VERSION,
    State,
    SweepHeader,
    encode_acceleration,
    encode_data,
    encode_magnetometer,
    encode_raw,
)
from sesa2.link.requests import (
    FIRMWARE,
    BoardConfiguration,
    Command,
    FusionMode,
    Hello,
    Reply,
    Request,
    Result,
    Stats,
    Stream,
    decode_request,
)
from sesa2.link.virtual.channel import NEVER, Channel
from sesa2.link.virtual.chip import Chip
from sesa2.link.virtual.motion import FloatArray
from sesa2.link.virtual.virtual_arm import accelerations, angular_velocities, magnetic_fields
from sesa2.sensing.imu.addresses import CHANNELS, ids_of, imu_id_at, mask_of

_READ_IMU_US = {0: 450, 1: 1_440}  # one IMU's share of a sweep at 400 and at 100 kHz
_READ_RAW_IMU_US = {0: 710, 1: 2_330}
_GYROSCOPE_US = 1_000  # before and after a reading, between which the turn is what a gyroscope measures
_ENTRY_BYTES = {Stream.QUATERNIONS: 10, Stream.ACCELERATION: 6, Stream.RAW: 13, Stream.MAGNETOMETER: 6}
POWER_ON, EXTERNAL_RESET = 0x01, 0x02

_ABOUT_ONE = (Command.WRITE_OFFSETS, Command.READ_OFFSETS, Command.RESET_IMU)

Measure = Callable[[Sequence[int], FloatArray, FloatArray], FloatArray]
"""Takes n ids, times since the board started, shape (m, n), µs, and n headings, rad; gives q_WS, shape (m, n, 4)."""


class Firmware:
    """One start of the board: a reset makes a new one.

    Parameters
    ----------
    chips
        By id, all of this board; channels without one are empty. Their power and memory outlive the board's.
    measure
        What the chips measure.
    born_us
        Time of the chips' world at the start of the board, µs.
    baud
        Of the line: a packet is due when its last bit has left.
    board
        Which board it is, from 0.
    version, release
        Protocol version and firmware version to claim.
    reset_cause
        Register MCUSR: `POWER_ON` or `EXTERNAL_RESET`.
    ahead
        How many sweeps are measured at once, ahead of their time; 1 where the motion is not known before.
    """

    def __init__(
        self,
        chips: Mapping[int, Chip],
        measure: Measure,
        *,
        born_us: int = 0,
        baud: int = 500_000,
        board: int = 0,
        version: int = VERSION,
        release: tuple[int, int] = FIRMWARE,
        reset_cause: int = POWER_ON,
        ahead: int = 16,
    ) -> None:
        self._chips = chips
        self._measure = measure
        self._born_us = born_us
        self._bit_us = 1e6 / baud
        self._board = board
        self._version = version
        self._release = release
        self._reset_cause = reset_cause
        self._decoder = FrameDecoder()
        ids = [imu_id_at(board, channel) for channel in range(CHANNELS)]
        self._channels = {i: Channel(chips.get(i), born_us, self._reply) for i in ids}
        self._malformed = 0
        self._flags = Stream.STOP
        self._configuration: BoardConfiguration | None = None
        self._ids: tuple[int, ...] = ()
        self._seq = 0
        self._sweeps = 0
        self._late = 0
        self._max_scan_us = 0
        self._sweep_us = 0
        self._sweep_due_us = 0
        self._sent_us = NEVER
        self._n_ahead = ahead
        self._ahead: dict[int, tuple[FloatArray, FloatArray]] = {}
        self._out: list[bytes] = []
        self.tx_dropped = 0

    def receive(self, portion: bytes, now_us: int) -> None:
        """Take bytes from the PC."""
        for body in self._decoder.feed(portion):
            try:
                request = decode_request(body)
            except PacketError:
                self._malformed += 1
            else:
                self._take(request, now_us)

    def advance(self, now_us: int) -> list[bytes]:
        """Let time pass; the frames that have left by then."""
        while self._sent_us <= now_us:
            self._step(self._sent_us)
            self._send_sweep()
        self._step(now_us)
        out, self._out = self._out, []
        return out

    def next_us(self) -> int:
        """When `advance` has something to do again, if nothing is received before."""
        return min(self._sent_us, *(channel.due_us for channel in self._channels.values()))

    def _take(self, request: Request, now_us: int) -> None:
        if request.command == Command.HELLO:
            answering = mask_of(i for i, chip in self._chips.items() if chip.answers(self._born_us + now_us))
            self._reply(
                request, Result.OK, Hello(*self._release, answering, now_us // 1000 % (1 << 32)).pack()
            )
        elif request.version != self._version:
            self._reply(request, Result.BAD_ARGUMENT)
        elif request.command == Command.CONFIGURE:
            self._configure(request, now_us)
        elif request.command == Command.STREAM:
            self._stream(request)
        elif request.command == Command.STATS:
            self._reply(request, Result.OK, self._stats().pack())
        elif request.command in _ABOUT_ONE:
            self._visit(request, now_us)
        else:
            self._reply(request, Result.BAD_ARGUMENT)

    def _reply(self, request: Request, result: Result, fields: bytes = b'') -> None:
        self._out.append(
            encode_frame(Reply(request.command, request.token, result, fields, self._version).encode())
        )

    def _configure(self, request: Request, now_us: int) -> None:
        configuration = BoardConfiguration(*request.arguments)
        if (
            not 1 <= configuration.rate_hz <= 100
            or configuration.mode not in list(FusionMode)
            or configuration.i2c_100khz > 1
        ):
            self._reply(request, Result.BAD_ARGUMENT)
            return
        self._configuration = configuration
        self._ids = ids_of(configuration.mask, self._board)
        self._reply(request, Result.OK)
        for imu_id, channel in self._channels.items():
            if imu_id in self._ids:
                channel.configure(configuration.mode, now_us)
            else:
                channel.leave()
        self._ahead.clear()
        self._sweep_us = self._sweep_due_us = now_us
        self._sent_us = self._when_sent()

    def _stream(self, request: Request) -> None:
        flags = request.arguments[0]
        if flags > Stream.ALL:
            self._reply(request, Result.BAD_ARGUMENT)
            return
        self._reply(request, Result.OK)
        self._flags = flags
        self._sent_us = self._when_sent()

    def _visit(self, request: Request, now_us: int) -> None:
        imu_id = imu_id_at(self._board, request.arguments[0])
        channel = self._channels.get(imu_id)
        if channel is None:
            self._reply(request, Result.BAD_ARGUMENT)
        elif any(other.occupied for other in self._channels.values()):
            self._reply(request, Result.BUSY)
        elif imu_id in self._ids:
            channel.visit(request, now_us)
        else:
            if request.command == Command.WRITE_OFFSETS:
                channel.keep(request.arguments[1:])
            self._reply(request, Result.ABSENT)

    def _step(self, now_us: int) -> None:
        for imu_id in self._ids:
            if self._channels[imu_id].step(now_us):
                self._ahead.clear()  # the chip may have another heading

    def _scan_us(self) -> int:
        assert self._configuration is not None
        times = _READ_RAW_IMU_US if self._raw else _READ_IMU_US
        return len(self._ids) * times[self._configuration.i2c_100khz]

    @property
    def _raw(self) -> bool:
        return self._configuration is not None and self._configuration.mode == FusionMode.RAW

    def _when_sent(self) -> int:
        """When the first packet of this sweep has left; others follow at once. Sweeps go on without a stream."""
        if not self._ids:
            return NEVER
        first = next((size for flag, size in _ENTRY_BYTES.items() if self._flags & flag), None)
        line_bytes = 0 if first is None else 15 + len(self._ids) * first
        return self._sweep_us + self._scan_us() + round(10 * line_bytes * self._bit_us)

    def _send_sweep(self) -> None:
        assert self._configuration is not None
        scan_us = self._scan_us()
        sweep = SweepHeader(self._seq, self._sweep_us % (1 << 32), scan_us, self._configuration.mask)
        channels = [self._channels[imu_id] for imu_id in self._ids]
        measured = np.array([channel.sample(self._sweep_us) for channel in channels])[:, np.newaxis]
        if running := [channel for channel in channels if channel.state is State.RUN]:
            running[self._sweeps % len(running)].refresh_calib(self._sweep_us)
        if self._flags:
            self._send_packets(sweep, channels, measured)
        self._seq = (self._seq + 1) % (1 << 16)
        self._sweeps += 1
        self._max_scan_us = max(self._max_scan_us, scan_us)
        self._schedule(scan_us)

    def _send_packets(self, sweep: SweepHeader, channels: list[Channel], measured: NDArray[np.bool_]) -> None:
        q, w = self._measured()
        health = bytes(channel.errors << 4 | channel.state for channel in channels)
        acceleration = np.where(measured, accelerations(q), np.nan)
        bodies = []
        if self._flags & Stream.QUATERNIONS:
            shown = np.where(measured & np.bool_(not self._raw), q, 0.0)
            bodies.append(encode_data(sweep, shown, health, bytes(channel.calib for channel in channels)))
        if self._flags & Stream.ACCELERATION:
            bodies.append(encode_acceleration(sweep, acceleration))
        raw = measured & np.bool_(self._raw)
        if self._flags & Stream.RAW:
            velocity = np.where(raw, w, np.nan)
            read = raw | np.bool_(self._flags & Stream.ACCELERATION)
            bodies.append(encode_raw(sweep, velocity, np.where(read, acceleration, np.nan), health))
        if self._flags & Stream.MAGNETOMETER:
            bodies.append(encode_magnetometer(sweep, np.where(raw, magnetic_fields(q), np.nan)))
        self._out += map(encode_frame, bodies)

    def _measured(self) -> tuple[FloatArray, FloatArray]:
        """q_WS and, in the mode RAW, angular velocity, rad/s, of the configured IMUs in this sweep, a row each.

        Anything for those that do not measure.

        numpy's price is by the call, and sweeps are regular: so many are computed at once, ahead of time.
        """
        if self._sweep_us not in self._ahead:
            n, scan_us = len(self._ids), self._scan_us()
            rows = [k for k, imu_id in enumerate(self._ids) if imu_id in self._chips]
            ids = [self._ids[k] for k in rows]
            starts = self._sweep_us + max(self._period_us(), scan_us) * np.arange(self._n_ahead)
            read_us = starts[:, np.newaxis] + scan_us * (np.array(rows) + 0.5) / n
            headings = np.array([self._chips[i].heading for i in ids])
            q, w = np.tile([0.0, 0.0, 0.0, 1.0], (self._n_ahead, n, 1)), np.zeros((self._n_ahead, n, 3))
            q[:, rows] = self._measure(ids, read_us, headings)
            if self._raw:
                before, after = (
                    self._measure(ids, read_us + us, headings) for us in (-_GYROSCOPE_US, _GYROSCOPE_US)
                )
                w[:, rows] = angular_velocities(before, after, 2e-6 * _GYROSCOPE_US)
            self._ahead = dict(zip(starts.tolist(), zip(q, w, strict=True), strict=True))
        return self._ahead.pop(self._sweep_us)

    def _period_us(self) -> int:
        assert self._configuration is not None
        return 1_000_000 // self._configuration.rate_hz

    def _schedule(self, scan_us: int) -> None:
        self._sweep_due_us += self._period_us()
        self._sweep_us = max(self._sweep_due_us, self._sweep_us + scan_us)
        if self._sweep_us - self._sweep_due_us > 1000:
            self._late += 1
            self._sweep_due_us = self._sweep_us
        self._sent_us = self._when_sent()

    def _stats(self) -> Stats:
        channels = self._channels.values()
        return Stats(
            sweeps=self._sweeps,
            late=self._late,
            max_scan_us=self._max_scan_us,
            bus_recoveries=0,
            rx_bad=min(65535, self._decoder.errors.total + self._malformed),
            rx_overflow=0,
            tx_dropped=min(65535, self.tx_dropped),
            reset_cause=self._reset_cause,
            comebacks=tuple(channel.comebacks for channel in channels),
            errors=tuple(channel.all_errors for channel in channels),
        )
