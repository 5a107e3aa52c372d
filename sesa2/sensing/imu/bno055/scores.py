"""Calibration scores of a BNO055: which of them count, and what to do next (thesis 4.2.4)."""

from typing import NamedTuple

COMPLETE = 3
# The system score says how sure the fusion is at the moment. Of some chips it stays low or comes and goes for minutes,
# while the sensors, whose offsets are kept, are calibrated; then it is not waited for longer than this, s.
SYSTEM_PATIENCE = 5.0


class Scores(NamedTuple):
    """Calibration scores, 0 (not calibrated) to 3, in the order of register 0x35."""

    sys: int
    gyro: int
    accel: int
    mag: int

    def complete(self, fusion: str) -> bool:
        """Whether every score that the fusion mode uses has reached 3.

        Parameters
        ----------
        fusion
            NDOF, NDOF_FMC_OFF or IMU; the last has no magnetometer, and its system score means nothing.
        """
        return self.sensors_complete(fusion) and (fusion == 'IMU' or self.sys >= COMPLETE)

    def sensors_complete(self, fusion: str) -> bool:
        """The same without the system score: whether the offsets are known."""
        return all(score >= COMPLETE for score in self._sensors(fusion))

    def next_step(self, fusion: str) -> str:
        """What to do now to bring the scores up; the sensors in the order in which they are best done."""
        if self.gyro < COMPLETE:
            return 'keep it still for a few seconds (gyroscope)'
        if fusion != 'IMU' and self.mag < COMPLETE:
            return 'draw figures of eight in the air (magnetometer)'
        if self.accel < COMPLETE:
            return (
                'hold it still for a few seconds in each of six poses, every side down once (accelerometer)'
            )
        if not self.complete(fusion):
            return 'move it a little and wait (fusion)'
        return 'calibrated'

    def _sensors(self, fusion: str) -> tuple[int, ...]:
        return (self.gyro, self.accel) if fusion == 'IMU' else (self.gyro, self.accel, self.mag)
