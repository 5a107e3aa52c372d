import numpy as np
import pytest

from sesa2.evaluation.screening import screen
from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.shape.rotations import from_rotation_vector, rotate


def changed(trajectory, positions):
    return Trajectory(trajectory.times, positions, trajectory.names)


@pytest.fixture
def truth(motion):
    return motion.record(100.0)


def test_a_clean_truth_is_left_alone(truth, motion):
    got = screen(truth, motion.record(31.0), 0.6)
    np.testing.assert_array_equal(got.truth.positions, truth.positions)
    assert got.scale == 1.0
    assert got.held == got.exchanged == got.untold == got.jumped == {'M1': 0, 'M2': 0}


def test_the_simulated_trial_is_left_alone(twin):
    got = screen(twin[1], twin[0], 0.6)
    assert got.truth.seen.all()


def test_millimetres_become_metres(truth, motion):
    far_away = 1e3 * (truth.positions + 7.0)
    got = screen(changed(truth, far_away), motion.record(31.0), 0.6)
    assert got.scale == 1e-3
    np.testing.assert_allclose(got.truth.positions, truth.positions + 7.0)


@pytest.mark.parametrize('factor', [100.0, 39.37, 1e6])
def test_other_units_are_refused(truth, motion, factor):
    with pytest.raises(
        EvaluationError, match=r'not in metres.*farthest marker is 0\.6 m.*Nor is it in millimetres'
    ):
        screen(changed(truth, factor * truth.positions), motion.record(31.0), 0.6)


def test_an_estimate_that_stands_still_proves_no_unit(truth):
    still = Trajectory(truth.times, np.full_like(truth.positions, 0.1), truth.names)
    assert screen(truth, still, 0.6).scale == 1.0
    with pytest.raises(EvaluationError, match='not in metres'):
        screen(changed(truth, 1e3 * truth.positions), still, 0.6)


@pytest.mark.parametrize(
    'swaps', [[(500, 501)], [(2000, 2600)], [(0, 40)], [(5900, 6000)], [(100, 900), (901, 1500)]]
)
def test_exchanged_markers_are_left_out_exactly(truth, motion, swaps):
    p = truth.positions.copy()
    wrong = np.zeros(len(p), dtype=bool)
    for start, stop in swaps:
        p[start:stop] = p[start:stop, ::-1]
        wrong[start:stop] = True
    got = screen(changed(truth, p), motion.record(31.0), 0.6)
    np.testing.assert_array_equal(got.truth.seen, np.tile(~wrong[:, None], 2))
    assert got.exchanged == {'M1': wrong.sum(), 'M2': wrong.sum()}
    assert got.jumped == {'M1': 0, 'M2': 0}


def test_markers_that_come_back_exchanged_from_a_gap(truth, motion):
    p = truth.positions.copy()
    p[1000:1030] = np.nan
    p[1030:1400] = p[1030:1400, ::-1]
    p[1400:1420, 0] = np.nan
    got = screen(changed(truth, p), motion.record(31.0), 0.6)
    assert not got.truth.seen[1000:1400].any()
    assert got.truth.seen[:1000].all()
    assert got.truth.seen[1420:].all()
    assert got.exchanged == {'M1': 370, 'M2': 370}


@pytest.mark.parametrize('gap', [10, 50, 150, 400])
@pytest.mark.parametrize('exchanged', [slice(2000, 3000), slice(0, 2000), slice(2000, 6000)])
def test_which_is_which_is_not_carried_over_a_gap(truth, motion, gap, exchanged):
    p = truth.positions.copy()
    p[exchanged] = p[exchanged, ::-1]
    p[2000 : 2000 + gap] = np.nan
    wrong = np.zeros(len(p), dtype=bool)
    wrong[exchanged] = True
    got = screen(changed(truth, p), motion.record(31.0), 0.6)
    np.testing.assert_array_equal(got.truth.seen[:, 0], ~wrong & ~np.isnan(p[:, 0, 0]))
    np.testing.assert_array_equal(got.truth.seen[:, 0], got.truth.seen[:, 1])


def test_which_is_which_is_told_across_frames_and_clocks(truth, motion):
    p = truth.positions.copy()
    p[:4000] = p[:4000, ::-1]
    turned = rotate(from_rotation_vector([0.3, 2.0, -1.0]), p) + np.array([1.0, 2.0, 3.0])
    moved = Trajectory(truth.times + 77.7, turned, truth.names)
    got = screen(moved, motion.record(31.0), 0.6)
    np.testing.assert_array_equal(got.truth.seen[:, 0], np.arange(len(p)) >= 4000)


