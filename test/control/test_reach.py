"""What an arm can reach, against the closed inverse and an independent minimiser."""

import numpy as np
import pytest
from looped_arm import racks
from scipy.optimize import minimize

from sesa2.control.reach import Reach, damped_inverse
from sesa2.shape.arm import GeometryError

STRETCH = (0.75, 1.5)


def one(**limits):
    return Reach([0.16], racks(1), 1.6, STRETCH, **limits)


def three(**limits):
    return Reach([0.11, 0.11, 0.11], racks(3), 1.6, (0.95, 1.10), **limits)


def shapes(m, n, rng, rest, stretch, bend=1.5):
    q = np.empty((n, m, 3))
    angle, size = rng.uniform(0, 2 * np.pi, (n, m)), rng.uniform(0, bend, (n, m))
    q[..., 0], q[..., 1] = size * np.cos(angle), size * np.sin(angle)
    q[..., 2] = rest * rng.uniform(*stretch, (n, m))
    return q.reshape(n, -1)


def test_what_is_in_reach_is_reached_by_the_one_arc():
    reach = one()
    for q in shapes(1, 200, np.random.default_rng(0), 0.16, STRETCH):
        found = reach.nearest(reach.tip(q))
        np.testing.assert_allclose(found.coordinates, q, rtol=0, atol=1e-9)
        assert found.left < 1e-9


def test_three_segments_reach_what_is_in_reach():
    reach, rng = three(), np.random.default_rng(1)
    left = [reach.nearest(reach.tip(q)).left for q in shapes(3, 60, rng, 0.11, (0.97, 1.08), 1.2)]
    assert max(left) < 1e-5


TARGETS = [
    (0.0, 0.0, 0.5),
    (0.0, 0.0, 0.05),
    (0.3, 0.0, 0.1),
    (0.0, -0.3, 0.02),
    (0.05, 0.05, 0.3),
    (0.02, 0.0, 0.06),
    (-0.1, 0.1, -0.1),
    (0.0, 0.0, -0.1),
    (0.0, 0.0, 0.0),
]


def by_minimiser(reach, target, m, stretch, rest):
    """The smallest distance that scipy finds from many starts within the same limits."""
    rng, best = np.random.default_rng(2), np.inf
    limits = [
        {'type': 'ineq', 'fun': lambda q, k=k: 1.6**2 - q[3 * k] ** 2 - q[3 * k + 1] ** 2} for k in range(m)
    ]
    bounds = [(-1.6, 1.6), (-1.6, 1.6), (stretch[0] * rest, stretch[1] * rest)] * m
    for start in shapes(m, 8, rng, rest, stretch):
        done = minimize(
            lambda q: 1e3 * np.sum((reach.tip(q) - target) ** 2),
            start,
            constraints=limits,
            bounds=bounds,
            method='SLSQP',
            options={'maxiter': 300, 'ftol': 1e-12},
        )
        best = min(best, float(np.linalg.norm(reach.tip(reach.within(done.x)) - target)))
    return best


@pytest.mark.parametrize('target', TARGETS)
def test_what_is_out_of_reach_is_approached_as_near_as_can_be(target):
    reach = one()
    found = reach.nearest(target)
    np.testing.assert_allclose(
        found.left, np.linalg.norm(reach.tip(found.coordinates) - target), rtol=0, atol=1e-12
    )
    assert found.left <= by_minimiser(reach, np.array(target), 1, STRETCH, 0.16) + 1e-6
    bend_x, bend_y, length = found.coordinates
    assert np.hypot(bend_x, bend_y) <= 1.6 + 1e-12
    assert 0.12 - 1e-12 <= length <= 0.24 + 1e-12


@pytest.mark.parametrize('target', [(0.0, 0.0, 0.6), (0.5, 0.1, 0.0), (0.02, 0.01, 0.1), (-0.2, 0.3, -0.1)])
def test_three_segments_come_about_as_near_as_a_minimiser(target):
    reach = three()
    left = reach.nearest(target).left
    assert left <= by_minimiser(reach, np.array(target), 3, (0.95, 1.10), 0.11) + 2e-3


def test_no_backbone_goes_beyond_its_limits():
    reach = one(length_limits=(0.1, 0.2))
    for target in TARGETS:
        lengths = reach.backbone_lengths(reach.nearest(target).coordinates)
        assert lengths.min() >= 0.1 - 1e-12
        assert lengths.max() <= 0.2 + 1e-12


def test_without_limits_of_their_own_backbones_keep_those_of_the_segments():
    """0.24 m at most and 1.6 rad at a radius of 30 mm: 0.288 m; what is commanded beyond is drawn back."""
    reach = one()
    far = reach.driveable(np.array([3.0, 0.0, 0.5]))
    lengths = reach.backbone_lengths(far)
    assert lengths.max() == pytest.approx(0.24 + 0.03 * 1.6, abs=1e-12)
    inside = np.array([1.6, 0.0, 0.24])
    np.testing.assert_array_equal(reach.driveable(inside), inside)


def test_limits_that_leave_nothing_are_refused():
    with pytest.raises(GeometryError, match='leave no length'):
        one(length_limits=(0.3, 0.4))


def test_the_damped_inverse_is_least_squares():
    rng = np.random.default_rng(3)
    J, scale, v = rng.normal(size=(3, 9)), rng.uniform(0.1, 1.0, 9), rng.normal(size=3)
    # The minimum of |J u − v|² + λ² |u / scale|², by the normal equations.
    expected = np.linalg.solve(J.T @ J + 0.01**2 * np.diag(scale**-2.0), J.T @ v)
    np.testing.assert_allclose(damped_inverse(J, scale, 0.01) @ v, expected, rtol=1e-6)
