"""Joint angles against scipy's Euler angles, and through the singularity."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.shape.joints import hold_x, joint_angles, link_orientations
from sesa2.shape.rotations import IDENTITY, normalize

BASE = normalize(np.array([0.1, -0.4, 0.2, 0.7]))


def matrices(q):
    return Rotation.from_quat(q.reshape(-1, 4)).as_matrix()


def test_angles_are_scipys_intrinsic_xzy():
    q = normalize(np.random.default_rng(3).normal(size=(100, 4)))
    expected = Rotation.from_quat(q).as_euler('XZY')
    angles = np.concatenate([joint_angles(one[None], IDENTITY).angles for one in q])
    np.testing.assert_allclose(angles, expected, atol=1e-9)


def test_the_joints_lead_back_to_the_links():
    rng = np.random.default_rng(4)
    q = normalize(rng.normal(size=(64, 4)))
    joints = joint_angles(q, BASE)
    assert not joints.singular.any()
    np.testing.assert_allclose(matrices(link_orientations(joints.angles, BASE)), matrices(q), atol=1e-9)


def test_a_batch_is_its_members():
    q = normalize(np.random.default_rng(5).normal(size=(4, 6, 4)))
    together = joint_angles(q, BASE)
    for i in range(4):
        np.testing.assert_array_equal(together.angles[i], joint_angles(q[i], BASE).angles)


@pytest.mark.parametrize('batch', [(), (5,)])
def test_chains_one_after_the_other_are_each_chain_alone(batch):
    rng = np.random.default_rng(6)
    base = normalize(rng.normal(size=(*batch, 4)))
    chains = [normalize(rng.normal(size=(*batch, n, 4))) for n in (8, 1, 64)]
    together = joint_angles(np.concatenate(chains, axis=-2), base, [0, 8, 9])
    alone = [joint_angles(chain, base) for chain in chains]
    angles = np.concatenate([one.angles for one in alone], axis=-2)
    np.testing.assert_allclose(together.angles, angles, rtol=0.0, atol=1e-13)
    cosine = np.concatenate([one.cosine for one in alone], axis=-1)
    np.testing.assert_allclose(together.cosine, cosine, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize('off', [1e-1, 1e-3, 1e-5, 1e-7, 1e-8])
@pytest.mark.parametrize('side', [1.0, -1.0])
def test_near_the_singularity_the_rotation_is_still_exact(off, side):
    rng = np.random.default_rng(7)
    q = Rotation.from_euler(
        'XZY',
        np.stack(
            [rng.uniform(-3, 3, 50), np.full(50, side * (np.pi / 2 - off)), rng.uniform(-3, 3, 50)], axis=1
        ),
    ).as_quat()
    for one in q:
        joints = joint_angles(one[None], IDENTITY)
        assert not joints.singular.any()
        np.testing.assert_allclose(joints.cosine, np.sin(off), rtol=1e-6, atol=3e-16)
        np.testing.assert_allclose(joints.angles[0, 1], side * (np.pi / 2 - off), rtol=0.0, atol=1e-15)
        there = link_orientations(joints.angles, IDENTITY)
        np.testing.assert_allclose(matrices(there), matrices(one), rtol=0.0, atol=3e-15)


@pytest.mark.parametrize('angle', [0.0, 1e-300, 1e-12, 1e-8, 1e-3])
def test_small_joint_angles_keep_their_digits(angle):
    angles = angle * np.random.default_rng(8).normal(size=(20, 3))
    got = joint_angles(link_orientations(angles, IDENTITY), IDENTITY).angles
    np.testing.assert_allclose(got, angles, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize('z', [np.pi / 2, -np.pi / 2])
@pytest.mark.parametrize('kept', [0.0, 0.3, -2.9])
def test_at_the_singularity_x_is_held_and_the_rotation_is_right(z, kept):
    q = Rotation.from_euler('XZY', [[0.7, z, -0.4]]).as_quat()
    joints = joint_angles(q, IDENTITY)
    assert joints.singular.all()
    np.testing.assert_allclose(matrices(link_orientations(joints.angles, IDENTITY)), matrices(q), atol=1e-7)
    held = hold_x(joints, np.array([[kept, 0.0, 0.0]]))
    assert held[0, 0] == kept
    np.testing.assert_allclose(matrices(link_orientations(held, IDENTITY)), matrices(q), atol=1e-7)
