"""Moments of an unknown magnet, from readings that magpylib simulates."""

import numpy as np
import pytest
from paper_arm import EARTH, NOISE, REAL, SIMULATED, PaperArm, errors, lemniscate

from sesa2.sensing.magnetometry.axial_field import AxialField
from sesa2.sensing.magnetometry.build_parameters import BuildErrors, BuildParameters
from sesa2.sensing.magnetometry.moment_fit import fit_moments, ring_of_moments
from sesa2.sensing.magnetometry.ring_magnet import RingMagnet
from sesa2.shape.arm import GeometryError
from sesa2.shape.coordinate_fit import CoordinateFit


@pytest.mark.parametrize('magnet', [REAL, SIMULATED])
def test_twenty_shapes_do(magnet):
    """The described magnet is another; what is learnt predicts, and finds shapes."""
    arm, described = PaperArm(3, magnet=magnet, earth=(0, EARTH, 0)), PaperArm(3, earth=(0, EARTH, 0))
    q = arm.limits.draw(20, np.random.default_rng(0))
    order = 3 if magnet is REAL else 7
    fitted = fit_moments(described.predictor, q, arm.simulate(q), order=order)
    np.testing.assert_allclose(fitted.moments[0], magnet.moments(1)[0], rtol=1e-4)
    learnt = described.predictor.with_field(
        AxialField(np.tile(fitted.moments, (3, 1)), np.full(3, magnet.sphere))
    )
    motion = lemniscate(3, 100)
    u = arm.simulate(motion)
    assert np.sqrt(np.mean((learnt.predict(motion).readings - u) ** 2)) < 0.05e-6
    assert errors(CoordinateFit(learnt).fit(u).coordinates, motion).max() < 0.05


def test_with_noise_it_knows_how_well():
    arm, rng = PaperArm(3), np.random.default_rng(1)
    q = arm.limits.draw(100, rng)
    u = arm.simulate(q) + NOISE * rng.normal(size=(100, 9))
    u[::7, 2] = np.nan
    fitted = fit_moments(arm.predictor, q, u)
    assert (np.abs(fitted.moments - REAL.moments(3)) < 4.0 * fitted.deviations).all()
    assert fitted.deviations[0] < 1e-3 * fitted.moments[0]
    assert 0.9 < fitted.residual < 1.1
    wrong = fit_moments(arm.predictor, q + 0.05 * rng.normal(size=q.shape), u)
    assert wrong.residual > 3.0


def test_too_little():
    arm = PaperArm(1)
    q = arm.limits.kinematics.rest[None]
    with pytest.raises(GeometryError, match='0 readings, expected at least 2'):
        fit_moments(arm.predictor, q, np.full((1, 3), np.nan))
    with pytest.raises(GeometryError, match=r'readings of shape \(1, 2\), expected \(1, 3\)'):
        fit_moments(arm.predictor, q, np.zeros((1, 2)))


@pytest.mark.parametrize('outer', [0.0075, 0.012, 0.03])
def test_the_ring_of_two_moments(outer):
    true = RingMagnet(0.006, outer, 0.006, -1.2)
    found = ring_of_moments(REAL, true.moments(3))
    assert found.outer_diameter == pytest.approx(outer, rel=1e-9)
    assert found.remanence == pytest.approx(-1.2, rel=1e-9)
    with pytest.raises(GeometryError, match='which no ring has'):
        ring_of_moments(REAL, np.array([1e-7, 1e-11]))


def test_what_else_is_off_is_told_from_the_moments():
    """Sixty builds: the moments scatter as they are said to, and less than if the build were believed."""
    arm, rng = PaperArm(1), np.random.default_rng(2)
    q = arm.limits.draw(30, rng)
    build = BuildParameters(arm.predictor, BuildErrors(earth=0.0))
    derivatives = build.look(np.zeros(len(build.names)), q, np.tile([0.0, 0.0, 0.0, 1.0], (30, 1)))[1]
    off, plain = [], []
    for _ in range(60):
        real = build.changed(build.deviations * rng.normal(size=len(build.names)))
        u = real.predict(q).readings + NOISE * rng.normal(size=(30, 3))
        fitted = fit_moments(arm.predictor, q, u, 3, disturbed=derivatives * build.deviations)
        off.append((fitted.moments - REAL.moments(3)) / fitted.deviations)
        plain.append((fit_moments(arm.predictor, q, u, 3).moments - REAL.moments(3)) / fitted.deviations)
    spread, believed = np.sqrt(np.mean(np.square(off), axis=0)), np.sqrt(np.mean(np.square(plain), axis=0))
    assert ((spread > 0.75) & (spread < 1.3)).all(), spread
    assert believed[1] > 1.2 * spread[1]