def test_an_exchange_is_left_out_whole_where_nothing_tells_which_side_is_right(truth, motion):
    p = truth.positions.copy()
    p[3000:3100] = np.nan
    p[5000:] = p[5000:, ::-1]
    other = changed(truth, truth.positions[::-1])
    got = screen(changed(truth, p), other, 0.6)
    assert got.truth.seen[:3000].all()
    assert not got.truth.seen[3000:].any()
    assert got.untold == {'M1': 2900, 'M2': 2900}
    assert got.exchanged == {'M1': 0, 'M2': 0}


def test_names_that_are_exchanged_throughout_are_told_and_nothing_is_left_out(truth, motion):
    p = truth.positions[:, ::-1].copy()
    p[3000:3100] = np.nan
    got = screen(changed(truth, p), motion.record(31.0), 0.6)
    assert got.exchanged_throughout == (('M1', 'M2'),)
    assert got.truth.seen.sum() == 2 * (len(p) - 100)
    assert screen(truth, motion.record(31.0), 0.6).exchanged_throughout == ()


def test_jumps_are_left_out_exactly(truth, motion):
    p = truth.positions.copy()
    p[700, 0] += (0.0, 0.3, 0.0)
    p[3000:3020, 1] = (0.5, 0.5, 0.5)
    p[-3:, 1] += 1.0
    p[0, 0] -= 1.0
    wrong = (p != truth.positions).any(axis=2)
    got = screen(changed(truth, p), motion.record(31.0), 0.6)
    np.testing.assert_array_equal(got.truth.seen, ~wrong)
    assert got.jumped == {'M1': 2, 'M2': 23}


def test_a_position_that_is_held_is_not_a_measurement(truth, motion):
    p = truth.positions.copy()
    p[2000:3000, 1] = p[2000, 1]
    got = screen(changed(truth, p), motion.record(31.0), 0.6)
    assert got.held == {'M1': 0, 'M2': 999}
    assert got.jumped == {'M1': 0, 'M2': 0}
    assert not got.truth.seen[2001:3000, 1].any()
    assert got.truth.seen.sum() == 2 * len(p) - 999


def test_an_arm_at_rest_is_not_held(truth, motion):
    p = truth.positions.copy()
    p[2000:3000] = p[2000]  # in a simulation without noise
    p[3000:] -= p[3000] - p[2000]
    assert screen(changed(truth, p), motion.record(31.0), 0.6).held == {'M1': 0, 'M2': 0}


def test_one_marker_in_the_place_of_the_other_that_is_hidden(truth, motion):
    p = truth.positions.copy()
    p[1000:1100, 0] = p[1000:1100, 1]
    p[1000:1100, 1] = np.nan
    got = screen(changed(truth, p), motion.record(31.0), 0.6)
    assert not got.truth.seen[1000:1100].any()
    assert got.truth.seen.sum() == 2 * (len(p) - 100)


def test_a_long_rest_before_a_short_motion_is_no_jump():
    t = np.arange(0.0, 100.0, 0.01)
    p = np.random.default_rng(0).normal(0.0, 1e-4, (len(t), 1, 3))
    moving = t > 98.0
    p[moving, 0, 0] += 0.2 * np.sin(3.0 * (t[moving] - 98.0))
    truth = Trajectory(t, p, ('M1',))
    assert screen(truth, truth, 0.6).truth.seen.all()


def test_markers_that_are_never_seen_together(truth, motion):
    p = truth.positions.copy()
    p[:3000, 0] = np.nan
    p[3000:, 1] = np.nan
    got = screen(changed(truth, p), motion.record(31.0), 0.6)
    assert got.truth.seen.sum() == len(p)


def test_refuses_a_marker_that_was_never_seen(truth, motion):
    p = truth.positions.copy()
    p[:, 1] = np.nan
    with pytest.raises(EvaluationError, match='nothing of M2 can be used; it was seen in 0 samples'):
        screen(changed(truth, p), motion.record(31.0), 0.6)


@pytest.mark.parametrize('gap', [1, 2, 30])
@pytest.mark.parametrize('scale', [1.0, 1000.0])
def test_zeros_are_a_marker_that_was_not_seen(truth, motion, gap, scale):
    p = truth.positions * scale
    lost = np.arange(len(p)) % 100 < gap
    p[lost, 1] = 0.0
    got = screen(changed(truth, p), motion.record(31.0), 0.6)
    assert got.lost == {'M1': 0, 'M2': lost.sum()}
    np.testing.assert_array_equal(~got.truth.seen[:, 1], lost)
    assert got.truth.seen[:, 0].all()
    assert got.jumped == got.held == {'M1': 0, 'M2': 0}


def test_a_marker_at_the_origin_is_not_lost(truth, motion):
    p = truth.positions.copy()
    p[:, 0] -= p[17, 0]  # it passes there
    got = screen(changed(truth, p), motion.record(31.0), 0.6)
    assert got.lost == {'M1': 0, 'M2': 0}
