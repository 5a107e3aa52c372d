"""A link that is kept up: connect, give the chips their offsets, stream, check, and all of it again after every fault.

connect → HELLO → WRITE_OFFSETS to each chip → CONFIGURE → STREAM → READ_OFFSETS of each chip and compare → read on.
A silent board is asked by HELLO: if it was reset, it knows nothing and is set up again; if nobody answers, the port
is opened again, as often as it takes. A chip that comes back gets its offsets from the board; they are then read and
compared.
"""

import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, replace
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from sesa2.link.board_client import UPLOAD, Board
from sesa2.link.framing import FrameDecoder
from sesa2.link.intake import Intake
from sesa2.link.link_errors import CommandError, LinkError, ProtocolVersionError
from sesa2.link.packets import State
from sesa2.link.requests import FIRMWARE, BoardConfiguration, FusionMode, Hello, Stats, Stream
from sesa2.link.serial_port import SerialPort
from sesa2.link.status import Counters, Event, Handler, ImuStatus, Level, OffsetsState
from sesa2.sensing.imu.addresses import CHANNELS, address_of, ids_of, imu_id_at, mask_of
from sesa2.sensing.imu.bno055.offsets import Offsets
from sesa2.time import NS

_TURN_S = 0.05
_RECONNECT_S = 0.2
_STATS_PERIOD_S = 1.0
_UPTIME_WRAP_MS = 1 << 32
_UPTIME_TOLERANCE_MS = 200  # the reply takes its time, and the clocks may differ by 1 %

T = TypeVar('T')


@dataclass(frozen=True)
class LinkSettings:
    """What a session asks of port and board."""

    port: str
    ids: tuple[int, ...]
    """Ascending, at least one, all of one board."""
    baud: int = 500_000
    rate_hz: int = 100
    fusion: FusionMode = FusionMode.NDOF
    acceleration: bool = False
    magnetometer: bool = False
    """In the mode RAW."""
    i2c_100khz: bool = False

    @property
    def board(self) -> int:
        """Which board it is, from 0."""
        return address_of(self.ids[0]).board

    @property
    def stream(self) -> int:
        """What the board is to stream, flags of `Stream`."""
        if self.fusion is FusionMode.RAW:
            return Stream.RAW | (Stream.MAGNETOMETER if self.magnetometer else 0)
        return Stream.QUATERNIONS | (Stream.ACCELERATION if self.acceleration else 0)


