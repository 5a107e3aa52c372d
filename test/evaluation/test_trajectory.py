import numpy as np
import pytest

from sesa2.evaluation.trajectory import EvaluationError, Trajectory

T = np.arange(10) * 0.1
P = np.random.default_rng(1).normal(size=(10, 2, 3))
NAMES = ('M1', 'M2')


def test_interpolates_like_numpy():
    trajectory = Trajectory(T, P, NAMES)
    at = np.linspace(0.0, 0.9, 57)
    got = trajectory.at(at)
    for m in range(2):
        for c in range(3):
            np.testing.assert_allclose(got[:, m, c], np.interp(at, T, P[:, m, c]), atol=1e-14)


def test_no_extrapolation():
    got = Trajectory(T, P, NAMES).at([-0.01, 0.0, 0.9, 0.91])
    assert np.isnan(got[[0, 3]]).all()
    np.testing.assert_array_equal(got[[1, 2]], P[[0, 9]])


def test_short_gaps_are_bridged_and_long_ones_are_not():
    times = np.linspace(0.0, 9.9, 100)
    for lost, bridged in (([50, 51], True), ([50, 51, 52], False)):
        keep = np.delete(np.arange(100), lost)
        got = Trajectory(times[keep], np.zeros((len(keep), 1, 3)), ('M1',)).at([5.05])
        assert np.isfinite(got).all() == bridged


def test_an_unseen_marker_leaves_the_other_alone():
    p = P.copy()
    p[2:7, 0] = np.nan
    got = Trajectory(T, p, NAMES).at([T[1], 0.35, T[7]])
    assert np.isnan(got[1, 0]).all()
    assert np.isfinite(got[1, 1]).all()
    # on the edge of the gap a sample is still itself
    np.testing.assert_array_equal(got[[0, 2], 0], p[[1, 7], 0])


def test_bursts_do_not_make_gaps():
    # eight messages within 4 ms, every 32 ms, as the predecessor sent them
    times = (np.arange(50)[:, None] * 0.032 + np.arange(8) * 5e-4).ravel()
    trajectory = Trajectory(times, np.zeros((400, 1, 3)), ('M1',))
    assert np.isfinite(trajectory.at([0.016, 0.5])).all()


def test_select_orders_by_name():
    np.testing.assert_array_equal(Trajectory(T, P, NAMES).select(('M2', 'M1')).positions, P[:, ::-1])
    with pytest.raises(EvaluationError, match='no marker M3; there are M1, M2'):
        Trajectory(T, P, NAMES).select(('M3',))


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'times': T[::-1]}, r'times\[1\] = 0\.8 s is not after times\[0\] = 0\.9'),
        ({'times': np.where(T > 0.5, np.nan, T)}, r'times\[6\] is not a finite'),
        ({'times': T[:5]}, r'expected \(n,\) and \(n, 2, 3\)'),
        ({'names': ('M1', 'M1')}, 'all different'),
        ({'positions': np.where(np.arange(3) == 1, np.nan, P)}, 'M1 at sample 0'),
        ({'positions': np.full_like(P, np.inf)}, 'three finite numbers'),
        ({'times': [], 'positions': np.zeros((0, 2, 3))}, 'no samples'),
    ],
)
def test_refuses(change, message):
    with pytest.raises(EvaluationError, match=message):
        Trajectory(**({'times': T, 'positions': P, 'names': NAMES} | change))


def test_is_frozen_and_owns_its_arrays():
    mine = P.copy()
    trajectory = Trajectory(T, mine, NAMES)
    mine[:] = 0.0
    np.testing.assert_array_equal(trajectory.positions, P)
    with pytest.raises(ValueError, match='read-only'):
        trajectory.positions[0] = 0.0


def test_orientations_are_interpolated_the_short_way_and_chosen_with_their_markers():
    turned = np.zeros((2, 2, 4))
    turned[0, :, 3] = 1.0
    turned[1, 0] = -np.array([np.sin(0.3), 0.0, 0.0, np.cos(0.3)])  # the same rotation as without the sign
    turned[1, 1, 3] = 1.0
    trajectory = Trajectory([0.0, 1.0], np.zeros((2, 2, 3)), ('A', 'B'), turned)
    quarter = trajectory.select(('A',)).turned_at([0.25, 2.0])[:, 0]
    np.testing.assert_allclose(np.abs(quarter[0]), [np.sin(0.075), 0.0, 0.0, np.cos(0.075)], atol=1e-12)
    np.testing.assert_allclose(np.abs(quarter[1]), [np.sin(0.3), 0.0, 0.0, np.cos(0.3)], atol=1e-12)
    with pytest.raises(EvaluationError, match='orientations'):
        Trajectory([0.0], np.zeros((1, 1, 3)), ('A',), np.zeros((1, 2, 4)))
