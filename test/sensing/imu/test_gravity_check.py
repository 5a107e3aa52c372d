"""Orientation against acceleration; what IMUs measure is made with scipy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.sensing.imu.gravity_check import (
    CONJUGATED,
    DISAGREES,
    NO_ORIENTATION_GIVEN,
    POINTS_DOWN,
    W_FIRST,
    GravityCheck,
)

NED = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
N = 200
NOT_MEASURED = np.full((N, 3), np.nan)


def poses(middle=None, spread=0.5, seed=4):
    """Orientations about a middle one, by up to so much, rad."""
    turns = np.random.default_rng(seed).uniform(-spread, spread, (N, 3))
    return Rotation.from_rotvec(turns) * (middle or Rotation.identity())


def felt(q, seed=5, strength=9.81):
    """Accelerations: gravity and some motion."""
    motion = np.random.default_rng(seed).normal(0.0, 0.7, (N, 3))
    return q.inv().apply(np.array([0.0, 0.0, strength]) + motion)


def doubts(q, a, w=NOT_MEASURED, **options):
    check = GravityCheck(**options)
    for half in np.array_split(np.arange(N), 2):
        check.add(3, q[half], w[half], a[half])
    check.add(5, poses().as_quat(), NOT_MEASURED, felt(poses()))  # beside a sound one
    return check.doubts


@pytest.mark.parametrize('seed', range(8))
@pytest.mark.parametrize('strength', [9.81, 9.78, 1.0, 0.0])
def test_a_sound_imu_is_not_doubted_whatever_its_mounting(seed, strength):
    q = poses(Rotation.random(random_state=seed), 1.5)
    assert doubts(q.as_quat(), felt(q, strength=strength)) == []


@pytest.mark.parametrize('seed', range(8))
def test_an_earth_frame_that_points_down_is_told_unless_the_base_does(seed):
    q = poses(Rotation.random(random_state=seed))
    assert doubts((NED * q).as_quat(), felt(q)) == [f'IMU 3: {POINTS_DOWN}']
    assert doubts(q.as_quat(), -felt(q)) == [f'IMU 3: {POINTS_DOWN}']
    assert doubts((NED * q).as_quat(), felt(q), base_tells=True) == []


@pytest.mark.parametrize('seed', range(8))
def test_other_readings_of_a_quaternion_are_told_apart(seed):
    q = poses(Rotation.random(random_state=seed), 1.0)
    x, y, z, w = q.as_quat().T
    assert doubts(np.stack([-x, -y, -z, w], -1), felt(q), base_tells=True) == [f'IMU 3: {CONJUGATED}']
    assert doubts(np.stack([w, x, y, z], -1), felt(q), base_tells=True) == [f'IMU 3: {W_FIRST}']


def test_accelerations_in_other_axes():
    q = poses()
    assert doubts(q.as_quat(), np.roll(felt(q), 1, axis=1)) == [f'IMU 3: {DISAGREES}']


def test_a_number_that_stands_in_is_no_measurement():
    q = poses(Rotation.from_euler('x', 100, degrees=True))
    assert doubts(q.as_quat(), np.tile([0.0, 0.0, 9.81], (N, 1))) == []
    assert doubts(q.as_quat(), NOT_MEASURED) == []


def test_an_empty_orientation_is_told_where_the_imu_turns():
    empty = np.tile([0.0, 0.0, 0.0, 1.0], (N, 1))
    turning = np.zeros((N, 3))
    turning[N // 3, 1] = -0.5
    assert doubts(empty, felt(poses()), turning) == [f'IMU 3: {NO_ORIENTATION_GIVEN}']
    still = np.full((N, 3), 0.01)
    assert doubts(empty, felt(poses(spread=0.0)), still) == []
    moving = empty.copy()
    moving[-1] = (0.0, 0.1, 0.0, 0.99)
    assert doubts(moving, felt(poses(spread=0.0)), turning) == []


def test_a_few_samples_tell_nothing():
    check = GravityCheck()
    q = NED * poses()
    check.add(3, q.as_quat()[:10], NOT_MEASURED[:10], felt(poses())[:10])
    assert check.doubts == GravityCheck().doubts == []
