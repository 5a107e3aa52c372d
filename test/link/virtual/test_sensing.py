import numpy as np
from scipy.spatial.transform import Rotation

from sesa2.link.virtual.virtual_arm import VirtualArm, accelerations, angular_velocities, magnetic_fields

RNG = np.random.default_rng(0)


def random_quaternions(*shape):
    q = RNG.normal(size=(*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


LINKS, MOUNTS = random_quaternions(3), random_quaternions(3)


def still(t):
    return np.broadcast_to(LINKS, (*np.shape(t), 3, 4))


def test_heading_link_and_mounting_in_this_order():
    headings = np.array([0.1, -0.2, 3.0])
    arm = VirtualArm((2, 4, 5), still, mount_orientations=MOUNTS, headings=headings)
    got = arm.orientations((4, 5), np.zeros(2), np.array([0.0, 0.5]))
    for k, row in enumerate((1, 2)):
        turn = Rotation.from_euler('z', headings[row] + (0.0, 0.5)[k])
        expected = turn * Rotation.from_quat(LINKS[row]) * Rotation.from_quat(MOUNTS[row])
        assert (expected.inv() * Rotation.from_quat(got[k])).magnitude() < 1e-12


def test_each_imu_at_its_own_time():
    def turning(t):
        angle = np.asarray(t)[..., np.newaxis] * (1, 2, 3)
        return np.stack([np.sin(angle / 2), 0 * angle, 0 * angle, np.cos(angle / 2)], axis=-1)

    t = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    got = VirtualArm((1, 2, 3), turning).orientations((1, 2, 3), t, np.zeros(3))
    assert got.shape == (2, 3, 4)
    np.testing.assert_allclose(got[..., 0], np.sin(t * (1, 2, 3) / 2), atol=1e-12)


def test_random_signs():
    arm = VirtualArm((1, 2, 3), still, random_signs=True)
    got = arm.orientations((1, 2, 3), np.zeros((50, 3)), np.zeros(3))
    signs = np.sum(got * LINKS, axis=-1)
    np.testing.assert_allclose(np.abs(signs), 1, atol=1e-12)
    assert 40 < np.sum(signs > 0) < 110


def test_gravity_in_the_sensors_frame():
    expected = Rotation.from_quat(LINKS).inv().apply([0, 0, 9.80665])
    np.testing.assert_allclose(accelerations(LINKS), expected, atol=1e-12)


def test_north_and_down_in_the_sensors_frame():
    expected = Rotation.from_quat(LINKS).inv().apply([0, 20e-6, -45e-6])
    np.testing.assert_allclose(magnetic_fields(LINKS), expected, atol=1e-18)


def test_angular_velocity_is_in_the_sensors_axes_whatever_the_signs_of_its_quaternions():
    w = RNG.normal(size=(3, 3))
    after = (Rotation.from_quat(LINKS) * Rotation.from_rotvec(0.002 * w)).as_quat()
    np.testing.assert_allclose(angular_velocities(LINKS, -after, 0.002), w, rtol=0, atol=1e-9)
