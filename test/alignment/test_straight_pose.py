"""Straight-pose alignment: what was put in comes out, and what cannot be told is refused."""

import numpy as np
import pytest
from moving_arm import measure as arm_measure
from moving_arm import moving_arm, tip_error
from scipy.spatial.transform import Rotation

from sesa2.alignment.straight_pose import AlignmentError, align_straight, mean_rotation
from sesa2.sensing.imu.error_model import Bno055Errors, measure
from sesa2.sensing.imu.mounting import Mounting
from sesa2.shape.models import create_model
from sesa2.shape.rotations import IDENTITY, from_rotation_vector, multiply, normalize

IDS = (2, 4, 6)
UP = IDENTITY
DOWN = np.array([1.0, 0.0, 0.0, 0.0])
OBLIQUE = Rotation.from_euler('zy', [40.0, 50.0], degrees=True).as_quat()
FLAT = Rotation.from_euler('zy', [40.0, 90.0], degrees=True).as_quat()


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def about_z(angle):
    return from_rotation_vector(np.multiply.outer(angle, [0.0, 0.0, 1.0]))


def held_still(rng, base, mountings, headings, n=120, white=0.2):
    """q_WS = Rz(heading) ⊗ base ⊗ q_LS, with white noise and random signs."""
    q = multiply(about_z(headings), multiply(base, mountings))
    noise = from_rotation_vector(np.deg2rad(white) * rng.normal(size=(n, len(headings), 3)))
    return multiply(q, noise) * rng.choice([-1.0, 1.0], size=(n, len(headings), 1))


def test_mean_is_scipys_whatever_the_signs(rng):
    q = Rotation.from_rotvec(0.3 * rng.normal(size=(50, 3))).as_quat()
    expected = Rotation.from_quat(q).mean().as_matrix()
    got = mean_rotation(q * rng.choice([-1.0, 1.0], size=(50, 1)))
    np.testing.assert_allclose(Rotation.from_quat(got).as_matrix(), expected, atol=1e-14)


@pytest.mark.parametrize('base', [UP, DOWN, OBLIQUE, FLAT], ids=['up', 'down', 'oblique', 'flat'])
def test_tilt_is_found_whatever_the_mounting_was(rng, base):
    old = normalize(rng.normal(size=(3, 4)))
    tilt = np.deg2rad([[2.0, -1.0, 0.0], [-3.0, 4.0, 0.0], [0.0, 10.0, 0.0]])
    true = multiply(from_rotation_vector(tilt), old)
    q = held_still(rng, base, true, np.zeros(3))
    got = align_straight(q, np.ones((120, 3), bool), base, old, np.zeros(3), ids=IDS)
    np.testing.assert_allclose(got.corrections, tilt, atol=np.deg2rad(0.1))
    aligned = Mounting(got.mountings, got.headings).link_orientations(q)
    axes = Rotation.from_quat(aligned.reshape(-1, 4)).apply([0.0, 0.0, 1.0]).reshape(120, 3, 3).mean(axis=0)
    np.testing.assert_allclose(axes, np.tile(Rotation.from_quat(base).apply([0, 0, 1]), (3, 1)), atol=2e-3)
    np.testing.assert_allclose(np.rad2deg(got.spread), 0.2 * np.sqrt(3), rtol=0.15)
    np.testing.assert_array_equal(got.headings, 0.0)


def test_a_turn_about_the_axis_is_left_alone_but_told(rng):
    """Bent afterwards, an arm whose headings were put into the mountings would be wrong by as much as they were."""
    headings = np.deg2rad([20.0, -5.0, 0.0])
    mountings = np.tile(IDENTITY, (3, 1))
    q = held_still(rng, UP, mountings, headings)
    got = align_straight(q, np.ones((120, 3), bool), UP, mountings, np.zeros(3), ids=IDS)
    np.testing.assert_allclose(np.rad2deg(got.corrections), 0.0, atol=0.1)
    np.testing.assert_allclose(np.rad2deg(got.unexplained), [20.0, -5.0, 0.0], atol=0.1)


@pytest.mark.parametrize('base', [UP, DOWN], ids=['up', 'down'])
def test_what_relates_link_and_base_is_a_twist_and_a_swing_and_the_swing_alone_is_corrected(rng, base):
    """However large both are: a logarithm's x and y would mix them."""
    mountings = np.tile(IDENTITY, (3, 1))
    swings = np.deg2rad([[20.0, -10.0, 0.0], [0.0, 25.0, 0.0], [-15.0, 5.0, 0.0]])
    twists = np.deg2rad([70.0, -120.0, 30.0])
    q = multiply(multiply(base, about_z(twists)), from_rotation_vector(swings))
    q = np.tile(q, (50, 1, 1))
    got = align_straight(q, np.ones((50, 3), bool), base, mountings, np.zeros(3), ids=IDS)
    np.testing.assert_allclose(got.corrections, swings, atol=1e-9)
    np.testing.assert_allclose(got.unexplained, twists, atol=1e-9)
    left = Mounting(got.mountings, got.headings).link_orientations(q[0])
    expected = Rotation.from_quat(base) * Rotation.from_euler('z', twists[:, None])
    assert (expected.inv() * Rotation.from_quat(left)).magnitude().max() < 1e-9
    assert len(got.doubts(IDS)) == 3  # and each is told of


