"""The filter on the paper's motion, simulated by magpylib, with every fault that the paper shows and more."""

import numpy as np
import pytest
from paper_arm import NOISE, PaperArm, errors, lemniscate

from sesa2.shape.coordinate_filter import CoordinateFilter
from sesa2.shape.coordinate_fit import CoordinateFit
from sesa2.shape.reading_faults import REPEATS, ReadingFault

RATE = 20.0
FROM = 50
TWELVE, EIGHTEEN = PaperArm(3, 4), PaperArm(3, 6)


def noisy(arm, seed=0, frames=200):
    q = lemniscate(3, 200)[:frames]
    u = arm.simulate(q)
    return q, u + NOISE * np.random.default_rng(seed).normal(size=u.shape)


def filtered(arm, u, **options):
    follow = CoordinateFilter(arm.predictor, **options)
    steps = [follow.step(k / RATE, each) for k, each in enumerate(u)]
    return steps, np.array([s.coordinates for s in steps]), np.array([s.faults for s in steps])


FAULTS = {
    'jumps': (lambda u, rng: u + 30e-6, ReadingFault.JUMPING, 0),
    'reads next to zero': (lambda u, rng: 0.1 * NOISE * rng.normal(size=u.shape), ReadingFault.JUMPING, 0),
    'zero': (lambda u, rng: 0.0 * u, ReadingFault.SILENT, 0),
    'silent': (lambda u, rng: np.nan * u, ReadingFault.SILENT, 0),
    'saturated': (lambda u, rng: np.full(u.shape, TWELVE.predictor.largest), ReadingFault.SATURATED, 0),
    'stuck at a value': (lambda u, rng: np.full(u.shape, 3.1e-4), ReadingFault.JUMPING, 0),
    'repeating': (lambda u, rng: np.full(u.shape, u[0]), ReadingFault.REPEATING, REPEATS - 1),
}


@pytest.mark.parametrize('fault', FAULTS.values(), ids=FAULTS)
@pytest.mark.parametrize('sensor', [2, 9])
def test_faults_of_one_of_twelve_sensors(fault, sensor):
    change, kind, after = fault
    q, u = noisy(TWELVE)
    u[FROM:, sensor] = change(u[FROM:, sensor], np.random.default_rng(1))
    steps, x, faults = filtered(TWELVE, u)
    found = faults[FROM + after :, sensor]
    assert np.mean(found != ReadingFault.NONE) >= 0.99
    assert found[0] == kind
    faults[:, sensor] = ReadingFault.NONE
    faults[FROM : FROM + after] = (
        ReadingFault.NONE
    )  # others are accused while a dead sensor is not known to be dead
    assert (faults == ReadingFault.NONE).all()
    assert errors(x, q).max() < 1.2
    assert not any(s.doubtful for s in steps)


def test_no_false_alarm():
    """In 2000 instants; bench/magnetic.py counts in 10 000."""
    q, clean = lemniscate(3, 200), TWELVE.simulate(lemniscate(3, 200))
    u = np.tile(clean, (10, 1)) + NOISE * np.random.default_rng(7).normal(size=(2000, 12))
    steps, x, faults = filtered(TWELVE, u)
    assert (faults == ReadingFault.NONE).all()
    assert not any(s.doubtful for s in steps)
    assert errors(x, np.tile(q, (10, 1))).max() < 1.0
    # What it says of its own error is right.
    sd = np.array([np.sqrt(np.diag(s.covariance)) for s in steps])
    assert 0.85 < np.std((x - np.tile(q, (10, 1))) / sd) < 1.15


@pytest.mark.parametrize('motion', ['constant_velocity', 'random_walk'])
def test_better_than_each_instant_alone(motion):
    arm = PaperArm(3)
    q, u = noisy(arm)
    alone = errors(CoordinateFit(arm.predictor).fit(u).coordinates, q)
    _, x, _ = filtered(arm, u, motion=motion, agility=5.0 if motion == 'constant_velocity' else 1.5)
    assert (errors(x, q) < alone * (0.98 if motion == 'constant_velocity' else 1.0)).all()


def test_three_sensors_removed_in_flight():
    """Fig. 4b: the fourth of each segment."""
    q, u = noisy(TWELVE)
    u[100:, [3, 7, 11]] = np.nan
    _, x, faults = filtered(TWELVE, u)
    assert (faults[100:, [3, 7, 11]] == ReadingFault.SILENT).all()
    assert np.count_nonzero(faults) == 300
    assert errors(x, q).max() < 1.1


def test_single_glitches_and_a_sensor_that_recovers():
    q, u = noisy(TWELVE)
    u[25::25, 2] += 30e-6
    u[50:70, 6] -= 50e-6
    _, x, faults = filtered(TWELVE, u)
    assert (faults[25::25, 2] == ReadingFault.JUMPING).all()
    assert (faults[50:70, 6] == ReadingFault.JUMPING).all()
    assert (faults[95:, 6] == ReadingFault.NONE).all()
    assert np.count_nonzero(faults) < 60
    assert errors(x, q).max() < 1.0


def test_with_nine_sensors_a_fault_is_found_and_what_is_unknown_then_said():
    arm = PaperArm(3)
    q, u = noisy(arm)
    u[FROM:, 2] += 30e-6
    steps, x, faults = filtered(arm, u)
    assert (faults[FROM:, 2] != ReadingFault.NONE).all()
    # Eight readings for nine coordinates: that direction drifts, and the covariance says so.
    sd = np.array([np.sqrt(np.diag(s.covariance)) for s in steps])
    assert np.abs(x - q)[100:, 0].max() > 0.1
    assert sd[100:, :2].max() > 20.0 * sd[40, :2].max()
    assert np.mean(np.abs(x - q)[FROM:] < 3.0 * sd[FROM:]) > 0.95


def test_an_arm_that_jumps_is_no_fault():
    q, u = noisy(TWELVE)
    there, u = np.concatenate([q[:50], q[125:]]), np.concatenate([u[:50], u[125:]])
    _, x, faults = filtered(TWELVE, u)
    assert (faults == ReadingFault.NONE).all()
    assert np.abs(x[50] - there[50])[:2].max() < 0.03


def test_wrong_from_the_first_instant():
    q, u = noisy(EIGHTEEN, frames=50)
    u[:, 4] += 30e-6
    steps, x, faults = filtered(EIGHTEEN, u)
    assert (faults[:, 4] == ReadingFault.JUMPING).all()
    assert np.count_nonzero(faults) == 50
    assert np.abs(x - q)[:, 3:5].max() < 0.03
    # Twelve cannot tell which of the ring it is: none of them is believed, and it is said.
    q, u = noisy(TWELVE, frames=5)
    u[:, 1] += 30e-6
    steps, _, faults = filtered(TWELVE, u)
    assert steps[0].doubtful
    assert (faults[0, :4] == ReadingFault.DOUBTED).all()


def test_a_pause_and_a_clock_that_went_back():
    arm = PaperArm(1)
    q = lemniscate(1, 400)
    u = arm.simulate(q)
    follow = CoordinateFilter(arm.predictor)
    for k, time in ((0, 0.0), (100, 50.0), (200, 3.0)):
        step = follow.step(time, u[k])
        np.testing.assert_allclose(step.coordinates, q[k], atol=2e-3)
    assert np.isnan(follow.step(60.0, np.full(3, np.nan)).coordinates).all()
    np.testing.assert_allclose(follow.step(60.1, u[300]).coordinates, q[300], atol=2e-3)
