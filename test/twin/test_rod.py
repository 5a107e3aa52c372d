"""The rod against closed forms: energy, its own weight, twist."""

import numpy as np
import pytest

pytest.importorskip('elastica', reason="the twin needs PyElastica, extra 'sim'")

from sesa2.shape.rotations import IDENTITY, conjugate, multiply, to_rotation_vector
from sesa2.twin.rod import GRAVITY, Rod, simulate_rod

DOWN = np.array([1.0, 0.0, 0.0, 0.0])
SIDEWAYS = np.array([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)])


def run(rod, base, seconds, hand=None, torque=None, orientations_at=(0.4,), points_at=(0.66,)):
    return simulate_rod(
        rod,
        base,
        seconds,
        hand,
        orientations_at=np.array(orientations_at),
        points_at=np.array(points_at),
        torque=torque,
    )


def test_a_falling_arm_keeps_its_energy():
    states = run(Rod(damping=0.0), SIDEWAYS, 0.4)
    fall = -states.points[-1, 0, 2]
    assert fall > 0.25
    weight = 1200.0 * np.pi * 0.0125**2 * 0.66 * GRAVITY
    assert np.ptp(states.energies) < 0.01 * weight * 0.5 * fall


def test_a_hanging_arm_stretches_by_its_weight():
    rod = Rod()
    states = run(rod, DOWN, 1.0)
    late = states.times > 0.5  # whole periods of the stretching mode, 4 L / c = 65 ms, nearly
    stretch = rod.density * GRAVITY * rod.length**2 / (2.0 * rod.youngs_modulus)
    assert -states.points[late, 0, 2].mean() - rod.length == pytest.approx(stretch, rel=0.05)
    assert np.abs(states.points[:, 0, :2]).max() < 1e-9


def test_a_torque_twists_as_saint_venant_says():
    rod = Rod()
    hand = (np.array([0.0, 1.0]), np.tile([0.0, 0.0, -rod.hand_position], (2, 1)))
    states = run(
        rod,
        DOWN,
        1.0,
        hand,
        torque=lambda t: 0.03 * min(t / 0.5, 1.0),
        orientations_at=(0.0, 0.24, 0.48, 0.64),
    )
    late = states.times > 0.6
    twist = to_rotation_vector(multiply(conjugate(DOWN), states.orientations[late]))[..., 2].mean(axis=0)
    expected = 0.03 / rod.twisting_stiffness * np.array([0.0, 0.24, 0.48, 0.48])
    np.testing.assert_allclose(twist, expected, atol=0.03 * expected[-1])


def test_orientations_follow_the_tangent_and_points_lie_between_nodes():
    at = np.array([0.085, 0.235, 0.415])
    states = run(Rod(), SIDEWAYS, 0.3, orientations_at=at, points_at=[*(at - 1e-3), *(at + 1e-3)])
    chord = states.points[-1, 3:] - states.points[-1, :3]
    tangent = chord / np.linalg.norm(chord, axis=1, keepdims=True)
    axis = multiply(
        multiply(states.orientations[-1], [0.0, 0.0, 1.0, 0.0]), conjugate(states.orientations[-1])
    )
    np.testing.assert_allclose(axis[:, :3], tangent, atol=1e-2)  # they differ by the shear
    assert states.nodes.shape == (4, 67, 3)


def test_twice_the_elements_give_the_same_arm(monkeypatch):
    coarse = run(Rod(), SIDEWAYS, 0.3, points_at=(0.3, 0.66))
    monkeypatch.setattr('sesa2.twin.rod.ELEMENT_LENGTH', 0.005)
    fine = run(Rod(), SIDEWAYS, 0.3, points_at=(0.3, 0.66))
    assert fine.nodes.shape[1] == 133
    # the clamp holds the whole first element, which is half as long now
    assert np.linalg.norm(coarse.points[-1] - fine.points[-1], axis=1).max() < 4e-3


def test_straight_up_it_stands_while_the_hand_holds_it():
    rod = Rod()
    hand = (np.array([0.0, 1.0]), np.tile([0.0, 0.0, rod.hand_position], (2, 1)))
    states = run(rod, IDENTITY, 0.5, hand)
    assert states.points[-1, 0] == pytest.approx([0.0, 0.0, 0.66], abs=2e-3)
