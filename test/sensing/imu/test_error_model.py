"""The simulated errors have the sizes, the correlations and the places that they say."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from sesa2.sensing.imu.error_model import (
    SOURCES,
    Bno055Errors,
    ErrorModelError,
    gauss_markov,
    measure,
    orientations_at,
)
from sesa2.sensing.imu.mounting import Mounting
from sesa2.shape.rotations import IDENTITY, conjugate, from_rotation_vector, multiply, to_rotation_vector

RATE = 1.7  # rad/s of the turning arm


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def random_pose(rng, n):
    return Rotation.random(n, random_state=np.random.RandomState(rng.integers(2**31))).as_quat()


def still(rng, n_imu, seconds):
    times = np.array([0.0, seconds])
    return times, np.broadcast_to(random_pose(rng, n_imu), (2, n_imu, 4))


def turning(seconds, n_imu=3):
    times = np.linspace(0.0, seconds, 2001)
    q = from_rotation_vector(RATE * times[:, None] * [0.0, 1.0, 0.0])
    return times, np.repeat(q[:, None], n_imu, axis=1)


def angle(p, q):
    return np.linalg.norm(to_rotation_vector(multiply(conjugate(p), q)), axis=-1)


def world_error(measured, true):
    return to_rotation_vector(multiply(measured, conjugate(true)))


def test_a_perfect_sensor_shows_the_truth_in_its_nominal_mounting(rng):
    times, q = turning(2.0)
    nominal, headings = random_pose(rng, 3), rng.normal(size=3)
    m = measure(times, q, np.linspace(0.1, 1.9, 50), Bno055Errors().only(), rng, nominal, headings)
    links = Mounting(nominal, headings).link_orientations(m.orientations)
    assert angle(links, orientations_at(times, q, m.stamps)).max() < 1e-7
    assert not m.mountings.any()
    assert not m.headings.any()
    assert not m.tilts.any()


def test_the_injected_parameters_undo_mounting_and_heading(rng):
    times, q = still(rng, 8, 300.0)
    nominal, headings = random_pose(rng, 8), rng.normal(size=8)
    errors = Bno055Errors(mounting=0.2, heading=0.5).only('mounting', 'heading')
    m = measure(times, q, np.arange(0.0, 299.0), errors, rng, nominal, headings)
    true_mountings = multiply(from_rotation_vector(m.mountings), nominal)
    for row in (0, -1):
        undo = Mounting(true_mountings, headings + m.headings[row])
        assert angle(undo.link_orientations(m.orientations[row]), q[0]).max() < 1e-7


def test_the_constants_have_their_spread(rng):
    times, q = still(rng, 4000, 1.0)
    m = measure(times, q, np.array([0.0]), Bno055Errors(read_interval=0.0), rng)
    assert np.rad2deg(m.mountings.std(axis=0)) == pytest.approx(1.0, rel=0.05)
    # constant and wandering part together at one instant
    assert np.rad2deg(m.headings.std()) == pytest.approx(np.hypot(2.0, 2.0), rel=0.05)
    assert np.rad2deg(m.tilts.std()) == pytest.approx(0.8, rel=0.05)


def test_slow_errors_forget_after_their_time(rng):
    errors = Bno055Errors()
    times, q = still(rng, 400, 400.0)
    m = measure(times, q, np.arange(0.0, 399.0, 1.0), errors, rng)
    wander = m.headings - m.headings.mean(axis=0)
    drift = np.rad2deg((wander[1:] - wander[:-1]).std())
    assert drift == pytest.approx(2.0 * np.sqrt(2.0 * (1.0 - np.exp(-1.0 / 60.0))), rel=0.05)
    lag = round(errors.tilt_time)
    correlation = (m.tilts[lag:] * m.tilts[:-lag]).mean() / (m.tilts**2).mean()
    assert correlation == pytest.approx(np.exp(-1.0), abs=0.02)


def test_tilt_and_noise_are_in_world_axes(rng):
    times, q = still(rng, 50, 500.0)
    sweeps = np.arange(0.0, 499.0, 0.5)
    tilted = measure(times, q, sweeps, Bno055Errors().only('tilt'), rng)
    error = world_error(tilted.orientations, q[0])
    np.testing.assert_allclose(error[..., :2], tilted.tilts, atol=1e-12)
    assert np.abs(error[..., 2]).max() < 1e-12
    noisy = measure(times, q, sweeps, Bno055Errors().only('noise'), rng)
    error = np.rad2deg(world_error(noisy.orientations, q[0]))
    np.testing.assert_allclose(error.std(axis=(0, 1)), 0.2, rtol=0.03)
    neighbours = (error[1:] * error[:-1]).mean() / (error**2).mean()
    assert abs(neighbours) < 0.02


def test_latency_and_the_order_of_reading(rng):
    times, q = turning(3.0)
    errors = Bno055Errors(latency=0.05, read_interval=0.01).only('latency')
    m = measure(times, q, np.array([1.0, 2.0]), errors, rng)
    np.testing.assert_allclose(m.stamps, [[1.0, 1.01, 1.02], [2.0, 2.01, 2.02]])
    turned = 2.0 * np.arctan2(m.orientations[..., 1], m.orientations[..., 3])
    np.testing.assert_allclose(np.unwrap(turned, axis=0), RATE * (m.stamps - 0.05), atol=1e-7)


def test_rounding_moves_by_less_than_a_step(rng):
    times, q = still(rng, 1000, 1.0)
    m = measure(times, q, np.array([0.0]), Bno055Errors().only('quantisation'), rng)
    off = angle(m.orientations[0], q[0])
    # half a step in each of four components, and an angle is twice the arc on the sphere
    assert 0.0 < off.max() <= 2.0 * 2.0**-14
    np.testing.assert_allclose(np.linalg.norm(m.orientations, axis=-1), 1.0, rtol=1e-14)


@given(st.sampled_from(sorted(SOURCES)), st.integers(0, 2**31))
@settings(max_examples=30, deadline=None)
def test_turning_a_source_off_leaves_the_others_draws(source, seed):
    times, q = np.array([0.0, 10.0]), np.broadcast_to(IDENTITY, (2, 3, 4))
    sweeps = np.arange(0.0, 9.0, 1.0)
    kept = [name for name in SOURCES if name != source]
    every = measure(times, q, sweeps, Bno055Errors(), np.random.default_rng(seed))
    some = measure(times, q, sweeps, Bno055Errors().only(*kept), np.random.default_rng(seed))
    for name, a, b in (
        ('mounting', every.mountings, some.mountings),
        ('heading', every.headings, some.headings),
        ('tilt', every.tilts, some.tilts),
    ):
        if name == source:
            assert not b.any()
        else:
            np.testing.assert_array_equal(a, b)


def test_the_same_seed_gives_the_same_samples(rng):
    times, q = still(rng, 3, 5.0)
    one, two, other = (
        measure(times, q, np.arange(0.0, 4.0), Bno055Errors(), np.random.default_rng(seed))
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one.orientations, two.orientations)
    assert angle(one.orientations, other.orientations).min() > 0.0


def test_gauss_markov_is_stationary_on_uneven_times(rng):
    times = np.cumsum(rng.exponential(1.0, 60))
    x = gauss_markov(times, 3.0, (20000,), rng)
    np.testing.assert_allclose(x.std(axis=1), 1.0, rtol=0.03)
    covariance = (x[10] * x[20]).mean()
    assert covariance == pytest.approx(np.exp(-(times[20] - times[10]) / 3.0), abs=0.03)


def test_orientations_at_is_scipys_slerp(rng):
    times = np.sort(rng.uniform(0.0, 10.0, 12))
    q = random_pose(rng, 24).reshape(12, 2, 4)
    at = rng.uniform(times[0], times[-1], (7, 2))
    got = orientations_at(times, q, at)
    for body in range(2):
        expected = Slerp(times, Rotation.from_quat(q[:, body]))(at[:, body]).as_quat()
        assert angle(got[:, body], expected).max() < 1e-7
    outside = orientations_at(times, q, np.array([times[0] - 1.0, times[-1] + 1.0]))
    assert angle(outside, np.stack([q[0, 0], q[-1, 1]])).max() < 1e-7


@pytest.mark.parametrize(
    'wrong', [{'white': -1.0}, {'latency': np.nan}, {'tilt_time': 0.0}, {'heading': np.inf}]
)
def test_impossible_errors_are_refused(wrong):
    with pytest.raises(ErrorModelError, match=next(iter(wrong))):
        Bno055Errors(**wrong)


def test_unknown_sources_and_sweeps_beyond_the_motion_are_refused(rng):
    with pytest.raises(ErrorModelError, match=r"'headnig' is not known, expected one of noise, "):
        Bno055Errors().only('headnig')
    times, q = still(rng, 3, 5.0)
    with pytest.raises(ErrorModelError, match=r'lasts from 0\.000 to 5\.000 s'):
        measure(times, q, np.array([4.0, 6.0]), Bno055Errors(), rng)
    with pytest.raises(ErrorModelError, match='no sweep'):
        measure(times, q, np.array([]), Bno055Errors(), rng)
    with pytest.raises(ErrorModelError, match='expected'):
        measure(times, q[:, 0], np.array([1.0]), Bno055Errors(), rng)
