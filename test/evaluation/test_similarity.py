import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_motion import Motion
from scipy.spatial.transform import Rotation

from sesa2.evaluation.similarity import fit_similarity
from sesa2.evaluation.trajectory import Trajectory


@settings(max_examples=20)
@given(st.integers(0, 1000), st.floats(0.8, 1.25), st.floats(-3e-3, 3e-3))
def test_all_that_was_put_in_is_found(seed, scale, rate):
    motion = Motion(seed % 5, 40.0)
    rng = np.random.default_rng(seed)
    estimate, seen = motion.record(100.0), motion.record(60.0)
    turn, shift = Rotation.random(random_state=seed), rng.normal(size=3)
    p = scale * turn.apply(seen.positions.reshape(-1, 3)).reshape(seen.positions.shape) + shift
    times = 20.0 + (1.0 + rate) * (seen.times - 20.0) + 7.0
    found = fit_similarity(estimate, Trajectory(times, p, seen.names), 7.01)
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
    assert fit_similarity(estimate, still, 0.0) is None
    assert fit_similarity(estimate, Trajectory([500.0], np.ones((1, 2, 3)), ('M1', 'M2')), 0.0) is None
