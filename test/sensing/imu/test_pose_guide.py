import numpy as np
import pytest
from held_poses import UP, recording

from sesa2.sensing.imu.accelerometer_calibration import AccelerometerError
from sesa2.sensing.imu.pose_guide import PoseGuide

T, BIAS = np.diag([1.02, 0.98, 1.01]), np.array([0.2, -0.3, 0.1])


def test_it_leads_through_the_poses_and_calibrates():
    guide, steps, new = PoseGuide(), [], 0
    t, a, w, spans = recording(np.random.default_rng(0), [2.0, 2.0, 2.5, 2.0, 4.0, 2.0])
    for time, velocity, acceleration in zip(t, w, a @ T.T + BIAS, strict=True):
        new += guide.add(time, velocity, acceleration)
        if not steps or steps[-1] != guide.next_step:
            steps.append(guide.next_step)
    assert new == 6
    assert [step.count('+') + step.count('-') for step in steps] == [6, 5, 4, 3, 2, 1, 0]
    assert '+x, -x, +y, -y, +z, -z' in steps[0]
    assert steps[-1] == 'calibrated'
    fit = guide.fit()
    np.testing.assert_allclose(fit.calibration.bias, BIAS, atol=0.02)
    np.testing.assert_allclose(fit.calibration.matrix, np.linalg.inv(T), atol=0.003)
    assert len(spans) == len(UP)


def test_what_is_only_moved_or_too_short_is_no_pose():
    guide = PoseGuide()
    t, a, w, _ = recording(np.random.default_rng(1), [0.6] * 6)
    for sample in zip(t, w, a, strict=True):
        assert not guide.add(*sample)
    with pytest.raises(AccelerometerError, match='none with'):
        guide.fit()


def test_a_pause_of_the_stream_is_no_stillness():
    guide = PoseGuide()
    still = np.zeros(3), np.array([0.0, 0.0, 9.81])
    assert not any(guide.add(t, *still) for t in (*np.arange(0, 0.8, 0.01), *np.arange(5, 5.8, 0.01)))
    assert not any(guide.add(t, *still) for t in np.arange(2, 2.8, 0.01))  # nor a step back