@pytest.mark.parametrize('base', [UP, FLAT], ids=['up', 'flat'])
def test_positions_get_no_worse_by_a_straight_pose(base):
    """Headings as a chip's in a room with iron; lying flat they look like tilt, and are taken off as such."""
    raw, after = [], []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        motion = moving_arm(rng, base=base, bend=1.5, seconds=30.0)
        held = np.tile(base, (100, 8, 1))
        q, _ = arm_measure(rng, np.concatenate([held, motion.links]), mounting=2.0, heading=6.0)
        found = align_straight(
            q[:100], np.ones((100, 8), bool), base, np.tile(IDENTITY, (8, 1)), np.zeros(8), ids=range(1, 9)
        )
        model = create_model('spline', motion.layout)
        raw.append(tip_error(model, q[100:], motion))
        links = Mounting(found.mountings, found.headings).link_orientations(q[100:])
        after.append(tip_error(model, links, motion))
    assert np.mean(after) < np.mean(raw)


@pytest.mark.parametrize('base', [UP, DOWN, OBLIQUE], ids=['up', 'down', 'oblique'])
def test_on_demand_headings_and_tilts_are_told_apart(rng, base):
    old = normalize(rng.normal(size=(3, 4)))
    known = np.deg2rad([5.0, 0.0, -100.0])
    tilt = np.deg2rad([[2.0, -1.0, 0.0], [-3.0, 4.0, 0.0], [0.0, 5.0, 0.0]])
    drift = np.deg2rad([30.0, -4.0, 170.0])
    true = multiply(from_rotation_vector(tilt), old)
    q = held_still(rng, base, true, known + drift, white=0.05)
    got = align_straight(q, np.ones((120, 3), bool), base, old, known, ids=IDS, correct_headings=True)
    np.testing.assert_allclose(np.rad2deg(got.headings - known - drift), 0.0, atol=0.1)
    np.testing.assert_allclose(np.rad2deg(got.unexplained), 0.0, atol=1e-9)
    same = Rotation.from_quat(got.mountings).inv() * Rotation.from_quat(true)
    assert np.rad2deg(same.magnitude()).max() < 0.1


def test_an_imu_that_was_not_heard_keeps_its_mounting(rng):
    old = normalize(rng.normal(size=(3, 4)))
    q = held_still(rng, UP, multiply(from_rotation_vector([0.05, 0.0, 0.0]), old), np.zeros(3))
    measured = np.ones((120, 3), bool)
    measured[:, 1] = False
    q[:40, 2] = np.nan  # says that it has measured, and has not
    got = align_straight(q, measured, UP, old, np.zeros(3), ids=IDS)
    np.testing.assert_allclose(np.abs(np.sum(got.mountings[1] * old[1])), 1.0)
    np.testing.assert_allclose(got.corrections[[0, 2], 0], 0.05, atol=2e-3)
    np.testing.assert_array_equal(got.samples, [120, 0, 80])
    assert np.isnan(got.spread[1])


def test_a_base_measured_by_its_own_imu(rng):
    bases = multiply(OBLIQUE, from_rotation_vector(0.003 * rng.normal(size=(120, 3))))
    q = held_still(rng, OBLIQUE, np.tile(IDENTITY, (3, 1)), np.zeros(3))
    got = align_straight(q, np.ones((120, 3), bool), bases, np.tile(IDENTITY, (3, 1)), np.zeros(3), ids=IDS)
    np.testing.assert_allclose(np.rad2deg(got.corrections), 0.0, atol=0.15)


@pytest.mark.parametrize('seconds', [3.0, 20.0])
def test_what_a_chips_fusion_wanders_by_is_no_motion(seconds):
    for seed in range(20):
        times = np.linspace(0.0, seconds + 0.2, round(200 * seconds))
        still = np.tile(IDENTITY, (len(times), 8, 1))
        sweeps = np.arange(0.1, seconds, 0.02)
        q = measure(times, still, sweeps, Bno055Errors(), np.random.default_rng(seed)).orientations
        mountings = np.tile(IDENTITY, (8, 1))
        found = align_straight(q, np.ones(q.shape[:2], bool), UP, mountings, np.zeros(8), ids=range(8))
        assert found.spread.max() > np.deg2rad(0.5)


@pytest.mark.parametrize(
    ('spoil', 'base', 'message'),
    [
        (lambda q, m, b: (q[:12], m[:12], b), UP, r'IMU 2: 12, IMU 4: 12, IMU 6: 12\), expected at least 30'),
        (lambda q, m, b: (q, m & False, b), UP, r'too few samples \(none\)'),
        (lambda q, m, b: (sway(q, 1), m, b), UP, r'the arm moved: IMU 4 by 3\.\d° rms'),
        (lambda q, m, b: (q, m, sway(np.tile(b, (120, 1, 1)), 0)[:, 0]), UP, r'the base by 3\.\d°'),
        (lambda q, m, b: (q, m, b), FLAT, r'90° from the vertical, expected at most 60°'),
    ],
)
def test_what_cannot_be_told_is_refused(rng, spoil, base, message):
    mountings = np.tile(IDENTITY, (3, 1))
    q, measured, bases = spoil(held_still(rng, base, mountings, np.zeros(3)), np.ones((120, 3), bool), base)
    with pytest.raises(AlignmentError, match=message):
        align_straight(q, measured, bases, mountings, np.zeros(3), ids=IDS, correct_headings=True)


def sway(q, imu):
    """One IMU turns by 12° while the others rest."""
    q = q.copy()
    turn = from_rotation_vector(np.outer(np.deg2rad(np.linspace(0.0, 12.0, len(q))), [0.0, 1.0, 0.0]))
    q[:, imu] = multiply(turn, q[:, imu])
    return q
