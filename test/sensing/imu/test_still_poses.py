import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from sesa2.sensing.imu.still_poses import still_poses

RATE = 100.0
UP = np.vstack([v for axis in np.eye(3) for v in (axis, -axis)])
NOISE, GYRO_NOISE, GYRO_BIAS = 0.05, 0.01, np.array([0.05, -0.03, 0.02])


def recording(rng, held_s, turning_s=1.5):
    """An IMU that is held with each side up and turned to the next; times, accelerations, angular velocities, spans."""
    knots, at, spans, t = [], [], [], 0.0
    for up, s in zip(UP, held_s, strict=True):
        turn, _ = Rotation.align_vectors([[0, 0, 1]], [up])
        knots += [turn, turn]
        at += [t, t + s]
        spans.append((t, t + s))
        t += s + turning_s
    times = np.arange(0.0, at[-1], 1 / RATE)
    motion = Slerp(at, Rotation.concatenate(knots))
    into_sensor = motion(times).inv()
    after = motion(np.minimum(times + 1e-3, at[-1]))
    w = (into_sensor * after).as_rotvec() / 1e-3 + GYRO_BIAS
    a = into_sensor.apply([0, 0, 9.81])
    return times, a + rng.normal(0, NOISE, a.shape), w + rng.normal(0, GYRO_NOISE, w.shape), spans


def test_each_pose_is_found_and_its_mean_is_that_of_its_gravity():
    times, a, w, spans = recording(np.random.default_rng(0), [2.0, 3.0, 1.6, 10.0, 2.0, 5.0])
    found = still_poses(times, a, w)
    assert len(found) == 6
    for pose, (start, end), up in zip(found, spans, UP, strict=True):
        assert start - 0.3 < pose.start < start + 0.4
        assert end - 0.4 < pose.end < end + 0.3
        np.testing.assert_allclose(pose.acceleration, 9.81 * up, atol=0.03)


def test_what_is_held_for_less_than_a_second_is_no_pose():
    times, a, w, _ = recording(np.random.default_rng(1), [2.0, 0.5, 2.0, 2.0, 0.7, 2.0])
    assert len(still_poses(times, a, w)) == 4


def test_a_slow_turn_is_no_pose():
    times = np.arange(0, 20, 1 / RATE)
    into_sensor = Rotation.from_rotvec(np.outer(times, [0.15, 0, 0])).inv()
    a = into_sensor.apply([0, 0, 9.81])
    assert still_poses(times, a, np.tile([0.15, 0, 0], (len(times), 1))) == []


def test_a_gap_ends_a_pose():
    times = np.concatenate([np.arange(0, 3, 0.01), np.arange(8, 10, 0.01)])
    found = still_poses(times, np.tile([0, 0, 9.81], (len(times), 1)), np.zeros((len(times), 3)))
    assert [(pose.start, pytest.approx(pose.end)) for pose in found] == [(0.0, 2.99), (8.0, 9.99)]


def test_nothing_is_no_pose():
    assert still_poses(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))) == []
