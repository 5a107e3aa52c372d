"""Velocities of joints against derivatives of known motions."""

from itertools import pairwise

import numpy as np

from sesa2.estimation.joint_velocities import GAP_NS, JointVelocities

STAMPS = 1_700_000_000_000_000_000 + 10_000_000 * np.arange(200)


def turning(rates, stamps=STAMPS):
    """Joints that turn evenly, angles within ±π, and links that grow by 0.03 m/s."""
    t = (stamps - stamps[0]) / 1e9
    angles = 0.3 + t[:, None] * rates
    joints = np.empty((len(t), len(rates), 4))
    joints[..., :3] = np.arctan2(np.sin(angles), np.cos(angles))[..., None]
    joints[..., 3] = 0.1 + 0.03 * t[:, None]
    return joints


def test_even_turns_have_their_rate_through_half_a_turn():
    rates = np.array([20.0, -35.0, 0.0])
    got = JointVelocities().of(STAMPS, turning(rates))
    assert np.isnan(got[0]).all()
    np.testing.assert_allclose(got[1:, :, :3], np.broadcast_to(rates[:, None], (199, 3, 3)), atol=1e-9)
    np.testing.assert_allclose(got[1:, :, 3], 0.03, atol=1e-12)


def test_in_pieces_as_in_one_and_it_looks_back_only():
    joints = np.random.default_rng(1).uniform(-np.pi, np.pi, (200, 5, 3))
    whole = JointVelocities().of(STAMPS, joints)
    pieces = JointVelocities()
    cuts = [0, 1, 2, 50, 51, 199, 200]
    got = [pieces.of(STAMPS[a:b], joints[a:b]) for a, b in pairwise(cuts)]
    np.testing.assert_array_equal(np.concatenate(got), whole)
    np.testing.assert_array_equal(JointVelocities().of(STAMPS[:77], joints[:77]), whole[:77])
    kept = joints.copy()
    again = JointVelocities()
    first = again.of(STAMPS[:1], kept[:1])
    kept[:] = 9.0  # what was handed over may change
    np.testing.assert_array_equal(again.of(STAMPS[1:2], joints[1:2]), whole[1:2])
    assert np.isnan(first).all()


def test_after_a_gap_and_after_a_step_back_nothing_is_known():
    stamps = STAMPS[0] + np.array([0, 10, 10 + GAP_NS // 10**6, 11 + 2 * GAP_NS // 10**6, 5, 15, 15]) * 10**6
    got = JointVelocities().of(stamps, turning(np.array([1.0]), stamps))
    assert np.isnan(got[:, 0, 0]).tolist() == [True, False, False, True, True, False, True]


def test_a_length_is_no_angle():
    joints = np.zeros((2, 1, 4))
    joints[1, 0, 3] = 5.0  # beyond half a turn, were it one
    np.testing.assert_allclose(JointVelocities().of(STAMPS[:2], joints)[1, 0, 3], 500.0)
