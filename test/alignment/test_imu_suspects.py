import numpy as np
import pytest
from moving_arm import measure, moving_arm
from scipy.spatial.transform import Rotation

from sesa2.alignment.imu_suspects import examine
from sesa2.shape.layout import Layout
from sesa2.shape.rotations import IDENTITY, multiply

SECONDS = 100.0


@pytest.fixture(scope='module')
def arm():
    rng = np.random.default_rng(1)
    motion = moving_arm(rng, seconds=SECONDS)
    return motion, measure(rng, motion.links)[0]


def examined(motion, q, layout=None, measured=None):
    n = q.shape[1]
    there = np.ones(q.shape[:2], bool) if measured is None else measured
    return examine(
        motion.stamps, q, there, layout or motion.layout, IDENTITY, np.tile(IDENTITY, (n, 1)), np.zeros(n)
    )


def test_a_sound_arm_is_not_suspected(arm):
    found = examined(*arm)
    assert found.misfit < 0.4
    for kind, most in (('loose', 3.0), ('place', 4.0), ('base', 1.3), ('lean', 0.5)):
        assert max(s.evidence for s in found.suspects if s.kind == kind) < most


@pytest.mark.parametrize('axis', 'xyz')
@pytest.mark.parametrize('imu', [0, 3, 6])
def test_a_loose_imu_is_found_with_its_angle_and_time(arm, imu, axis):
    motion, q = arm
    q = q.copy()
    late = motion.stamps > 0.625 * SECONDS
    q[late, imu] = multiply(q[late, imu], Rotation.from_euler(axis, 12.0, degrees=True).as_quat())
    best = examined(motion, q).suspects[0]
    assert (best.kind, best.imu, best.after) == ('loose', imu, 0.625)
    assert np.rad2deg(best.size) == pytest.approx(12.0, abs=4.0)


@pytest.mark.parametrize(('imu', 'metres'), [(1, 0.03), (3, -0.04), (4, 0.04)])
def test_an_imu_elsewhere_is_found_with_the_way_to_go(arm, imu, metres):
    motion, q = arm
    places = list(motion.layout.imu_positions)
    places[imu] -= metres  # it is farther out by so much than configured
    best = examined(motion, q, Layout(motion.layout.arm, tuple(places))).suspects[0]
    assert (best.kind, best.imu) == ('place', imu)
    assert 0.4 < best.size / metres < 1.2


@pytest.mark.parametrize('axis', 'xy')
def test_mountings_that_all_lean_are_found(arm, axis):
    """As an alignment on a leaning arm leaves them."""
    motion, q = arm
    lean = Rotation.from_euler(axis, 8.0, degrees=True).as_quat()
    best = examined(motion, multiply(q, lean)).suspects[0]
    assert (best.kind, best.imu) == ('lean', -1)
    assert np.rad2deg(best.size) == pytest.approx(8.0, abs=1.5)
    assert best.rest < 4.0


def test_the_right_cause_leaves_nothing_to_the_others(arm):
    motion, q = arm
    places = list(motion.layout.imu_positions)
    places[3] += 0.04
    found = examined(motion, q, Layout(motion.layout.arm, tuple(places))).suspects
    assert found[0].rest < 0.1 * found[0].evidence
    wrong = next(s for s in found if s.kind == 'loose')
    assert wrong.rest > 0.8 * found[0].evidence


def test_a_base_that_tilts_is_found(arm):
    motion, q = arm
    q = q.copy()
    late = motion.stamps > 0.5 * SECONDS
    q[late] = multiply(Rotation.from_euler('y', 12.0, degrees=True).as_quat(), q[late])
    found = examined(motion, q)
    base = next(s for s in found.suspects if s.kind == 'base')
    assert base.evidence > 1.3
    assert base.after == 0.5
    assert np.rad2deg(base.size) == pytest.approx(12.0, abs=5.0)


def test_constant_mountings_and_headings_are_nobodys_fault(arm):
    motion, _ = arm
    rng = np.random.default_rng(5)
    q, _ = measure(rng, motion.links, mounting=4.0, heading=10.0)
    found = examined(motion, q)
    assert found.suspects[0].evidence < 4.0


def test_an_imu_that_says_nothing_and_a_short_recording(arm):
    motion, q = arm
    there = np.ones(q.shape[:2], bool)
    there[:, 2] = False
    broken = q.copy()
    broken[:, 2] = np.nan
    assert examined(motion, broken, measured=there).misfit < 0.4
    few = motion._replace(stamps=motion.stamps[:100])
    assert examined(few, q[:100]) is None
    assert examined(motion, q, measured=np.zeros(q.shape[:2], bool)) is None
