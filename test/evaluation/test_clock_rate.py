import numpy as np
import pytest
from made_motion import Motion

from sesa2.evaluation.clock_rate import ClockStep, clock_step, velocities

RATE = 50.0


@pytest.mark.parametrize('rate', [-1e-3, 0.0, 1e-3])
def test_a_rate_is_told_beside_frames_that_wander(rate):
    """The estimate turns to and fro about z as slowly as headings do; its clock is told all the same."""
    motion = Motion(1, 60.0)
    t = np.arange(0.5, 59.5, 1.0 / RATE)
    truth = motion.at(t)
    estimate = motion.at(t - 0.004 - rate * (t - 30.0))
    angle = np.deg2rad(3.0) * np.sin(2.0 * np.pi * t / 45.0)[:, None]
    x, y = estimate[..., 0].copy(), estimate[..., 1].copy()
    estimate[..., 0], estimate[..., 1] = (
        np.cos(angle) * x - np.sin(angle) * y,
        np.sin(angle) * x + np.cos(angle) * y,
    )
    # The estimate is what the truth was before: the truth's clock is ahead.
    step = clock_step(t, 30.0, estimate, truth, velocities(t, truth))
    assert step.rate == pytest.approx(-rate, abs=1e-4)
    assert step.shift == pytest.approx(-0.004, abs=1e-3)
    assert step.rate_std < 1e-4


def test_its_deviation_is_what_it_scatters_by():
    motion, rng = Motion(4, 60.0), np.random.default_rng(1)
    t = np.arange(0.5, 59.5, 1.0 / RATE)
    truth = motion.at(t)
    v = velocities(t, truth)
    found = [clock_step(t, 30.0, truth + rng.normal(0.0, 0.01, truth.shape), truth, v) for _ in range(60)]
    stds = np.array([step.rate_std for step in found])
    assert np.std([step.rate for step in found]) == pytest.approx(np.sqrt(np.mean(stds**2)), rel=0.35)
    assert abs(np.mean([step.rate for step in found])) < 0.5 * stds.mean()


def test_too_little_tells_nothing():
    motion = Motion(1, 60.0)
    t = np.arange(0.5, 15.0, 1.0 / RATE)
    truth = motion.at(t)
    assert clock_step(t, 7.0, truth, truth, velocities(t, truth)) == ClockStep()
    assert clock_step(t, 7.0, truth + np.nan, truth, velocities(t, truth)) == ClockStep()


def test_velocities_of_uneven_samples():
    rng = np.random.default_rng(3)
    t = np.sort(rng.uniform(0.0, 10.0, 800))
    p = np.stack([np.sin(t), 2.0 * t, np.ones_like(t)], axis=1)[:, None]
    v = velocities(t, p)[50:-50, 0]
    np.testing.assert_allclose(v[:, 0], np.cos(t[50:-50]), atol=0.06)
    np.testing.assert_allclose(v[:, 1], 2.0, atol=1e-9)
