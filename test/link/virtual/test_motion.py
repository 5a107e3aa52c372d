import numpy as np
import pytest

from sesa2.link.virtual.motion import ArmMotion
from sesa2.shape import rotations

POSITIONS = np.arange(1, 9) * 0.08
BASE = np.array([0.0, 0.6, 0.0, 0.8])
TIMES = np.linspace(0, 70, 701)


def sections(q, base):
    """Rotation vector from each IMU (base first) to the next, in the frame of the first."""
    before = np.concatenate([np.broadcast_to(base, (*q.shape[:-2], 1, 4)), q[..., :-1, :]], axis=-2)
    return rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(before), q))


@pytest.mark.parametrize('positions', [POSITIONS, [0.16, 0.3, 0.31, 0.64], [0.0, 0.2, 0.6], [0.3]])
def test_sections_bend_without_twist_and_at_most_by_a_right_angle(positions):
    q = ArmMotion(positions, BASE)(TIMES)
    assert q.shape == (701, len(positions), 4)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1, atol=1e-12)
    bends = sections(q, BASE)
    np.testing.assert_allclose(bends[..., 2], 0, atol=1e-9)
    assert np.linalg.norm(bends, axis=-1).max() < np.pi / 2


def test_an_imu_on_the_base_stays():
    q = ArmMotion([0.0, 0.2, 0.6], BASE)(TIMES)
    np.testing.assert_allclose(q[:, 0], np.broadcast_to(BASE, (701, 4)), atol=1e-12)


def test_straight_for_three_seconds_then_three_motions():
    bends = np.linalg.norm(sections(ArmMotion(POSITIONS)(TIMES), (0, 0, 0, 1)), axis=-1).max(axis=1)
    cycle = TIMES % 33
    assert bends[cycle < 3].max() < 1e-12
    for start in (3, 13, 23):
        assert bends[(cycle > start + 2) & (cycle < start + 8)].max() > 0.2


def test_the_tip_oscillates_below_the_base():
    q = ArmMotion(POSITIONS)(TIMES[(TIMES > 3) & (TIMES < 13)])
    assert rotations.tangent(q[:, -1])[:, 2].min() < -0.5


def test_motion_is_smooth():
    """No step anywhere: between two samples 1 ms apart no section turns by more than 10 rad/s would."""
    t = np.arange(0, 35, 1e-3)
    bends = sections(ArmMotion(POSITIONS)(t), (0, 0, 0, 1))
    assert np.abs(np.diff(bends, axis=0)).max() < 10 * 1e-3


def test_any_shape_of_times():
    motion = ArmMotion(POSITIONS, BASE)
    t = TIMES[:6].reshape(2, 3)
    assert motion(t).shape == (2, 3, 8, 4)
    np.testing.assert_allclose(motion(t)[1, 2], motion(float(t[1, 2])), atol=1e-12)
