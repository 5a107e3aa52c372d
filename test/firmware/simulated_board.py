"""The simulated board (firmware/simulator) as a test holds it: time moves only when the test moves it.

`SimulatedBoard` starts the simulator and speaks to its control socket; `SteppedPort` is the board's serial port for
`sesa2.link.board_client.Board`, whose waiting moves simulated time; `SimulatedClock` stands in for the module `time`.
"""

import math
import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

FIRMWARE = Path(__file__).parents[2] / 'firmware'
BUILD = FIRMWARE / 'build'
CHANNELS = range(8)

_WALL_PATIENCE_S = 60.0  # how long a hung simulator may keep a test; nothing is measured by it


class SimulatorError(Exception):
    """The simulator refused a command or ended."""


class SimulatedBoard:
    """A running simulator.

    Parameters
    ----------
    real_time
        Simulated time follows the wall clock, and `run` is refused.
    elf
        The firmware; by default the one that ``make -C firmware`` has built.
    """

    def __init__(self, *, real_time: bool = False, elf: Path = BUILD / 'sesa2_firmware.elf') -> None:
        self._folder = tempfile.TemporaryDirectory(prefix='sesa2_board_')
        self.port_path = str(Path(self._folder.name) / 'port')
        control_path = str(Path(self._folder.name) / 'control')
        options = ['--real-time'] if real_time else []
        self._process = subprocess.Popen(
            [BUILD / 'simulated_board', elf, '--port', self.port_path, '--control', control_path, *options]
        )
        self._control = self._connect(control_path)
        self._answers = self._control.makefile('r')
        self._terminal: int | None = None
        self._received = self._sent = 0
        self.now_us = 0

    def __enter__(self) -> 'SimulatedBoard':
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the simulator."""
        if self._terminal is not None:
            os.close(self._terminal)
            self._terminal = None
        self._answers.close()
        self._control.close()
        self._process.terminate()
        self._process.wait(_WALL_PATIENCE_S)
        self._folder.cleanup()

    def command(self, *words: object) -> str:
        """Give a command of firmware/simulator/control.h; its answer without the "ok"."""
        line = ' '.join(map(str, words))
        self._control.sendall(line.encode() + b'\n')
        status, _, answer = self._answers.readline().rstrip('\n').partition(' ')
        if status != 'ok':
            raise SimulatorError(f'{line}: {answer or "the simulator has ended"}')
        return answer

    # ---- time and the serial port ----
    def run(self, seconds: float, send: bytes = b'') -> bytes:
        """Send bytes to the board, let that much simulated time pass, return all that the board has sent meanwhile.

        Deterministic: time moves once the simulator has all the bytes, and all of its bytes are waited for.
        """
        terminal = self._open_terminal()
        if send:
            os.write(terminal, send)
            self._sent += len(send)
        now, total = map(int, self.command('run', round(seconds * 1e6), self._sent).split())
        self.now_us = now
        portions = []
        while self._received < total:
            portions.append(os.read(terminal, 65536))
            self._received += len(portions[-1])
        return b''.join(portions)

    def clock(self) -> 'SimulatedClock':
        """The simulated time, in place of the module `time`."""
        return SimulatedClock(self)

    def port(self) -> 'SteppedPort':
        """The serial port, in place of `sesa2.link.serial_port.SerialPort`."""
        return SteppedPort(self)

    # ---- the world ----
    def set_quaternion(self, channel: int, wxyz: tuple[int, int, int, int]) -> None:
        """What a chip measures, raw: 16384 is one."""
        self.command('quaternion', channel, *wxyz)

    def set_acceleration(self, channel: int, xyz: tuple[int, int, int]) -> None:
        """What a chip measures, raw: 100 is 1 m/s²."""
        self.command('acceleration', channel, *xyz)

    def set_magnetometer(self, channel: int, xyz: tuple[int, int, int]) -> None:
        """What a chip measures, raw: 16 is 1 µT."""
        self.command('magnetometer', channel, *xyz)

    def set_gyroscope(self, channel: int, xyz: Iterable[float]) -> None:
        """What a chip measures, raw: 16 is 1 °/s."""
        self.command('gyroscope', channel, *map(round, xyz))

    def set_pattern(self) -> None:
        """All chips turn on by themselves; see `pattern`."""
        for channel in CHANNELS:
            self.command('pattern', channel, 1)

    def registers(self, channel: int, first: int, count: int) -> bytes:
        """Registers as they stand in a chip, whatever its mode."""
        return bytes.fromhex(self.command('register', channel, first, count))

    def mode(self, channel: int) -> int:
        """The mode that a chip is in."""
        return int(self.command('mode', channel))

    def stats(self) -> dict[str, int]:
        """What the simulator has counted."""
        return {
            name: int(value) for name, value in (word.split('=') for word in self.command('stats').split())
        }

    def _connect(self, path: str) -> socket.socket:
        deadline = time.monotonic() + _WALL_PATIENCE_S
        while True:
            control = socket.socket(socket.AF_UNIX)
            control.settimeout(_WALL_PATIENCE_S)
            try:
                control.connect(path)
            except OSError:
                control.close()
                if self._process.poll() is not None or time.monotonic() > deadline:
                    raise SimulatorError(
                        f'the simulator did not start: exit status {self._process.poll()}'
                    ) from None
                time.sleep(0.01)
            else:
                return control

    def _open_terminal(self) -> int:
        if self._terminal is None:
            self._terminal = os.open(self.port_path, os.O_RDWR | os.O_NOCTTY)
        return self._terminal


class SteppedPort:
    """A serial port whose reads take simulated time, a millisecond at a time."""

    baud = 500000
    _STEP_S = 0.001

    def __init__(self, board: SimulatedBoard) -> None:
        self._board = board
        self._to_send = b''
        self.path = board.port_path

    def write(self, data: bytes) -> None:
        """Send with the next read."""
        self._to_send += data

    def read(self, timeout_s: float) -> bytes:
        """What arrives first within a simulated time; empty if nothing does."""
        end_us = self._board.now_us + timeout_s * 1e6
        while True:
            received = self._board.run(self._STEP_S, self._to_send)
            self._to_send = b''
            if received or self._board.now_us >= end_us:
                return received


class SimulatedClock:
    """The functions of the module `time` that the link uses."""

    def __init__(self, board: SimulatedBoard) -> None:
        self._board = board

    def monotonic(self) -> float:
        """Simulated time, s."""
        return self._board.now_us * 1e-6

    def monotonic_ns(self) -> int:
        """Simulated time, ns."""
        return self._board.now_us * 1000


class Reading(NamedTuple):
    """When a chip's output was made."""

    channel: int
    tick: int


def pattern(reading: Reading) -> tuple[int, int, int, int]:
    """The quaternion w x y z, raw, that a chip of `SimulatedBoard.set_pattern` shows from a tick of its 10 ms on."""
    channel, tick = reading
    half_angle = math.pi * (tick % 997) / 997 + 0.1 * channel
    wxyz = [0, 0, 0, 0]
    wxyz[0] = round(16384 * math.cos(half_angle))
    wxyz[1 + channel % 3] = round(16384 * math.sin(half_angle))
    return tuple(wxyz)


def tick_at(channel: int, time_us: float) -> int:
    """The last tick of a chip at a simulated time."""
    return int((time_us + 1250 * channel) // 10000)
