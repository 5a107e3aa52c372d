"""The prior of shapes against scipy, finite differences and closed forms."""

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.spatial.transform import Rotation

from sesa2.alignment.shape_prior import BENDING, ShapePrior, likelier_twist
from sesa2.shape.arm import Arm
from sesa2.shape.layout import Layout
from sesa2.shape.rotations import IDENTITY, normalize

LAYOUTS = [
    Layout(Arm(0.66), (0.08, 0.2, 0.64)),
    Layout(Arm(0.5), (0.5,)),
    Layout(Arm(1.0), tuple(np.arange(1, 9) / 8)),
]


@pytest.fixture
def rng():
    return np.random.default_rng(9)


@pytest.mark.parametrize('layout', LAYOUTS)
def test_first_guess_goes_through_the_orientations(rng, layout):
    n = len(layout.imu_positions)
    base = normalize(rng.normal(size=(5, 4)))
    links = normalize(rng.normal(size=(5, n, 4)))
    prior = ShapePrior(layout)
    curvature = prior.first_guess(links, base)
    linear = prior.linearise(curvature, links, base)
    np.testing.assert_allclose(np.abs(np.sum(linear.links * links, axis=-1)), 1.0, atol=1e-12)
    np.testing.assert_allclose(linear.y, np.einsum('nrca,nca->nr', linear.J, curvature), atol=1e-7)


@pytest.mark.parametrize('layout', LAYOUTS)
def test_derivatives_are_finite_differences(rng, layout):
    n = len(layout.imu_positions)
    base = normalize(rng.normal(size=(1, 4)))
    prior = ShapePrior(layout)
    smooth = Rotation.from_rotvec(0.3 * rng.normal(size=(n, 3))).as_quat()[None]
    curvature = prior.first_guess(smooth, np.tile(IDENTITY, (1, 1)))
    step = 0.05 * rng.normal(size=curvature.shape)

    def shape(c):
        links = prior.linearise(c, smooth, base).links[0]
        return Rotation.from_quat(links)

    J = prior.linearise(curvature, smooth, base).J[0]
    got = np.einsum('rca,ca->r', J, step[0])
    h = 1e-4
    expected = (shape(curvature + h * step) * shape(curvature - h * step).inv()).as_rotvec() / (2 * h)
    np.testing.assert_allclose(got.reshape(n, 3), expected, atol=5e-3 * np.abs(expected).max())


def test_variance_of_the_bend_is_the_double_integral_of_a_random_walks():
    layout = LAYOUTS[0]
    prior = ShapePrior(layout)
    straight = np.tile(IDENTITY, (1, 3, 1))
    base = np.tile(IDENTITY, (1, 1))
    J = prior.linearise(prior.first_guess(straight, base), straight, base).J
    bending = prior.marginalise(J, np.ones((1, 3), bool), 0.03).bending[0]
    at = layout.stations[1:] / layout.arm.length
    for i, j in [(0, 0), (0, 2), (1, 2), (2, 2)]:
        expected, _ = dblquad(lambda a, b: 3.0 * min(1 - a, 1 - b), 0.0, at[i], 0.0, at[j], epsabs=1e-6)
        np.testing.assert_allclose(bending[3 * i, 3 * j], BENDING**2 * expected, rtol=3e-3)
        np.testing.assert_allclose(bending[3 * i + 1, 3 * j + 1], BENDING**2 * expected, rtol=3e-3)
    np.testing.assert_allclose(bending[2::3], 0.0, atol=1e-12)


def test_an_imu_that_has_not_measured_tells_nothing(rng):
    """Its rows are empty, and the others are as if it were not on the arm."""
    layout, without = Layout(Arm(0.6), (0.2, 0.4, 0.6)), Layout(Arm(0.6), (0.2, 0.6))
    straight = np.tile(IDENTITY, (1, 3, 1))
    base = np.tile(IDENTITY, (1, 1))
    marginals = []
    for a, q, measured in [
        (layout, straight, [[True, False, True]]),
        (without, straight[:, :2], [[True, True]]),
    ]:
        prior = ShapePrior(a)
        J = prior.linearise(prior.first_guess(q, base), q, base).J
        marginals.append(prior.marginalise(J, np.array(measured), 0.1).precision[0])
    there = np.r_[0:3, 6:9]
    np.testing.assert_array_equal(marginals[0][3:6], 0.0)
    np.testing.assert_array_equal(marginals[0][:, 3:6], 0.0)
    np.testing.assert_allclose(marginals[0][np.ix_(there, there)], marginals[1], rtol=1e-2)


def test_twist_of_the_prior_is_learnt_from_what_it_would_give(rng):
    layout = LAYOUTS[2]
    prior = ShapePrior(layout)
    n, n_imu = 400, 8
    straight, base = np.tile(IDENTITY, (n, n_imu, 1)), np.tile(IDENTITY, (n, 1))
    J = prior.linearise(prior.first_guess(straight, base), straight, base).J
    measured = np.ones((n, n_imu), bool)
    S = np.linalg.inv(prior.marginalise(J[:1], measured[:1], 0.4).precision[0])
    y = rng.normal(size=(n, 3 * n_imu)) @ np.linalg.cholesky(S).T
    twist = 0.03
    for _ in range(20):
        marginal = prior.marginalise(J, measured, twist)
        twist = likelier_twist(twist, marginal, np.einsum('nrs,ns->nr', marginal.precision, y))
    assert abs(twist - 0.4) < 0.05
