"""Sensors whose own readings show that they lie, and those found out by a prediction."""

import numpy as np
from paper_arm import PaperArm
from scipy.stats import chi2, norm

from sesa2.shape.reading_faults import (
    REPEATS,
    SURE,
    ReadingFault,
    ReadingWatch,
    beyond_chance,
    find_jumping,
    own_faults,
)

N, S1, R = ReadingFault.NONE, ReadingFault.SILENT, ReadingFault.REPEATING
J, D = ReadingFault.JUMPING, ReadingFault.DOUBTED


def test_silent_and_saturated():
    readings = np.array([[1e-3, 0.0, 2e-3, np.nan], [5e-3, -6e-3, 1e-3, np.inf]])
    faults = own_faults(readings, np.arange(4), 4, 5e-3)
    sat = ReadingFault.SATURATED
    assert faults.tolist() == [[N, S1, N, S1], [sat, sat, N, S1]]


def test_three_axes_are_one_sensor():
    of = np.repeat(np.arange(3), 3)
    readings = np.array([0.0, 1e-4, 0.0, 1e-4, np.nan, 1e-4, 1e-4, 1e-4, -2.0])
    assert own_faults(readings, of, 3, 1.0).tolist() == [N, S1, ReadingFault.SATURATED]
    assert own_faults(np.zeros(9), of, 3, 1.0).tolist() == [S1] * 3


def watched(readings, arm):
    watch = ReadingWatch(arm.predictor)
    return np.array([watch.faults(u) for u in readings])


def test_a_sensor_that_repeats_itself_while_others_move():
    arm = PaperArm(3)
    noise = arm.predictor.noise[0]
    u = 1e-4 + np.cumsum(4.0 * noise * np.ones((30, 9)), axis=0)
    u[10:20, 4] = u[10, 4]
    faults = watched(u, arm)
    assert (faults[10 + REPEATS - 1 : 20, 4] == R).all()
    faults[10 + REPEATS - 1 : 20, 4] = N
    assert (faults == N).all()  # at once well again, and nobody else


def test_all_at_rest_or_of_coarse_steps_is_no_fault():
    arm = PaperArm(3)
    noise = arm.predictor.noise[0]
    still = np.full((50, 9), 1e-4)
    assert (watched(still, arm) == N).all()
    rng = np.random.default_rng(0)
    coarse = noise * np.round(rng.normal(size=(2000, 9)) + 150.0)  # steps as large as the noise
    assert (watched(coarse, arm) == N).all()


def test_repeating_wants_all_axes():
    arm = PaperArm(2, 1, axes='xyz')
    u = 1e-4 + np.cumsum(np.full((20, 6), 5e-6), axis=0)
    u[5:, 1] = u[5, 1]
    assert (watched(u, arm) == N).all()
    u[5:, :3] = u[5, :3]
    assert (watched(u, arm)[5 + REPEATS - 1 :, 0] == R).all()


def test_thresholds_are_as_rare_for_all_numbers_of_axes():
    rare = 2.0 * norm.sf(SURE)
    for n in (1, 2, 3, 9):
        assert 0.001 < chi2.sf(beyond_chance(n), n) / rare < 2.0  # so far out the approximation is rough


def innovations_of(rng, n, spread, offsets):
    """Three unknowns predicted within `spread` noises, n readings."""
    A = rng.normal(size=(n, 3))
    S = spread**2 * A @ A.T + np.eye(n)
    return spread * A @ rng.normal(size=3) + rng.normal(size=n) + offsets, S


def test_the_one_that_jumps_is_found_and_no_other():
    rng = np.random.default_rng(1)
    for _ in range(200):
        j = rng.integers(8)
        v, S = innovations_of(rng, 8, 3.0, 40.0 * np.eye(8)[j])
        assert find_jumping(v, S, np.arange(8), 2).tolist() == [J if i == j else N for i in range(8)]
        v, S = innovations_of(rng, 8, 3.0, 0.0)
        assert find_jumping(v, S, np.arange(8), 2).tolist() == [N] * 8


def test_against_leaving_out_by_hand():
    """What leaving out a sensor takes from χ² is the difference of two χ²."""
    rng = np.random.default_rng(2)
    v, S = innovations_of(rng, 6, 2.0, 30.0 * np.eye(6)[4])
    of = np.array([0, 0, 1, 1, 2, 2])
    whole = v @ np.linalg.solve(S, v)
    taken = []
    for k in range(3):
        rest = of != k
        taken.append(whole - v[rest] @ np.linalg.solve(S[np.ix_(rest, rest)], v[rest]))
    assert np.argmax(taken) == 2
    assert taken[2] > beyond_chance(2)
    assert find_jumping(v, S, of, 1).tolist() == [N, N, J]


def test_sensors_that_cannot_be_told_apart_are_doubted():
    """Four in a ring: bends and length leave the one parity + − + −, which all four explain alike."""
    A = np.array([[1.0, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1]])
    S = 1e8 * A @ A.T + np.eye(4)
    v = 60.0 * np.eye(4)[1]
    assert find_jumping(v, S, np.arange(4), 4).tolist() == [D] * 4
    assert find_jumping(v, S, np.arange(4), 3) is None
    sharp = 4.0 * A @ A.T + np.eye(4)  # a prediction breaks the tie
    assert find_jumping(v, sharp, np.arange(4), 4).tolist() == [N, J, N, N]


def test_two_that_jump_and_more_than_may():
    rng = np.random.default_rng(3)
    off = np.zeros(12)
    off[[2, 7]] = 50.0, -80.0
    v, S = innovations_of(rng, 12, 2.0, off)
    assert np.flatnonzero(find_jumping(v, S, np.arange(12), 4)).tolist() == [2, 7]
    assert find_jumping(v, S, np.arange(12), 1) is None


def test_nothing_measured():
    assert find_jumping(np.zeros(0), np.zeros((0, 0)), np.arange(0), 1).tolist() == []
