"""When a chip is calibrated, and what to do until then."""

import pytest

from sesa2.sensing.imu.bno055.scores import Scores


@pytest.mark.parametrize(
    ('scores', 'ndof', 'imu'),
    [
        (Scores(sys=3, gyro=3, accel=3, mag=3), True, True),
        (Scores(sys=0, gyro=3, accel=3, mag=0), False, True),  # mode IMU has no magnetometer
        (Scores(sys=2, gyro=3, accel=3, mag=3), False, True),
        (Scores(sys=3, gyro=2, accel=3, mag=3), False, False),
        (Scores(sys=3, gyro=3, accel=2, mag=3), False, False),
        (Scores(sys=3, gyro=3, accel=3, mag=2), False, True),
    ],
)
def test_complete_is_what_the_fusion_mode_uses(scores, ndof, imu):
    assert scores.complete('NDOF') == ndof
    assert scores.complete('NDOF_FMC_OFF') == ndof
    assert scores.complete('IMU') == imu


@pytest.mark.parametrize(
    ('scores', 'ndof', 'imu'),
    [
        (Scores(sys=0, gyro=0, accel=0, mag=0), 'gyroscope', 'gyroscope'),
        (Scores(sys=0, gyro=3, accel=0, mag=0), 'magnetometer', 'accelerometer'),
        (Scores(sys=0, gyro=3, accel=0, mag=3), 'accelerometer', 'accelerometer'),
        (Scores(sys=0, gyro=3, accel=3, mag=0), 'magnetometer', 'calibrated'),
        (Scores(sys=1, gyro=3, accel=3, mag=3), 'fusion', 'calibrated'),
        (Scores(sys=3, gyro=3, accel=3, mag=3), 'calibrated', 'calibrated'),
    ],
)
def test_the_next_step_is_the_easiest_that_is_left(scores, ndof, imu):
    assert ndof in scores.next_step('NDOF')
    assert imu in scores.next_step('IMU')
