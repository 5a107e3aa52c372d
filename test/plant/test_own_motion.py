"""The motion of an arm that nobody commands."""

import numpy as np
import pytest
from slipping_arms import arm, command_of

from sesa2.plant.own_motion import STRAIGHT_S, OwnMotion
from sesa2.plant.plant_options import HEAVY, MILD

HOME, LONGEST = np.array([0.12, 0.1]), np.array([0.22, 0.15])
T = np.arange(0.0, 200.0, 0.01)


@pytest.mark.parametrize('seed', range(4))
def test_it_begins_straight_at_home_and_stays_within_bounds(seed):
    q = OwnMotion(HOME, LONGEST, 1.6, np.random.default_rng(seed)).coordinates(T).reshape(-1, 2, 3)
    straight = q[T <= STRAIGHT_S]
    np.testing.assert_array_equal(straight[..., :2], 0.0)
    np.testing.assert_allclose(straight[..., 2], np.broadcast_to(HOME, (len(straight), 2)))
    bend = np.hypot(q[..., 0], q[..., 1])
    assert 1.0 < bend.max() < 1.6
    assert (q[..., 2] >= HOME - 1e-12).all()
    np.testing.assert_allclose(q[..., 2].max(axis=0), LONGEST, rtol=1e-4)
    # Smooth: no step, and no kink in the speed.
    assert np.abs(np.diff(q, axis=0)).max() < 0.015
    assert np.abs(np.diff(q, n=2, axis=0)).max() < 4e-4


@pytest.mark.parametrize('options', [MILD, HEAVY])
def test_the_arm_does_not_wander_off(options):
    plant, motion = arm(options), OwnMotion(HOME[:1], LONGEST[:1], 1.6, np.random.default_rng(0))
    seen = []
    while plant.time < 300.0:
        plant.step(command_of(plant, motion.coordinates(plant.time)), 0.05)
        seen.append(plant.coordinates)
    bend, length = np.hypot(*np.transpose(seen)[:2]), np.transpose(seen)[2]
    assert bend.max() < 1.6
    assert 0.1 < length.min() < length.max() < 0.24
    assert np.ptp(length[-2000:]) > 0.04
