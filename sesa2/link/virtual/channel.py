"""What the virtual firmware does with the chip on one channel of the multiplexer: a state machine that never waits."""

from collections.abc import Callable

from sesa2.link.packets import State
from sesa2.link.requests import Command, FusionMode, Request, Result
from sesa2.link.virtual.chip import Chip

NEVER = 1 << 62
_CONFIG = 0x00
_TO_CONFIG_US, _TO_FUSION_US = 22_000, 9_000  # as the firmware waits, with its margin
_MAX_FAILURES = 2  # sweeps in a row that failed, until a chip counts as gone
_TRIES = 2  # at each read
_OFFSET_TRIES = 3

Reply = Callable[[Request, Result, bytes], None]


class Channel:
    """One channel; times are µs since the board started.

    Parameters
    ----------
    chip
        What hangs on it, if anything.
    born_us
        Time of the chip's world at the start of the board, µs.
    reply
        How to answer a command.

    Attributes
    ----------
    state
        Where the board is with the chip.
    due_us
        When the present change of mode is over.
    calib
        Register 0x35 as last read.
    errors, all_errors
        I2C errors since the chip last ran, and since the board started; saturating. A chip that is not there is none.
    comebacks
        Times that the chip was gone and ran again; saturating.
    """

    def __init__(self, chip: Chip | None, born_us: int, reply: Reply) -> None:
        self.state = State.ABSENT
        self.due_us = NEVER
        self.calib = self.errors = self.all_errors = self.comebacks = 0
        self._chip = chip
        self._born_us = born_us
        self._reply = reply
        self._mode = _CONFIG  # wanted; CONFIG until the channel is configured
        self._kept: bytes | None = None
        self._waiting: Request | None = None  # answered when the chip is in CONFIG mode
        self._lost = False
        self._failures = 0

    @property
    def occupied(self) -> bool:
        """Whether a command about offsets is not answered yet."""
        return self._waiting is not None

    def configure(self, mode: int, now_us: int) -> None:
        """Have the chip in this mode from now on."""
        changed = mode != self._mode
        self._mode = mode
        if self.state is not State.ABSENT and (changed or self.state is not State.RUN):
            self._to_config(now_us)

    def leave(self) -> None:
        """The chip is in use no more."""
        self._answer(Result.ABSENT)

    def keep(self, registers: bytes) -> None:
        """Offsets for a chip that is not in use yet."""
        self._kept = registers

    def visit(self, request: Request, now_us: int) -> None:
        """WRITE_OFFSETS, READ_OFFSETS or RESET_IMU: to be done in CONFIG mode, or by starting the chip anew."""
        writing = request.command == Command.WRITE_OFFSETS
        if self._chip is None or self.state is State.ABSENT:
            if writing:
                self._kept = request.arguments[1:]
            self._reply(request, Result.ABSENT, b'')
        elif self.state is not State.RUN:
            self._reply(request, Result.BUSY, b'')
        elif request.command == Command.RESET_IMU:
            self._chip.power_on(self._born_us + now_us)
            self._lose()
            self._reply(request, Result.OK, b'')
        else:
            if writing:
                self._kept = request.arguments[1:]
            self._waiting = request
            self._to_config(now_us)

    def refresh_calib(self, now_us: int) -> None:
        """Read register 0x35, which means something where the chip fuses."""
        if self._chip and self._mode != FusionMode.RAW and self._chip.answers(self._born_us + now_us):
            self.calib = self._chip.calib(self._born_us + now_us)

    def sample(self, now_us: int) -> bool:
        """One turn of a sweep: whether the chip has measured. One that fails in two sweeps in a row is gone."""
        if self._chip is None or self.state is not State.RUN:
            return False
        if self._chip.answers(self._born_us + now_us):
            self._failures = 0
            if self._mode == FusionMode.RAW:
                self.calib = 0
            return True
        self._count_errors(_TRIES)
        self._failures += 1
        if self._failures == _MAX_FAILURES:
            self._lose()
        return False

    def step(self, now_us: int) -> bool:
        """Take the chip as far as it gets by now; whether it has just begun to run."""
        chip = self._chip
        if chip is None or self.state is State.RUN:
            return False
        if not chip.answers(self._born_us + now_us):
            if self.state is not State.ABSENT:
                self._count_errors(_TRIES)
                self._lose()
            self.due_us = NEVER if chip.ready_us is None else chip.ready_us - self._born_us
        elif self.state is State.ABSENT:
            self._to_config(now_us)
        if self.state is State.TO_CONFIG and self.due_us <= now_us:
            self._in_config(chip, now_us)
        if self.state is State.TO_NDOF and self.due_us <= now_us:
            self._run(chip, now_us)
            return True
        return False

    def _count_errors(self, count: int) -> None:
        self.errors = min(15, self.errors + count)
        self.all_errors = min(65535, self.all_errors + count)

    def _answer(self, result: Result, fields: bytes = b'') -> None:
        if self._waiting:
            self._reply(self._waiting, result, fields)
            self._waiting = None

    def _lose(self) -> None:
        self.state, self.due_us, self.calib = State.ABSENT, NEVER, 0
        self._lost, self._failures = True, 0
        self._answer(Result.ABSENT)

    def _to_config(self, now_us: int) -> None:
        self.state, self.due_us = State.TO_CONFIG, now_us + _TO_CONFIG_US

    def _in_config(self, chip: Chip, now_us: int) -> None:
        chip.set_mode(_CONFIG, self._born_us + now_us)
        if self._waiting and self._waiting.command == Command.READ_OFFSETS:
            self._answer(Result.OK, chip.read_offsets())
        elif self._kept is not None:
            if chip.read_offsets() != self._kept:
                chip.write_offsets(self._kept)
            taken = chip.read_offsets() == self._kept
            if not taken:
                self._count_errors(_OFFSET_TRIES)
            self._answer(Result.OK if taken else Result.I2C_ERROR)
        self.state, self.due_us = State.TO_NDOF, now_us + _TO_FUSION_US

    def _run(self, chip: Chip, now_us: int) -> None:
        chip.set_mode(self._mode, self._born_us + now_us)
        self.state, self.due_us, self.errors = State.RUN, NEVER, 0
        self.comebacks = min(255, self.comebacks + self._lost)
        self._lost = False
