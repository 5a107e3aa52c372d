"""The accelerometer's calibration, on the thesis's own simulation and on others."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from sesa2.sensing.imu.accelerometer_calibration import (
    SIDES,
    AccelerometerCalibration,
    AccelerometerError,
    calibrate_accelerometer,
    fit_to_directions,
    fit_to_gravity,
    side_up,
)

BOSTON = 9.80368
UP = np.vstack([v for axis in np.eye(3) for v in (axis, -axis)])


def thesis_data(rng, samples):
    """`GenerateData` of the thesis: measured and true, one array a pose; so many samples of each."""

    def turn(axis, mean, sd):
        # As its code has them: the signs of the sines are mixed, which only makes another rotation.
        c, s = np.cos(angle := rng.normal(mean, sd)), np.sin(angle)
        return {
            'x': np.array([[1, 0, 0], [0, c, s], [0, -s, c]]),
            'y': np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
            'z': np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
        }[axis]

    R = turn('x', -0.2, 0.03) @ turn('y', 0.5, 0.01) @ turn('z', -0.1, 0.03)
    true = [np.tile(BOSTON * up, (n, 1)) for up, n in zip(UP, samples, strict=True)]
    return [(s + rng.normal(-0.6, 0.03, s.shape)) @ R.T for s in true], true


def rms(values):
    return np.sqrt(np.mean(np.square(np.concatenate(values))))


@pytest.mark.parametrize(
    'samples',
    [[1000] * 6, [1000, 100, 500, 50, 200, 1000], [3000, 10, 3000, 10, 3000, 10]],
    ids=['balanced', 'unbalanced', 'very unbalanced'],
)
def test_on_the_thesis_simulation_2_percent_of_the_error_are_left(samples):
    rng = np.random.default_rng(1)
    before, after = [], []
    for _ in range(20):
        measured, true = thesis_data(rng, samples)
        fit = calibrate_accelerometer([m.mean(axis=0) for m in measured], BOSTON)
        assert fit.exact
        fresh = [s + m - m.mean(axis=0) for s, m in zip(true, measured, strict=True)]
        assert rms([f - s for f, s in zip(fresh, true, strict=True)]) < 0.031
        before.append(rms([m - s for m, s in zip(measured, true, strict=True)]))
        after.append(rms([fit.calibration.apply(m) - s for m, s in zip(measured, true, strict=True)]))
    assert np.sum(after) / np.sum(before) <= 0.02


@pytest.mark.parametrize('repeated', [(0,), (0, 0, 0, 2), (5, 5, 5, 5, 1)])
def test_poses_that_come_more_than_once_move_no_bias(repeated):
    """The mean over all poses, the thesis's bias, is wrong here by metres per second squared."""
    measured, _ = thesis_data(np.random.default_rng(2), [1000] * 6)
    means = np.array([m.mean(axis=0) for m in measured])
    once = calibrate_accelerometer(means, BOSTON).calibration
    poses = np.vstack([means, means[list(repeated)]])
    again = calibrate_accelerometer(poses, BOSTON).calibration
    np.testing.assert_allclose(again.bias, once.bias, atol=0.01)
    np.testing.assert_allclose(again.matrix, once.matrix, atol=0.001)
    assert np.linalg.norm(poses.mean(axis=0) - once.bias) > 1.0


@given(st.integers(0, 2**32 - 1), st.integers(4, 12))
def test_without_noise_the_fit_to_directions_is_the_inverse(seed, n):
    rng = np.random.default_rng(seed)
    T = np.eye(3) + rng.uniform(-0.1, 0.1, (3, 3))
    bias = rng.uniform(-1, 1, 3)
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    if np.linalg.svd(np.column_stack([directions, np.ones(n)]), compute_uv=False)[-1] < 0.2:
        return
    fitted = fit_to_directions(9.81 * directions @ T.T + bias, directions, 9.81)
    np.testing.assert_allclose(fitted.bias, bias, atol=1e-9)
    np.testing.assert_allclose(fitted.matrix, np.linalg.inv(T), atol=1e-9)


