"""The package's virtual firmware in the place of the simulated board: the same controls, and time that a test moves."""

from collections.abc import Iterable
from dataclasses import dataclass
from random import Random

import numpy as np
from simulated_board import CHANNELS, SimulatedClock, SteppedPort

from sesa2.link.virtual.chip import Chip
from sesa2.link.virtual.firmware import EXTERNAL_RESET, POWER_ON, Firmware
from sesa2.shape import rotations

_US_PER_S = 1_000_000


@dataclass
class ChipInHand(Chip):
    """A chip whose scores a test sets, and that can refuse its offsets."""

    scores: int = 0
    refuses: bool = False

    def calib(self, now_us: int) -> int:
        """Register 0x35."""
        return self.scores if self.mode else 0

    def write_offsets(self, registers: bytes) -> None:
        """Registers 0x55 to 0x6A."""
        if not self.refuses:
            super().write_offsets(registers)


class VirtualWorld:
    """The virtual firmware with eight chips that are given power now."""

    port_path = 'virtual'

    def __init__(self) -> None:
        self.now_us = 0
        self._chips = {k + 1: ChipInHand(Random(k), 0) for k in CHANNELS}
        self._quaternions = dict.fromkeys(self._chips, (0.0, 0.0, 0.0, 1.0))
        self._velocities = dict.fromkeys(self._chips, np.zeros(3))
        for chip in self._chips.values():
            chip.power_on(0)
        self._start(POWER_ON)

    def _start(self, cause: int) -> None:
        self._born_us = self.now_us
        self._firmware = Firmware(self._chips, self._measure, born_us=self.now_us, reset_cause=cause)

    def _measure(self, ids, t_us, headings):
        rows = np.array([self._quaternions[i] for i in ids])
        turned = np.asarray(t_us)[..., np.newaxis] * 1e-6 * [self._velocities[i] for i in ids]
        return rotations.multiply(rows, rotations.from_rotation_vector(turned))

    def run(self, seconds: float, send: bytes = b'') -> bytes:
        """Send bytes to the board, let time pass, return all that the board has sent meanwhile."""
        if send:
            self._firmware.receive(send, self.now_us - self._born_us)
        end_us = self.now_us + round(seconds * _US_PER_S)
        sent = []
        while True:
            sent += self._firmware.advance(self.now_us - self._born_us)
            if self.now_us >= end_us:
                return b''.join(sent)
            self.now_us = min(end_us, max(self.now_us + 1, self._firmware.next_us() + self._born_us))

    def command(self, word: str, *arguments: int) -> None:
        """A command of firmware/simulator/control.h."""
        chip = self._chips[arguments[0] + 1] if arguments else None
        match word, chip:
            case 'unplug', ChipInHand():
                chip.unplug()
            case 'plug', ChipInHand():
                chip.power_on(self.now_us)
            case 'calibration', ChipInHand():
                chip.scores = arguments[1]
            case 'refuse', ChipInHand():
                chip.refuses = bool(arguments[1])
            case 'reset', None:
                self._start(EXTERNAL_RESET)
            case _:
                raise ValueError(f'{word} {arguments}: not for the virtual board')

    def set_quaternion(self, channel: int, wxyz: tuple[int, int, int, int]) -> None:
        """What a chip measures, raw: 16384 is one."""
        w, x, y, z = (value / 16384 for value in wxyz)
        self._quaternions[channel + 1] = (x, y, z, w)

    def set_acceleration(self, channel: int, xyz: tuple[int, int, int]) -> None:
        """Gravity alone is what virtual chips measure, as their orientation has it."""

    def set_magnetometer(self, channel: int, xyz: tuple[int, int, int]) -> None:
        """The earth's field is what virtual chips measure, as their orientation has it."""

    def set_gyroscope(self, channel: int, xyz: Iterable[float]) -> None:
        """Turn a chip from now on, raw: 16 is 1 °/s in its own axes."""
        self._velocities[channel + 1] = np.deg2rad(xyz) / 16

    def clock(self) -> SimulatedClock:
        """Its time, in place of the module `time`."""
        return SimulatedClock(self)

    def port(self) -> SteppedPort:
        """Its serial port."""
        return SteppedPort(self)