class Session:
    """Keeps the link to a board. `run` belongs to one thread; all else may be called from any.

    Parameters
    ----------
    settings
        Port, IMUs and mode.
    handler
        Whom to tell what comes in.
    saved
        Offsets by IMU id, looked up at every connect and comeback, and once a second where there were none.

    Attributes
    ----------
    hello, stats
        The board's latest answers, for diagnostics; None before the first.
    connected
        Whether the board streams, as far as is known.
    """

    def __init__(self, settings: LinkSettings, handler: Handler, saved: Mapping[int, Offsets]) -> None:
        self.settings = settings
        self.hello: Hello | None = None
        self.stats: Stats | None = None
        self.connected = False
        self._handler = handler
        self._saved = saved
        self._board: Board | None = None
        self._decoder = FrameDecoder()
        self._counters = Counters()
        self._intake = Intake(settings.ids, settings.baud, settings.rate_hz, handler, self._counters)
        self._jobs: SimpleQueue[tuple[Callable[[Board], Any], Future[Any]]] = SimpleQueue()
        self._stopping = threading.Event()
        self._offsets = dict.fromkeys(settings.ids, OffsetsState.NONE_SAVED)
        self._trouble = ''
        self._hello_s = 0.0
        self._stats_due_s = 0.0
        self._comebacks_known: tuple[int, ...] = (0,) * CHANNELS

    # Any thread

    def submit(self, job: Callable[[Board], T]) -> 'Future[T]':
        """Have the session's thread run commands, as ``session.submit(lambda board: board.read_offsets(3))``.

        The future raises a CommandError if the board refuses, and a LinkError if it cannot be reached.
        """
        future: Future[T] = Future()
        self._jobs.put((job, future))
        if self._stopping.is_set():
            self._refuse_jobs('the link is closed')
        return future

    def counters(self) -> Counters:
        """A copy of what was counted so far."""
        board = self._board
        return replace(
            self._counters,
            frame_errors=self._decoder.errors,
            malformed=self._counters.malformed + (board.malformed if board else 0),
            retries=self._counters.retries + (board.retries if board else 0),
            clock_jumps=self._intake.clock.jumps,
            clock_doubts=self._intake.clock.doubted,
            wall_clock_steps=self._intake.wall.steps,
        )

    def imus(self) -> dict[int, ImuStatus]:
        """How each IMU was in the latest sweep; empty before the first."""
        data = self._intake.latest
        if data is None:
            return {}
        rows = zip(data.sweep.ids, data.states, data.errors, data.scores, strict=True)
        return {i: ImuStatus(state, errors, scores, self._offsets[i]) for i, state, errors, scores in rows}

    def stop(self) -> None:
        """Make `run` return soon, also while it waits for a board."""
        self._stopping.set()
        if board := self._board:
            board.port.cancel()

    # The session's thread

    def connect(self) -> None:
        """Open the port and set the board up. Call it before `run` to have the first failure raised.

        Raises
        ------
        LinkError
            If the port cannot be opened, or the board does not answer or refuses.
        ProtocolVersionError
            If the board speaks another protocol version.
        """
        port = SerialPort(self.settings.port, self.settings.baud)
        self._decoder.resynchronise()
        self._board = Board(port, self._intake.take, self._decoder, self.settings.board)
        if self._stopping.is_set():
            port.cancel()
        try:
            errors_before = self._decoder.errors
            self._greet(self._board)
            self._counters.stray_frames += self._decoder.errors.total - errors_before.total
            self._decoder.errors = errors_before
            self._set_up(self._board)
        except BaseException:
            self._disconnect()
            raise

    def run(self) -> None:
        """Keep the link up until `stop`.

        Raises
        ------
        ProtocolVersionError
            If a board of another protocol version was plugged in.
        """
        try:
            while not self._stopping.is_set():
                try:
                    if self._board is None:
                        again = self.hello is not None
                        self.connect()
                        self._counters.reconnects += again
                    else:
                        self._turn(self._board)
                except ProtocolVersionError:
                    raise
                except LinkError as error:
                    self._give_up(error)
        finally:
            self._stopping.set()
            if self._board:
                with suppress(LinkError):
                    self._board.hush()
            self._disconnect()
            self._refuse_jobs('the link is closed')

    def _give_up(self, error: LinkError) -> None:
        """Close the port and wait a little; say why, but not again and again."""
        self._disconnect()
        if str(error) != self._trouble and not self._stopping.is_set():
            self._trouble = str(error)
            self._tell(Level.ERROR, f'{error}; trying again')
        self._refuse_jobs(str(error))
        self._stopping.wait(_RECONNECT_S)

    def _disconnect(self) -> None:
        self.connected = False
        self._intake.end()
        if board := self._board:
            self._board = None
            self._counters.malformed += board.malformed
            self._counters.retries += board.retries
            board.port.close()

    def _turn(self, board: Board) -> None:
        board.poll(_TURN_S)
        self._do_jobs(board)
        now_s = time.monotonic()
        if now_s >= self._stats_due_s or self._intake.returned:
            self._look_after(board)
            self._stats_due_s = now_s + _STATS_PERIOD_S
        if self._intake.is_silent():
            self._revive(board)

    def _greet(self, board: Board) -> bool:
        """Say HELLO; whether the board was reset since the last time."""
        hello = board.hello()
        now_s = time.monotonic()
        reset = False
        if self.hello:
            # By the time that has passed: a young board may be older than its predecessor was at its first HELLO.
            passed_s = now_s - self._hello_s
            expected_ms = self.hello.uptime_ms + 1000 * passed_s
            missing_ms = (expected_ms - hello.uptime_ms) % _UPTIME_WRAP_MS
            missing_ms -= _UPTIME_WRAP_MS * (missing_ms > _UPTIME_WRAP_MS / 2)
            reset = _UPTIME_TOLERANCE_MS + 10 * passed_s < missing_ms
            self._counters.board_resets += reset
        self.hello, self._hello_s = hello, now_s
        return reset

    def _set_up(self, board: Board) -> None:
        """Everything that a board which knows nothing has to be told."""
        settings = self.settings
        assert self.hello is not None
        if self.hello.outdated:
            self._tell(Level.WARN, f'{settings.port}: {outdated_firmware(self.hello)}')
        self._intake.end()
        written = [imu_id for imu_id in settings.ids if self._write(board, imu_id)]
        mask = mask_of(settings.ids)
        board.configure(BoardConfiguration(mask, settings.rate_hz, settings.fusion, settings.i2c_100khz))
        streamed_before = self._intake.latest is not None
        self._intake.begin()
        board.stream(settings.stream)
        self.stats = board.stats()
        self._comebacks_known = self.stats.comebacks
        self._stats_due_s = time.monotonic() + _STATS_PERIOD_S
        self.connected = True
        self._trouble = ''
        self._tell(Level.INFO, f'{settings.port}: board with firmware {self.hello.firmware} streams')
        if streamed_before and settings.fusion.loses_heading:
            self._tell(
                Level.WARN,
                f'{settings.port}: the chips start with new headings, since mode IMU has no north: align again',
            )
        # A board that has just started uses no chip yet: it keeps what it was given, and calls the chip absent.
        present = {*written, *ids_of(self.hello.channels, settings.board)}
        for imu_id in settings.ids:
            if imu_id in present:
                self._compare(board, imu_id)
            elif imu_id in self._saved:
                self._tell(
                    Level.WARN, f'IMU {imu_id} is absent; the board keeps its offsets until it comes back'
                )

    def _write(self, board: Board, imu_id: int) -> bool:
        """Give the board a chip's saved offsets; whether it says that the chip has them."""
        offsets = self._saved.get(imu_id)
        self._offsets[imu_id] = OffsetsState.NOT_CHECKED if offsets else OffsetsState.NONE_SAVED
        if offsets is None:
            return False
        try:
            return board.write_offsets(imu_id, offsets)
        except CommandError as error:
            self._tell(Level.ERROR, str(error))
            return False

    def _compare(self, board: Board, imu_id: int) -> None:
        """Read a chip's offsets and compare them with the saved ones."""
        saved = self._saved.get(imu_id)
        if saved is None:
            return
        try:
            actual = board.read_offsets(imu_id)
        except CommandError as error:
            self._offsets[imu_id] = OffsetsState.NOT_CHECKED
            self._tell(Level.WARN, f'offsets not checked: {error}')
            return
        if actual == saved:
            self._offsets[imu_id] = OffsetsState.AS_SAVED
        else:
            self._offsets[imu_id] = OffsetsState.DIFFERENT
            self._counters.offset_differences += 1
            self._tell(
                Level.WARN, f'IMU {imu_id} works with other offsets than saved: {actual}, saved {saved}'
            )
        self._handler.on_offsets(imu_id, actual)

    def _look_after(self, board: Board) -> None:
        """Once a second, or as soon as a chip ran again: counters, the wall clock, chips that came back."""
        if step_ns := self._intake.wall.look():
            self._tell(Level.WARN, f'the wall clock was stepped by {step_ns / NS:+.3f} s; stamps follow it')
        self.stats = board.stats()
        counts = zip(self.stats.comebacks, self._comebacks_known, strict=True)
        # A chip that lost its power for less than a sweep is seen in this counter alone.
        risen = (k for k, (now, known) in enumerate(counts) if now > known)
        unseen = {imu_id_at(self.settings.board, k) for k in risen} - self._intake.absent
        self._comebacks_known = self.stats.comebacks
        returned = unseen & set(self.settings.ids) | self._intake.returned
        self._intake.returned = set()
        for imu_id in sorted(returned):
            self._counters.comebacks += 1
            self._compare(board, imu_id)
            if self.settings.fusion.loses_heading:
                self._tell(
                    Level.WARN,
                    f'IMU {imu_id} is back with a new heading, since mode IMU has no north: align again',
                )
            else:
                self._tell(Level.INFO, f'IMU {imu_id} is back; offsets: {self._offsets[imu_id].value}')
        for imu_id, imu in self.imus().items():
            # A chip that came just after HELLO was absent in no sweep; offsets may have been saved meanwhile.
            unchecked = imu.offsets is OffsetsState.NOT_CHECKED or (
                imu.offsets is OffsetsState.NONE_SAVED and imu_id in self._saved
            )
            if unchecked and imu.state is State.RUN and imu_id not in self._intake.returned:
                self._compare(board, imu_id)

    def _revive(self, board: Board) -> None:
        self.connected = False
        if self._greet(board):
            self._tell(Level.WARN, f'{self.settings.port}: the board was reset; it is set up again')
        else:
            self._counters.stalls += 1
            self._tell(
                Level.WARN,
                f'{self.settings.port}: the board answers, but does not stream; it is set up again',
            )
        self._set_up(board)

    def _do_jobs(self, board: Board) -> None:
        for job, future in self._waiting_jobs():
            try:
                future.set_result(job(board))
            except Exception as error:
                future.set_exception(error)
                if isinstance(error, LinkError) and not isinstance(error, CommandError):
                    raise

    def _refuse_jobs(self, why: str) -> None:
        for _, future in self._waiting_jobs():
            future.set_exception(LinkError(why))

    def _waiting_jobs(self) -> list[tuple[Callable[[Board], Any], 'Future[Any]']]:
        jobs = []
        with suppress(Empty):
            while not self._jobs.empty():
                job, future = self._jobs.get_nowait()
                if future.set_running_or_notify_cancel():
                    jobs.append((job, future))
        return jobs

    def _tell(self, level: Level, message: str) -> None:
        self._handler.on_event(Event(level, message))


def outdated_firmware(hello: Hello) -> str:
    """What to tell the user of a board whose firmware is older than this package's, though it speaks its protocol."""
    expected = '.'.join(map(str, FIRMWARE))
    found = f'the board has firmware {hello.firmware}, this package comes with {expected}'
    return f'{found}: bring it up to date ({UPLOAD})'
