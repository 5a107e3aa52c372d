"""A posteriori estimates against closed forms of linear problems and scipy."""

import numpy as np
import pytest
from scipy.optimize import minimize

from sesa2.alignment.map_estimate import map_estimate
from sesa2.errors import Sesa2Error

EXPECTED = np.array([0.3, 0.05, 0.2])


def linear(rng, n, std=0.004):
    A = rng.normal(size=(n, 3, 3))
    true = np.array([0.2, -0.04, 0.1])
    y = A @ true + std * rng.normal(size=(n, 3))
    return A, true, y


def test_of_a_linear_problem_it_is_the_ridge_solution_with_its_covariance():
    A, true, y = linear(np.random.default_rng(1), 400)
    found = map_estimate(lambda x: A @ x - y, EXPECTED, 0.004)
    flat = A.reshape(-1, 3)
    normal = flat.T @ flat / 0.004**2 + np.diag(EXPECTED**-2.0)
    assert found.told.all()
    np.testing.assert_allclose(found.values, true, atol=4.0 * np.sqrt(np.diag(np.linalg.inv(normal))).max())
    np.testing.assert_allclose(found.std, np.sqrt(np.diag(np.linalg.inv(normal))), rtol=0.15)
    assert found.noise == pytest.approx(0.004, rel=0.15)
    assert not found.wrong.any()


def test_of_a_curved_problem_it_is_what_scipy_finds():
    rng = np.random.default_rng(2)
    t = rng.uniform(0.2, 2.0, 60)

    def curve(x):
        return np.stack([np.sin(t * (1.0 + x[0])), np.cos(t * (1.0 + x[0])) + x[1], x[2] * t**2], axis=-1)

    y = curve(np.array([0.25, 0.03, -0.15])) + 0.01 * rng.normal(size=(60, 3))
    found = map_estimate(lambda x: curve(x) - y, EXPECTED, 0.01)

    def cost(x):
        off = np.square(curve(x) - y).sum(axis=1)
        return found.weights @ off / found.noise**2 + np.square(x / EXPECTED).sum()

    best = minimize(cost, np.zeros(3), method='BFGS', options={'gtol': 1e-9}).x
    np.testing.assert_allclose(found.values, best, atol=0.02 * found.std.min())


def test_the_uncertainty_holds():
    """Over many problems errors are as large as is said."""
    rng = np.random.default_rng(3)
    off = []
    for _ in range(60):
        A, true, y = linear(rng, 10)
        found = map_estimate(lambda x, A=A, y=y: A @ x - y, EXPECTED, 0.01)
        off.append((found.values - true) / found.std)
    assert 0.75 < np.sqrt(np.mean(np.square(off))) < 1.3


def test_what_is_not_told_is_left_at_zero_and_said():
    A, _, y = linear(np.random.default_rng(4), 50)
    A[..., 1] = 0.0
    found = map_estimate(lambda x: A @ x - y, EXPECTED, 0.004)
    assert found.told.tolist() == [True, False, True]
    assert found.values[1] == 0.0
    assert found.std[1] == pytest.approx(EXPECTED[1])


def test_one_of_two_that_look_alike_is_told_and_the_other_not():
    """Their sum is known; the wider one takes it, and its uncertainty stays that of the whole."""
    A, _, _ = linear(np.random.default_rng(5), 50)
    A[..., 1] = A[..., 0]
    y = A @ [0.2, 0.0, 0.1]
    found = map_estimate(lambda x: A @ x - y, EXPECTED, 1e-4)
    assert found.told.tolist() == [True, False, True]
    assert found.values[0] == pytest.approx(0.2, abs=1e-4)
    assert found.std[0] == pytest.approx(0.05, rel=0.05)


def test_a_wrong_point_does_not_pull_the_others():
    A, true, y = linear(np.random.default_rng(6), 12)
    y[3] += [0.0, 0.3, 0.0]
    found = map_estimate(lambda x: A @ x - y, EXPECTED, 0.004)
    assert np.flatnonzero(found.wrong).tolist() == [3]
    np.testing.assert_allclose(found.values, true, atol=0.006)


def test_points_that_follow_one_another_closely_tell_less():
    A, _, y = linear(np.random.default_rng(7), 100)
    each, shared = (map_estimate(lambda x: A @ x - y, EXPECTED, 0.004, share) for share in (1.0, 0.04))
    np.testing.assert_allclose(shared.std / each.std, 5.0, rtol=0.2)


def test_values_that_cannot_be_are_stepped_around():
    A, true, y = linear(np.random.default_rng(8), 40)

    def residuals(x):
        if np.abs(x).max() > 0.21:
            raise Sesa2Error('no arm is so')
        return np.sinh(3.0 * (A @ x)) - np.sinh(3.0 * y)

    np.testing.assert_allclose(map_estimate(residuals, EXPECTED, 0.02).values, true, atol=0.01)
