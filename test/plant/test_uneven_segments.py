"""The true shape of the simulated arm, against the families of shapes and against integrating its curvature."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from sesa2.plant.uneven_segments import UnevenSegments
from sesa2.shape.arm import GeometryError
from sesa2.shape.kinematics import create_kinematics

REST = np.array([0.1, 0.16, 0.07])
PLACES = np.array([0.0, 0.03, 0.1, 0.19, 0.26, 0.3, 0.33])
RNG = np.random.default_rng(3)
BENDS, LENGTHS = RNG.normal(0.0, 0.8, (7, 3, 2)), REST * RNG.uniform(0.7, 1.5, (7, 3))
BENDS[0] = 0.0
BENDS[1, 1] = 1e-12


def difference_of_turns(a, b):
    return np.abs(np.sum(a * b, axis=-1)) - 1.0


def test_an_even_one_is_of_constant_curvature():
    q = np.concatenate([BENDS, LENGTHS[..., None]], axis=-1).reshape(7, 9)
    arcs = create_kinematics('pcc', REST).backbone(q)
    positions, orientations = UnevenSegments(REST, np.zeros(3), np.zeros(3), PLACES).poses(BENDS, LENGTHS)
    np.testing.assert_allclose(positions, arcs.positions(PLACES), atol=1e-12)
    np.testing.assert_allclose(difference_of_turns(orientations, arcs.orientations(PLACES)), 0.0, atol=1e-12)


def test_an_affine_one_is_of_affine_curvature():
    a = np.array([0.4, -0.3, 0.9])
    q = np.concatenate([BENDS, -2.0 * a[:, None] * BENDS, LENGTHS[..., None]], axis=-1).reshape(7, 15)
    affine = create_kinematics('affine', REST).backbone(q)
    positions, orientations = UnevenSegments(REST, a, np.zeros(3), PLACES).poses(BENDS, LENGTHS)
    np.testing.assert_allclose(positions, affine.positions(PLACES), atol=1e-10)
    np.testing.assert_allclose(
        difference_of_turns(orientations, affine.orientations(PLACES)), 0.0, atol=1e-10
    )


def test_curvature_is_what_is_said_of_it():
    a, c, length, bend = 0.3, -0.4, 0.2, np.array([0.9, -1.1])

    def moved(s, state):
        v = s / length
        kx, ky = bend / length * (1 + a * (1 - 2 * v) + c * (1 - 6 * v + 6 * v * v))
        frame = state[3:].reshape(3, 3)
        turning = np.array([[0, 0, kx], [0, 0, ky], [-kx, -ky, 0]])  # the cross product with (−ky, kx, 0)
        return np.concatenate([frame[:, 2], (frame @ turning).ravel()])

    start = np.concatenate([np.zeros(3), np.eye(3).ravel()])
    solved = solve_ivp(moved, (0.0, length), start, rtol=1e-11, atol=1e-12, t_eval=[0.0625, 0.2]).y.T
    segment = UnevenSegments([0.16], [a], [c], [0.05, 0.16])
    positions, orientations = segment.poses(bend[None], np.array([length]))
    np.testing.assert_allclose(positions, solved[:, :3], atol=1e-9)
    frames = Rotation.from_quat(orientations).as_matrix()
    np.testing.assert_allclose(frames, solved[:, 3:].reshape(2, 3, 3), atol=1e-8)
    # However it is distributed, the tip has turned by the bend.
    assert Rotation.from_quat(orientations[-1]).magnitude() == pytest.approx(np.hypot(*bend), abs=1e-12)


def test_a_place_beyond_the_tip_is_refused():
    with pytest.raises(GeometryError, match='arc length 0'):
        UnevenSegments([0.16], [0.0], [0.0], [0.17])
