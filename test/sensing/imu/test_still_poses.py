import numpy as np
import pytest
from held_poses import RATE, UP, recording
from scipy.spatial.transform import Rotation

from sesa2.sensing.imu.still_poses import still_poses


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
