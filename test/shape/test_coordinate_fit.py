"""The fit on readings that magpylib simulates, against scipy's, and with another predictor than the package's."""

import numpy as np
import pytest
from paper_arm import EARTH, NOISE, REAL, SIMULATED, PaperArm, as_in_the_paper, errors, flower, lemniscate
from scipy.optimize import least_squares, minimize

from sesa2.shape.coordinate_fit import CoordinateFit
from sesa2.shape.kinematics import create_kinematics
from sesa2.shape.kinematics.coordinate_limits import CoordinateLimits
from sesa2.shape.reading_predictor import Prediction, ReadingPredictor

TABLE_1 = {
    'one segment': {'segments': 1},
    'two': {'segments': 2},
    'three': {},
    'twelve sensors': {'per_segment': 4},
    'eighteen sensors': {'per_segment': 6},
    'tilt of 10°': {'tilt': np.deg2rad(10.0)},
    'at 16 mm': {'radius': 0.016},
    'earth along x': {'earth': (EARTH, 0, 0)},
    'earth along y': {'earth': (0, EARTH, 0)},
    'earth along z': {'earth': (0, 0, EARTH)},
    'affine': {'segments': 1, 'kinematics': 'affine', 'bend_max': 2.6},
}


def path_of(arm, n):
    return flower(n) if arm.family == 'affine' else lemniscate(len(arm.lengths), n)


def errors_of(arm, estimated, true):
    if arm.family == 'affine':
        return errors(as_in_the_paper(estimated), as_in_the_paper(true))
    return errors(estimated, true)


@pytest.mark.parametrize('row', TABLE_1.values(), ids=TABLE_1)
def test_table_1_without_noise(row):
    arm = PaperArm(**row, magnet=SIMULATED)
    q = path_of(arm, 100)
    fitted = CoordinateFit(arm.predictor).fit(arm.simulate(q))
    assert fitted.converged.all()
    assert errors_of(arm, fitted.coordinates, q).max() < 0.002


@pytest.mark.parametrize(
    ('row', 'bend', 'elongation'),
    [
        ('one segment', 0.5, 0.7),
        ('three', 0.8, 1.1),
        ('tilt of 10°', 1.0, 1.8),
        ('earth along x', 1.0, 1.8),
        ('earth along z', 1.0, 1.8),
    ],
)
def test_the_real_magnet_with_noise(row, bend, elongation):
    arm = PaperArm(**TABLE_1[row], magnet=REAL)
    q = path_of(arm, 400)
    u = arm.simulate(q) + NOISE * np.random.default_rng(0).normal(size=(400, len(arm.predictor.noise)))
    fitted = CoordinateFit(arm.predictor).fit(u)
    e = errors(fitted.coordinates, q).reshape(-1, 3)
    assert e[:, :2].max() < bend
    assert e[:, 2].max() < elongation
    # What it says of its own error is right, too.
    sd = np.sqrt(np.diagonal(fitted.covariance(arm.limits.scales), axis1=-2, axis2=-1))
    assert 0.85 < np.std((fitted.coordinates - q) / sd) < 1.15


@pytest.mark.parametrize(
    ('noise', 'most'), [(NOISE, (1.2, 0.6, 0.2, 0.5)), (0.048e-6, (0.1, 0.05, 0.02, 0.04))]
)
def test_affine_curvature_with_noise(noise, most):
    arm = PaperArm(1, kinematics='affine', noise=noise, bend_max=2.6)
    q = flower(400)
    u = arm.simulate(q) + noise * np.random.default_rng(0).normal(size=(400, 9))
    fitted = CoordinateFit(arm.predictor).fit(u)
    assert (errors_of(arm, fitted.coordinates, q) < most).all()


@pytest.mark.parametrize('segments', [1, 3])
def test_cold_starts_from_straight(segments):
    arm = PaperArm(segments, bend_max=2.3)
    rng = np.random.default_rng(1)
    q = np.empty((500, segments, 3))
    q[..., :2] = rng.uniform(-np.pi / 2, np.pi / 2, (500, segments, 2))
    q[..., 2] = rng.uniform(0.11, 0.1155, (500, segments))
    q = q.reshape(500, -1)
    fitted = CoordinateFit(arm.predictor).fit(arm.simulate(q))
    assert fitted.converged.all()
    assert (np.abs(fitted.coordinates - q) < 1e-3 * arm.limits.scales).all()


def test_one_instant_warm_or_cold_alike():
    arm = PaperArm(3)
    q = lemniscate(3, 50)
    u = arm.predictor.predict(q).readings + NOISE * np.random.default_rng(3).normal(size=(50, 9))
    fit = CoordinateFit(arm.predictor)
    cold = fit.fit(u)
    last = q[0]
    for k in range(50):
        warm = fit.fit(u[k], last)
        last = warm.coordinates
        assert warm.iterations <= 4
        sd = np.sqrt(np.diag(warm.covariance(arm.limits.scales)))
        assert (np.abs(last - cold.coordinates[k]) < 1e-3 * sd).all()
    shaped = fit.fit(u.reshape(5, 10, 9), cold.coordinates.reshape(5, 10, 9))
    assert shaped.converged.shape == (5, 10)
    np.testing.assert_allclose(shaped.coordinates.reshape(50, 9), cold.coordinates, atol=1e-5)


