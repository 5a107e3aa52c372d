"""The behaviour of one BNO055, as far as the board can see it."""

from dataclasses import dataclass, field
from random import Random

from sesa2.link.packets import register_of
from sesa2.link.requests import FusionMode
from sesa2.sensing.imu.bno055.offsets import Offsets
from sesa2.sensing.imu.bno055.scores import Scores

BOOT_US = 650_000
_CONFIG = 0x00
_AT_POWER_ON = Offsets((0, 0, 0), (0, 0, 0), (0, 0, 0), 1000, 480).to_registers()


@dataclass
class Chip:
    """One BNO055. Times are those of the virtual world, µs.

    Parameters
    ----------
    random
        Draws what differs between chips: the offsets that calibration finds, and the headings of IMU mode.
    calibration_us
        From the start of fusion to full scores. A chip that was given offsets needs a quarter of it.
    """

    random: Random
    calibration_us: int
    ready_us: int | None = 0
    """When it answers on the bus; None without power."""
    mode: int = _CONFIG
    heading: float = 0.0
    """Of its earth frame, rad. In IMU mode there is no north, so that every power-on makes another one."""
    _registers: bytes = _AT_POWER_ON
    _given: bool = False
    _fused_us: int = 0
    _resumed_us: int = 0
    _learned: bytes = field(init=False)

    def __post_init__(self) -> None:
        draw = self.random.randint
        self._learned = Offsets(
            (draw(-60, 60), draw(-60, 60), draw(-60, 60)),
            (draw(-400, 400), draw(-400, 400), draw(-400, 400)),
            (draw(-4, 4), draw(-4, 4), draw(-4, 4)),
            1000,
            draw(400, 800),
        ).to_registers()

    def unplug(self) -> None:
        """Take the power away, and with it all that the chip knows."""
        self.ready_us = None

    def power_on(self, now_us: int) -> None:
        """Start from nothing; also what a reset does."""
        self.ready_us = now_us + BOOT_US
        self.mode = _CONFIG
        self._registers, self._given, self._fused_us = _AT_POWER_ON, False, 0

    def answers(self, now_us: int) -> bool:
        """Whether the chip is powered and past its boot."""
        return self.ready_us is not None and self.ready_us <= now_us

    def set_mode(self, mode: int, now_us: int) -> None:
        """Write register 0x3D. What the fusion has learnt survives a visit to CONFIG mode."""
        if self.mode not in (_CONFIG, FusionMode.RAW):
            if not self._given and min(self._scores(now_us)) == 3:
                self._registers = self._learned
            self._fused_us += now_us - self._resumed_us
        elif mode == FusionMode.IMU and self._fused_us == 0:
            self.heading = self.random.uniform(-0.5, 0.5)
        elif mode != _CONFIG and mode != FusionMode.IMU:
            self.heading = 0.0
        self.mode, self._resumed_us = mode, now_us

    def write_offsets(self, registers: bytes) -> None:
        """Write registers 0x55 to 0x6A; in CONFIG mode."""
        self._registers, self._given = registers, True

    def read_offsets(self) -> bytes:
        """Read registers 0x55 to 0x6A; in CONFIG mode."""
        return self._registers

    def calib(self, now_us: int) -> int:
        """Register 0x35: scores that grow with the time in fusion."""
        if self.mode in (_CONFIG, FusionMode.RAW):
            return 0
        scores = self._scores(now_us)
        gyro, accel, mag = scores if len(scores) == 3 else (*scores, 0)
        return register_of(Scores(min(scores), gyro, accel, mag))

    def _scores(self, now_us: int) -> tuple[int, ...]:
        """Of gyroscope, accelerometer and, unless in IMU mode, magnetometer: the order in which they are easy."""
        duration = self.calibration_us / (4 if self._given else 1)
        progress = (self._fused_us + now_us - self._resumed_us) / max(duration, 1)
        gyro, accel, mag = (min(3, int(3 * progress * speed)) for speed in (4.0, 1.0, 2.0))
        return (gyro, accel) if self.mode == FusionMode.IMU else (gyro, accel, mag)
