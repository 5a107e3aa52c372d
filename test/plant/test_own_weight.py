"""What the weight does to an arm: against the cantilever of the textbooks, and where it must lead."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.plant.own_weight import OwnWeight
from sesa2.plant.uneven_segments import UnevenSegments

# Along x of the world, its own x pointing down.
LYING = Rotation.from_rotvec([0.0, np.pi / 2.0, 0.0]).as_quat()
HANGING = np.array([1.0, 0.0, 0.0, 0.0])
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


@pytest.mark.parametrize('lengths', [[0.16], [0.1, 0.1, 0.1], [0.2, 0.05]])
def test_a_cantilever_turns_its_tip_by_the_sag(lengths):
    rest = np.array(lengths)
    bends = OwnWeight(rest, 0.2, LYING).bends(np.zeros((len(rest), 2)), rest)
    np.testing.assert_allclose(bends.sum(axis=0), [0.2, 0.0], atol=1e-12)
    assert (np.diff(bends[:, 0] / rest) < 0.0).all()  # the curvature falls towards the tip


def test_it_grows_with_the_square_of_the_length_that_is_out():
    [bend] = OwnWeight(np.array([0.16]), 0.1, LYING).bends(np.zeros((1, 2)), np.array([0.24]))
    np.testing.assert_allclose(bend, [0.1 * 1.5**2, 0.0], atol=1e-12)


def test_upright_it_bends_more_hanging_less_and_straight_not_at_all():
    rest, bent = np.array([0.1, 0.1]), np.array([[0.3, -0.4], [0.2, 0.1]])
    for base, sign in ((UPRIGHT, 1.0), (HANGING, -1.0)):
        weight = OwnWeight(rest, 0.2, base)
        np.testing.assert_allclose(weight.bends(np.zeros((2, 2)), rest), 0.0, atol=1e-15)
        assert sign * np.sum(bent[0] * weight.bends(bent, rest)[0]) > 0.01


@pytest.mark.parametrize('seed', range(5))
def test_giving_way_lowers_the_arm(seed):
    rng = np.random.default_rng(seed)
    base, rest = Rotation.random(random_state=seed), np.array([0.12, 0.1, 0.08])
    bends, lengths = rng.normal(0.0, 0.5, (3, 2)), rest * rng.uniform(0.8, 1.4, 3)
    all_along = UnevenSegments(rest, np.zeros(3), np.zeros(3), np.linspace(0.0, 0.3, 61))

    def height(b):
        return base.apply(all_along.poses(b, lengths)[0])[:, 2].mean()

    added = OwnWeight(rest, 0.1, base.as_quat()).bends(bends, lengths)
    assert height(bends + 1e-3 * added) < height(bends)