def test_against_scipy():
    arm = PaperArm(2)
    p, scales, rest = arm.predictor, arm.limits.scales, arm.limits.kinematics.rest
    rng = np.random.default_rng(2)
    for q in lemniscate(2, 7):
        u = p.predict(q).readings + 3 * NOISE * rng.normal(size=6)

        def residuals(x, u=u):
            return np.concatenate([(u - p.predict(x * scales).readings) / p.noise, x - rest / scales])

        theirs = least_squares(residuals, rest / scales, x_scale='jac', xtol=1e-14, ftol=1e-14, gtol=1e-14).x
        np.testing.assert_allclose(CoordinateFit(p).fit(u).coordinates / scales, theirs, rtol=0.0, atol=2e-6)


def test_readings_that_are_not_there():
    arm = PaperArm(3, 4)
    q = lemniscate(3, 20)
    u = arm.simulate(q)
    u[:, 3], u[5:, 7], u[9, 11] = np.nan, np.inf, np.nan
    fitted = CoordinateFit(arm.predictor).fit(u)
    assert fitted.converged.all()
    assert errors(fitted.coordinates, q).max() < 0.01
    assert (fitted.residuals[:, 3] == 0.0).all()
    # What no sensor tells is the prior's.
    nothing = CoordinateFit(arm.predictor).fit(np.full(12, np.nan))
    np.testing.assert_allclose(nothing.coordinates, arm.limits.kinematics.rest)
    np.testing.assert_allclose(nothing.information, np.eye(9))


@pytest.mark.parametrize('true', [[1.2, 0.9, 0.113], [1.2, 0.9, 0.13], [0.1, -0.2, 0.09], [0.0, -2.0, 0.08]])
def test_the_best_within_the_limits(true):
    arm, wide = PaperArm(1, bend_max=1.0, noise=2e-5), PaperArm(1, bend_max=3.0)
    p, scales, rest = arm.predictor, arm.limits.scales, arm.limits.kinematics.rest
    u = wide.predictor.predict(np.array(true)).readings
    fitted = CoordinateFit(p).fit(u)
    assert fitted.converged
    np.testing.assert_allclose(arm.limits.clip(fitted.coordinates), fitted.coordinates, rtol=1e-12)

    def cost(x):
        off = x - rest / scales
        return np.sum(((u - p.predict(x * scales).readings) / p.noise) ** 2) + off @ off

    theirs = minimize(
        cost,
        arm.limits.clip(np.array(true)) / scales,
        method='SLSQP',
        bounds=[(None, None), (None, None), tuple(rest[2] * np.array([0.95, 1.10]) / scales[2])],
        constraints={'type': 'ineq', 'fun': lambda x: 1.0 - x[0] ** 2 - x[1] ** 2},
        options={'ftol': 1e-12, 'maxiter': 1000},
    )
    assert cost(fitted.coordinates / scales) <= theirs.fun * (1.0 + 1e-4) + 1e-6


def test_a_fit_that_does_not_converge_gives_nothing():
    arm = PaperArm(1)
    u = arm.predictor.predict(np.array([[1.2, 0.9, 0.113], [0.0, 0.0, 0.11]])).readings
    fitted = CoordinateFit(arm.predictor, most_iterations=2).fit(u)
    assert fitted.converged.tolist() == [False, True]
    assert np.isnan(fitted.coordinates[0]).all()
    assert np.isnan(fitted.covariance(arm.limits.scales)[0]).all()
    assert np.isfinite(fitted.covariance(arm.limits.scales)[1]).all()


class Learnt(ReadingPredictor):
    """A predictor that knows no physics: a fixed quadratic map of one segment's coordinates."""

    def __init__(self):
        self.limits = CoordinateLimits(create_kinematics('pcc', [0.1]), 1.5, (0.8, 1.2))
        self.names, self.sensor_of = ('a', 'b', 'c', 'd'), np.arange(4)
        self.noise, self.largest = np.full(4, 0.01), 10.0
        rng = np.random.default_rng(0)
        self._A, self._B = rng.normal(size=(4, 3)), 0.1 * rng.normal(size=(4, 3, 3))

    def predict(self, coordinates, base=None):
        x = coordinates / self.limits.scales
        quadratic = x[..., None, None, :] @ self._B @ x[..., None, :, None]
        J = self._A + (x[..., None, None, :] @ (self._B + np.swapaxes(self._B, 1, 2)))[..., 0, :]
        return Prediction(x @ self._A.T + quadratic[..., 0, 0], J / self.limits.scales)

    def readings_of(self, measured):
        return np.asarray(measured)[..., 2]


def test_another_predictor():
    p = Learnt()
    q = p.limits.draw(50, np.random.default_rng(1))
    fitted = CoordinateFit(p).fit(p.predict(q).readings)
    assert fitted.converged.all()
    assert (np.abs(fitted.coordinates - q) < 0.02 * p.limits.scales).all()
