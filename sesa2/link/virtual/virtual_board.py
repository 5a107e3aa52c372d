"""The virtual board on a pseudo-terminal, run by the clock in a thread of its own, with faults on demand."""

import contextlib
import os
import select
import threading
import tty
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from pathlib import Path
from queue import SimpleQueue
from random import Random
from types import TracebackType

from sesa2.link.clock import steady_ns
from sesa2.link.link_errors import LinkError
from sesa2.link.packets import VERSION
from sesa2.link.requests import FIRMWARE
from sesa2.link.virtual.chip import Chip
from sesa2.link.virtual.firmware import EXTERNAL_RESET, POWER_ON, Firmware
from sesa2.link.virtual.motion import FloatArray
from sesa2.link.virtual.virtual_arm import VirtualArm
from sesa2.sensing.imu.addresses import ids_by_board
from sesa2.time import NS

_LONGEST_WAIT_S = 1.0


class VirtualBoard:
    """A board with IMUs on a moving arm, reached like a real one by opening `path`. Use it as a context manager.

    Parameters
    ----------
    arm
        The IMUs and how they move; those of this board hang on it.
    number
        Which board it is, from 0: it has the IMUs with the ids from 8 · number + 1 on.
    epoch_ns
        Time of `sesa2.link.clock.steady_ns` at which the motion begins; by default now. Boards on one arm share it.
    link
        A symbolic link to make to the pseudo-terminal, whose own name changes whenever the cable is unplugged.
    calibration_s
        From the start of a chip to full calibration scores.
    boot_s
        How long the board is deaf and mute after a reset: a Mega's boot loader.
    baud
        The line's speed: packets take their time.
    version, release
        Protocol version and firmware version to claim.
    seed
        Of what differs between chips, and of the faults.
    ahead
        How many sweeps are measured at once, ahead of their time; 1 where the motion is not known before.

    Raises
    ------
    LinkError
        If the link's path is taken by something else.
    """

    def __init__(
        self,
        arm: VirtualArm,
        *,
        number: int = 0,
        epoch_ns: int | None = None,
        link: Path | str | None = None,
        calibration_s: float = 12.0,
        boot_s: float = 1.0,
        baud: int = 500_000,
        version: int = VERSION,
        release: tuple[int, int] = FIRMWARE,
        seed: int = 0,
        ahead: int = 16,
    ) -> None:
        self.arm = arm
        self._link = Path(link) if link else None
        if self._link and self._link.exists() and not self._link.is_symlink():
            raise LinkError(f'{self._link} exists and is no symbolic link: not replaced')
        self._boot_us = round(boot_s * 1e6)
        self._baud = baud
        self._number = number
        self._ahead = ahead
        self._version = version
        self._release = release
        self._random = Random(seed)
        calibration_us = round(calibration_s * 1e6)
        ids = ids_by_board(arm.ids).get(number, ())
        self._chips = {i: Chip(Random(f'{seed} {i}'), calibration_us) for i in ids}
        self._epoch_ns = steady_ns() if epoch_ns is None else epoch_ns
        self._orders: SimpleQueue[tuple[Callable[[], None], Future[None]]] = SimpleQueue()
        self._wake_out, self._wake_in = os.pipe()
        self._pty: tuple[int, int] | None = None
        self._path = ''
        self._stopped = self._muted = False
        self._lose = self._corrupt = 0
        self._unsent = b''
        self._start(0)
        self._plug()
        self._thread = threading.Thread(target=self._run, name='virtual board', daemon=True)
        self._thread.start()

    @property
    def path(self) -> str:
        """What to open: the link, or without one the pseudo-terminal."""
        return str(self._link) if self._link else self._path

    # The truth

    def truth(self, t: FloatArray | float) -> FloatArray:
        """q_WL of the IMUs at times t of the motion, s: shape t.shape + (n_imu, 4)."""
        return self.arm.motion(t)  # type: ignore[arg-type]

    def motion_time(self, at_ns: float) -> float:
        """Time of the motion, s, at a time of `sesa2.link.clock.steady_ns`."""
        return (at_ns - self._epoch_ns) / NS

    def motion_time_of(self, t_us: float) -> float:
        """Time of the motion, s, at a time of the board's clock, µs, of its latest start and at most an hour ago."""
        now_us = self._now_us() - self._born_us
        return (self._born_us + now_us - (now_us - t_us) % 2**32) * 1e-6

    # Faults

    def unplug(self, imu_id: int) -> None:
        """Pull an IMU's cable."""
        self._do(self._chips[imu_id].unplug)

    def plug(self, imu_id: int) -> None:
        """Put it back: the chip boots, knowing nothing."""
        self._do(lambda: self._chips[imu_id].power_on(self._now_us()))

    def lose_bytes(self, count: int) -> None:
        """Lose the next bytes on their way to the PC."""
        self._do(lambda: setattr(self, '_lose', self._lose + count))

    def corrupt_frames(self, count: int) -> None:
        """Flip a bit in each of the next frames to the PC."""
        self._do(lambda: setattr(self, '_corrupt', self._corrupt + count))

    def mute(self) -> None:
        """Hang: take nothing and send nothing."""
        self._do(lambda: setattr(self, '_muted', True))

    def unmute(self) -> None:
        """Go on; what would have been sent meanwhile is lost."""
        self._do(lambda: setattr(self, '_muted', False))

    def reset(self) -> None:
        """Press the reset button: the board forgets all, the chips keep their power."""
        self._do(lambda: self._start(self._boot_us, EXTERNAL_RESET))

    def unplug_cable(self) -> None:
        """Pull the USB cable: the port is gone, and so is the power of board and chips."""
        self._do(self._unplug)

    def plug_cable(self) -> None:
        """Put it back: another pseudo-terminal under the same link, and everything boots."""
        self._do(self._replug)

    def close(self) -> None:
        """End the thread, close the pseudo-terminal and take the link away."""
        if not self._stopped:
            self._do(lambda: setattr(self, '_stopped', True))
            self._thread.join()
            self._unplug()
            os.close(self._wake_in)
            os.close(self._wake_out)

    def __enter__(self) -> 'VirtualBoard':
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # All that follows runs in the board's thread (or before it starts, or after it ended)

    def _do(self, order: Callable[[], None]) -> None:
        """Have the board's thread do something, and wait until it did."""
        done: Future[None] = Future()
        self._orders.put((order, done))
        os.write(self._wake_in, b'!')
        done.result()

    def _now_us(self) -> int:
        return (steady_ns() - self._epoch_ns) // 1000

    def _start(self, boot_us: int, cause: int = POWER_ON) -> None:
        self._born_us = self._now_us() + boot_us
        self._unsent = b''
        self._firmware = Firmware(
            self._chips,
            self._measure,
            born_us=self._born_us,
            baud=self._baud,
            board=self._number,
            version=self._version,
            release=self._release,
            reset_cause=cause,
            ahead=self._ahead,
        )

    def _measure(self, ids: Sequence[int], t_us: FloatArray, headings: FloatArray) -> FloatArray:
        return self.arm.orientations(ids, (self._born_us + t_us) * 1e-6, headings)

    def _plug(self) -> None:
        self._pty = os.openpty()
        tty.setraw(self._pty[1])  # else the terminal echoes what the board sends before a client sets it
        os.set_blocking(self._pty[0], False)
        self._path = os.ttyname(self._pty[1])
        if self._link:
            fresh = self._link.with_name(f'.{self._link.name}.{os.getpid()}')
            fresh.unlink(missing_ok=True)
            fresh.symlink_to(self._path)
            fresh.replace(self._link)

    def _unplug(self) -> None:
        if self._pty:
            if self._link:
                self._link.unlink(missing_ok=True)
            for descriptor in self._pty:
                os.close(descriptor)
            self._pty = None
        for chip in self._chips.values():
            chip.unplug()

    def _replug(self) -> None:
        self._start(self._boot_us)
        for chip in self._chips.values():
            chip.power_on(self._now_us())
        self._plug()

    def _run(self) -> None:
        while not self._stopped:
            wait_s = _LONGEST_WAIT_S
            now_us = self._now_us() - self._born_us
            if self._pty and not self._muted:
                if now_us >= 0:
                    self._send(self._firmware.advance(now_us))
                    wait_s = min(wait_s, (self._firmware.next_us() - now_us) * 1e-6)
                else:
                    wait_s = min(wait_s, -now_us * 1e-6)
            listening = [self._wake_out] + ([self._pty[0]] if self._pty else [])
            readable, _, _ = select.select(listening, [], [], max(0.0, wait_s))
            if self._pty and self._pty[0] in readable:
                self._receive(self._pty[0])
            if self._wake_out in readable:
                self._obey()

    def _obey(self) -> None:
        os.read(self._wake_out, 4096)
        while not self._orders.empty():
            order, done = self._orders.get()
            try:
                order()
            except Exception as error:
                done.set_exception(error)
            else:
                done.set_result(None)

    def _receive(self, descriptor: int) -> None:
        portion = os.read(descriptor, 4096)
        now_us = self._now_us() - self._born_us
        if now_us >= 0 and not self._muted:
            self._firmware.receive(portion, now_us)

    def _send(self, frames: list[bytes]) -> None:
        assert self._pty is not None
        for frame in frames:
            if self._unsent:  # the PC does not read: a board has no room to keep what comes
                self._unsent = self._write(self._unsent)
            if self._unsent:
                self._firmware.tx_dropped += 1
            else:
                self._unsent = self._write(self._harmed(frame))

    def _harmed(self, frame: bytes) -> bytes:
        if self._corrupt:
            self._corrupt -= 1
            harmed = bytearray(frame)
            harmed[self._random.randrange(len(frame) - 1)] ^= 1 << self._random.randrange(8)
            frame = bytes(harmed)
        lost = min(self._lose, len(frame))
        self._lose -= lost
        return frame[lost:]

    def _write(self, content: bytes) -> bytes:
        """Write what the pseudo-terminal takes; the rest."""
        assert self._pty is not None
        with contextlib.suppress(BlockingIOError):
            return content[os.write(self._pty[0], content) :]
        return content
