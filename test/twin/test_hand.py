"""The hand's path is straight at first, then shows the three motions, differently for every seed."""

import numpy as np
import pytest

from sesa2.twin.hand import hand_path


def polar(path):
    distance = np.linalg.norm(path, axis=1)
    return (
        distance,
        np.rad2deg(np.arccos(path[:, 2] / distance)),
        np.unwrap(np.arctan2(path[:, 1], path[:, 0])),
    )


def path(seconds, seed):
    return hand_path(seconds, np.random.default_rng(seed))


def test_a_seed_is_a_motion():
    np.testing.assert_array_equal(path(30.0, 1)[1], path(30.0, 1)[1])
    assert np.abs(path(30.0, 1)[1] - path(30.0, 2)[1]).max() > 0.1


@pytest.mark.parametrize('seed', range(6))
def test_a_trial_shows_all_three_motions_in_a_hands_reach(seed):
    times, p = path(250.0, seed)
    distance, angle, azimuth = polar(p)
    still = times <= 5.0
    np.testing.assert_array_equal(p[still], np.broadcast_to([0.0, 0.0, 1.0], p[still].shape))
    assert distance.max() < 1.02  # the tremor may pull a little
    assert 0.4 < distance.min() < 0.7
    # Circling: more than two rounds with the hand low. Buckling: short and upright. Oscillating: below the base.
    low = angle > 55.0
    assert np.abs(np.diff(azimuth)[low[1:]]).sum() > 4.0 * np.pi
    assert (distance[angle < 25.0] < 0.65).any()
    assert angle.max() > 88.0
    acceleration = np.linalg.norm(np.diff(p, 2, axis=0), axis=1) * 1e6
    assert acceleration.max() < 6.0 / 0.48  # m/s² on the paper's arm: no jumps


@pytest.mark.parametrize(('seconds', 'straight'), [(4.0, 1.0), (20.0, 5.0), (41.0, 5.0)])
def test_short_trials_move_too(seconds, straight):
    times, p = path(seconds, 3)
    assert times[0] == 0.0
    assert times[-1] >= seconds
    assert np.abs(p[times <= straight] - [0.0, 0.0, 1.0]).max() == 0.0
    assert np.abs(p - [0.0, 0.0, 1.0]).max() > 0.02
