"""Rotations against scipy, and near the places where formulas break."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from sesa2.shape import rotations

ANGLES = [0.0, 1e-300, 1e-160, 1e-12, 1e-8, 9.9e-4, 1e-3, 1.01e-3, 0.1, 1.0, 3.0, np.pi - 1e-6, np.pi - 1e-12]


@pytest.fixture
def rng():
    return np.random.default_rng(20)


def random_quaternions(rng, *shape):
    return rotations.normalize(rng.normal(size=(*shape, 4)))


def same_rotation(p, q):
    return np.minimum(np.abs(p - q).max(axis=-1), np.abs(p + q).max(axis=-1))


def test_product_and_rotation_agree_with_scipy(rng):
    p, q = random_quaternions(rng, 7, 5), random_quaternions(rng, 7, 5)
    v = rng.normal(size=(7, 5, 3))
    P, Q = Rotation.from_quat(p.reshape(-1, 4)), Rotation.from_quat(q.reshape(-1, 4))
    assert same_rotation(rotations.multiply(p, q).reshape(-1, 4), (P * Q).as_quat()).max() < 1e-15
    np.testing.assert_allclose(rotations.rotate(q, v).reshape(-1, 3), Q.apply(v.reshape(-1, 3)), atol=1e-14)
    np.testing.assert_allclose(rotations.tangent(q).reshape(-1, 3), Q.as_matrix()[:, :, 2], atol=1e-15)
    np.testing.assert_allclose(rotations.to_matrix(q).reshape(-1, 3, 3), Q.as_matrix(), atol=1e-15)
    np.testing.assert_allclose(
        rotations.multiply(q, rotations.conjugate(q)),
        np.broadcast_to(rotations.IDENTITY, q.shape),
        atol=1e-15,
    )


@pytest.mark.parametrize('angle', ANGLES)
def test_exponential_and_logarithm_near_zero_and_pi(rng, angle):
    axis = rng.normal(size=(50, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    v = angle * axis
    q = rotations.from_rotation_vector(v)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-15)
    assert same_rotation(q, Rotation.from_rotvec(v).as_quat()).max() < 1e-15
    signs = rng.choice([-1.0, 1.0], size=(50, 1))
    back = rotations.to_rotation_vector(signs * q)
    # Close to π the axis itself is only known to the quaternion's last digit, and its sign flips at π.
    np.testing.assert_allclose(back, v, rtol=1e-12, atol=4e-15)


@pytest.mark.parametrize('angle', ANGLES)
def test_slerp_agrees_with_scipy_whatever_the_signs(rng, angle):
    a = random_quaternions(rng, 40)
    axis = rng.normal(size=(40, 3))
    axis *= angle / np.linalg.norm(axis, axis=1)[:, None]
    b = rotations.multiply(rotations.from_rotation_vector(axis), a)
    t = rng.uniform(size=40)
    got = rotations.slerp(a, rng.choice([-1.0, 1.0], size=(40, 1)) * b, t)
    for i in range(40):
        expected = Slerp([0.0, 1.0], Rotation.from_quat([a[i], b[i]]))(t[i]).as_quat()
        assert same_rotation(got[i], expected) < 1e-11
    np.testing.assert_allclose(np.linalg.norm(got, axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize('angle', [*ANGLES, np.pi])
@pytest.mark.parametrize('batch', [(), (3,)])
def test_slerp_along_is_slerp_from_station_to_station(rng, angle, batch):
    stations = np.empty((*batch, 6, 4))
    stations[..., 0, :] = random_quaternions(rng, *batch)
    for i in range(5):
        axis = rng.normal(size=(*batch, 3))
        axis *= angle / np.linalg.norm(axis, axis=-1)[..., None]
        turned = rotations.multiply(rotations.from_rotation_vector(axis), stations[..., i, :])
        stations[..., i + 1, :] = rng.choice([-1.0, 1.0], size=(*batch, 1)) * turned
    section = np.array([0, 0, 0, 0, 1, 2, 2, 4, 4, 4, 4])
    fraction = np.array([0.0, 0.1, 0.3, 0.9, 0.5, 1 / 3, 2 / 3, 0.125, 0.1, 0.875, 1.0])
    got = rotations.slerp_along(stations, rotations.SlerpPlaces(section, fraction))
    expected = rotations.slerp(stations[..., section, :], stations[..., section + 1, :], fraction)
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-15)
    if angle < 3.1:  # beyond, the quaternions' last digits decide which way round
        for at in np.ndindex(batch):
            for i, (k, t) in enumerate(zip(section, fraction, strict=True)):
                ends = Rotation.from_quat(stations[at][k : k + 2])
                assert same_rotation(got[at][i], Slerp([0.0, 1.0], ends)(t).as_quat()) < 1e-11


@pytest.mark.parametrize('n', [1, 2, 7, 8, 100])
def test_the_middles_of_equal_links_need_one_sine_each(n):
    places = rotations.SlerpPlaces(
        np.repeat([0, 1, 2], n), np.tile((2.0 * np.arange(n) + 1.0) / (2.0 * n), 3)
    )
    assert len(places.sine_fraction) == 3 * n
    np.testing.assert_allclose(
        places.sine_fraction[places.of_b], np.tile((np.arange(n) + 0.5) / n, 3), rtol=0.0, atol=1e-15
    )
    np.testing.assert_allclose(
        places.sine_fraction[places.of_a] + places.sine_fraction[places.of_b], 1.0, rtol=0.0, atol=2e-15
    )
    assert (places.sine_section[places.of_a] == places.section).all()
    assert (places.sine_section[places.of_b] == places.section).all()


def test_swing_takes_a_onto_b_by_the_least_angle(rng):
    a, b = rng.normal(size=(2, 200, 3))
    a /= np.linalg.norm(a, axis=1)[:, None]
    b /= np.linalg.norm(b, axis=1)[:, None]
    b[0], b[1] = a[0], -a[1]
    q = rotations.swing(a, b)
    np.testing.assert_allclose(rotations.rotate(q, a), b, atol=1e-7)
    angle = np.linalg.norm(rotations.to_rotation_vector(q), axis=1)
    np.testing.assert_allclose(angle, np.arccos(np.clip(np.sum(a * b, axis=1), -1, 1)), atol=1e-7)


def test_aim_is_the_swing_of_the_z_axis(rng):
    q, direction = rng.normal(size=(200, 4)), rng.normal(size=(200, 3))
    direction[0] = rotations.tangent(rotations.normalize(q[0]))
    got = rotations.aim(q, direction)
    q = rotations.normalize(q)
    swing = Rotation.from_quat(rotations.swing(rotations.tangent(q), direction))
    expected = (swing * Rotation.from_quat(q)).as_matrix()
    np.testing.assert_allclose(Rotation.from_quat(got).as_matrix(), expected, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(got, axis=1), 1.0, atol=1e-12)


def test_aim_survives_opposite_and_vanishing_directions(rng):
    q = rotations.normalize(rng.normal(size=(2, 4)))
    opposite = -rotations.tangent(q)
    got = rotations.aim(q, opposite)
    np.testing.assert_allclose(rotations.tangent(got), opposite, atol=1e-12)
    np.testing.assert_array_equal(rotations.aim(q, np.zeros(3)), q)


def test_of_one_sign_turns_signs_only(rng):
    q = rotations.normalize(rng.normal(size=(5, 9, 4)))
    got = rotations.of_one_sign(q)
    assert (np.sum(got[:, 1:] * got[:, :-1], axis=-1) >= 0.0).all()
    np.testing.assert_array_equal(np.abs(got), np.abs(q))
    np.testing.assert_allclose(np.abs(np.sum(got * q, axis=-1)), 1.0, atol=1e-12)


@pytest.mark.parametrize('angle', ANGLES)
def test_quaternion_of_a_matrix(rng, angle):
    axes = np.concatenate([np.eye(3), -np.eye(3), rng.normal(size=(200, 3))])
    turn = Rotation.from_rotvec(angle * axes / np.linalg.norm(axes, axis=1, keepdims=True))
    q = rotations.from_matrix(turn.as_matrix())
    assert q.shape == (206, 4)
    np.testing.assert_allclose((Rotation.from_quat(q) * turn.inv()).magnitude(), 0.0, atol=1e-15)
    assert rotations.from_matrix(np.eye(3)).shape == (4,)