def by_hand(rng, T, bias, directions, degrees=4.0):
    """Poses in which a hand misses the direction by some degrees."""
    held = directions + np.tan(np.deg2rad(degrees)) * rng.normal(size=directions.shape)
    held /= np.linalg.norm(held, axis=1, keepdims=True)
    return 9.80665 * held @ T.T + bias


def test_poses_held_by_hand_tell_bias_and_scale_and_bring_no_misalignment_of_the_hand():
    rng = np.random.default_rng(3)
    T, bias = np.diag([1.02, 0.97, 1.01]), np.array([0.3, -0.5, 0.2])
    for _ in range(20):
        fit = calibrate_accelerometer(by_hand(rng, T, bias, UP))
        assert not fit.exact
        np.testing.assert_allclose(fit.calibration.bias, bias, atol=0.05)
        np.testing.assert_allclose(np.diag(fit.calibration.matrix), 1 / np.diag(T), atol=0.005)
        off = np.array(fit.calibration.matrix) - np.diag(np.diag(fit.calibration.matrix))
        assert np.abs(off).max() < 0.01


def test_further_poses_tell_the_misalignment_too_whatever_their_directions():
    rng = np.random.default_rng(4)
    P = np.array([[1.02, 0.006, -0.004], [0.006, 0.98, 0.008], [-0.004, 0.008, 1.01]])
    bias = np.array([0.3, -0.5, 0.2])
    slanting = rng.normal(size=(20, 3))
    slanting /= np.linalg.norm(slanting, axis=1, keepdims=True)
    poses = by_hand(rng, np.linalg.inv(P), bias, np.vstack([UP, slanting]))
    fit = calibrate_accelerometer(poses)
    np.testing.assert_allclose(fit.calibration.matrix, P, atol=3e-4)
    np.testing.assert_allclose(fit.calibration.bias, bias, atol=2e-3)
    assert fit.residual < 1e-3


def test_the_fit_to_gravity_is_that_of_a_general_solver():
    rng = np.random.default_rng(5)
    poses = by_hand(rng, np.diag([1.01, 0.98, 1.0]), np.array([0.1, 0.2, -0.3]), UP)

    def residuals(x):
        P = np.eye(3) + np.array([[x[3], x[6], x[7]], [x[6], x[4], x[8]], [x[7], x[8], x[5]]])
        sizes = np.linalg.norm((poses / 9.80665 - x[:3]) @ P, axis=1)
        return np.concatenate([(sizes - 1) / 0.001, x[:3] / 0.1, x[3:6] / 0.05, x[6:] / 0.01])

    x = least_squares(residuals, np.zeros(9), xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    fitted = fit_to_gravity(poses)
    np.testing.assert_allclose(fitted.bias, 9.80665 * x[:3], atol=1e-6)
    np.testing.assert_allclose(np.diag(fitted.matrix), 1 + x[3:6], atol=1e-7)
    assert fitted.matrix[1][2] == pytest.approx(x[8], abs=1e-7)


def test_sides():
    assert [side_up(up + np.array([0.1, 0.2, -0.3])) for up in UP] == list(SIDES)


@pytest.mark.parametrize(
    ('poses', 'message'),
    [
        (9.81 * UP[:4], r'none with \+z, -z up; got 4 still poses'),
        (np.zeros((0, 3)), r'none with \+x, -x, \+y, -y, \+z, -z up; got 0'),
        (UP, 'scales of .* does it measure in m/s²'),
        (9.81 * UP * [[1], [1], [1], [0.5], [1], [1]], 'bias of 2.45 m/s²'),
    ],
)
def test_poses_that_do_not_do(poses, message):
    with pytest.raises(AccelerometerError, match=message):
        calibrate_accelerometer(poses)


def test_directions_in_a_plane_do_not_do():
    with pytest.raises(AccelerometerError, match='do not tell bias from scale'):
        fit_to_directions(9.81 * UP[:4], UP[:4])


@pytest.mark.parametrize(
    'matrix', [np.diag([1, 1, -1]), np.zeros((3, 3)), np.full((3, 3), np.nan), np.eye(2)]
)
def test_a_calibration_that_cannot_be(matrix):
    with pytest.raises(AccelerometerError):
        AccelerometerCalibration((0.0, 0.0, 0.0), tuple(map(tuple, matrix.tolist())))
