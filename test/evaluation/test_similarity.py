import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_motion import Motion
from scipy.spatial.transform import Rotation

from sesa2.evaluation.similarity import fit_similarity
from sesa2.evaluation.trajectory import Trajectory

ARCS = np.array([0.36, 0.60])


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.floats(0.8, 1.25), st.floats(-3e-3, 3e-3))
def test_all_that_was_put_in_is_found(seed, scale, rate):
    motion = Motion(seed % 5, 40.0)
    rng = np.random.default_rng(seed)
    estimate, seen = motion.record(100.0), motion.record(60.0)
    turn, shift = Rotation.random(random_state=seed), rng.normal(size=3)
    p = scale * turn.apply(seen.positions.reshape(-1, 3)).reshape(seen.positions.shape) + shift
    times = 20.0 + (1.0 + rate) * (seen.times - 20.0) + 7.0
    found = fit_similarity(estimate, Trajectory(times, p, seen.names), 7.01, ARCS)
    assert found.scale == pytest.approx(scale, rel=1e-3)
    assert found.clock_rate == pytest.approx(rate, abs=3e-5)
    assert (Rotation.from_quat(found.rotation) * turn.inv()).magnitude() < 2e-3
    np.testing.assert_allclose(found.translation, shift, atol=2e-3)
    assert found.left < 1e-3
    own = found.estimate_times(times, 7.01)
    np.testing.assert_allclose(own, seen.times, atol=2e-3)


def test_a_motion_that_tells_nothing(motion):
    estimate = motion.record(100.0)
    still = Trajectory(
        estimate.times, np.broadcast_to([[[0.0, 0.0, 0.3]]], (len(estimate.times), 2, 3)), ('M1', 'M2')
    )
    assert fit_similarity(estimate, still, 0.0, ARCS) is None
    assert fit_similarity(estimate, Trajectory([500.0], np.ones((1, 2, 3)), ('M1', 'M2')), 0.0, ARCS) is None


def test_what_bends_between_imus_is_no_scale():
    """An estimate that is too long the more it bends has the right size when it is straight."""
    motion = Motion(2, 60.0)
    seen = motion.record(60.0)
    nearer = 1.0 - np.linalg.norm(seen.positions, axis=2, keepdims=True) / ARCS[:, None]
    long = Trajectory(seen.times, seen.positions * (1.0 + 0.5 * nearer), seen.names)
    found = fit_similarity(long, seen, 0.0, ARCS)
    assert found.scale == pytest.approx(1.0, abs=0.02)
    assert found.bends < -0.2


def until(trajectory, end):
    inside = trajectory.times < end
    return Trajectory(trajectory.times[inside], trajectory.positions[inside], trajectory.names)


def test_a_trial_that_is_too_short_says_so():
    motion = Motion(3, 60.0)
    seen = motion.record(60.0)
    noisy = Trajectory(
        seen.times,
        seen.positions + np.random.default_rng(0).normal(0.0, 2e-3, seen.positions.shape),
        seen.names,
    )
    short = fit_similarity(until(noisy, 15.0), seen, 0.0, ARCS)
    assert np.isinf(short.clock_told_from)
    assert 'too short to tell the clock rate' in short.told()
    some = fit_similarity(until(noisy, 24.0), seen, 0.0, ARCS)
    assert some.clock_told_from > 1e-3
    assert re.search(r'too short a trial to tell less than \d{4} ppm', some.told())
    whole = fit_similarity(noisy, seen, 0.0, ARCS)
    assert whole.clock_told_from < 1e-3
    assert abs(whole.clock_rate) < 5.0 * whole.clock_rate_std
    assert 'short' not in whole.told()
