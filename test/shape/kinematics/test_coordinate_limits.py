"""Limits of coordinates: what is clipped, and what is drawn."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sesa2.shape.arm import GeometryError
from sesa2.shape.kinematics import create_kinematics
from sesa2.shape.kinematics.coordinate_limits import CoordinateLimits

PCC = CoordinateLimits(create_kinematics('pcc', [0.1, 0.2]), 1.2, (0.9, 1.1))
AFFINE = CoordinateLimits(create_kinematics('affine', [0.1]), 1.2, (0.9, 1.1))


def test_bends_keep_their_direction_and_lengths_their_span():
    clipped = PCC.clip(np.array([3.0, -4.0, 0.05, 0.3, 0.4, 0.5]))
    np.testing.assert_allclose(clipped, [0.72, -0.96, 0.09, 0.3, 0.4, 0.22])
    np.testing.assert_allclose(AFFINE.clip(np.array([0.0, 2.0, 0.0, 2.0, 0.1])), [0, 1.2, 0, 2.0, 0.1])
    np.testing.assert_allclose(AFFINE.clip(np.array([0.0, 2.0, 0.0, -9.0, 0.1])), [0, 1.2, 0, -2.4, 0.1])


def test_scales():
    np.testing.assert_allclose(PCC.scales, [1.2, 1.2, 0.02, 1.2, 1.2, 0.04])
    np.testing.assert_allclose(AFFINE.scales, [1.2, 1.2, 2.4, 2.4, 0.02])
    assert CoordinateLimits(PCC.kinematics, 1.0, (1.0, 1.0)).scales.min() > 0.0


@given(st.lists(st.floats(-10, 10), min_size=6, max_size=6))
def test_clipping_twice_is_clipping_once(q):
    once = PCC.clip(np.array(q))
    np.testing.assert_allclose(PCC.clip(once), once, rtol=1e-15)


@pytest.mark.parametrize('limits', [PCC, AFFINE])
def test_what_is_drawn_fills_the_limits(limits):
    q = limits.draw(3000, np.random.default_rng(0))
    np.testing.assert_allclose(limits.clip(q), q, rtol=1e-12)
    bend = np.hypot(q[:, 0], q[:, 1])
    assert 0.25 < np.mean(bend > 1.2 * (1 - 1e-9)) < 0.42
    assert bend.min() < 0.1
    np.testing.assert_allclose(
        [q[:, -1].min(), q[:, -1].max()],
        [0.9 * limits.kinematics.rest[-1], 1.1 * limits.kinematics.rest[-1]],
        rtol=2e-3,
    )


@pytest.mark.parametrize(
    ('bend_max', 'stretch', 'message'),
    [(0.0, (0.9, 1.1), 'bend_max = 0.0 rad'), (1.0, (1.1, 0.9), 'stretch'), (1.0, (0.0, 1.0), 'stretch')],
)
def test_limits_that_cannot_be(bend_max, stretch, message):
    with pytest.raises(GeometryError, match=message):
        CoordinateLimits(PCC.kinematics, bend_max, stretch)


def test_the_way_out():
    inside, at = np.array([0.5, 0.5, 0.1, 0.0, 0.0, 0.2]), np.array([0.72, -0.96, 0.09, 0.3, 0.4, 0.22])
    assert PCC.outward(inside[None]) is None
    outward = PCC.outward(np.stack([inside, at]))
    assert (outward[0] == 0.0).all()
    np.testing.assert_allclose(
        outward[1],
        [[0.6, -0.8, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0], [0, 0, -1, 0, 0, 0], [0, 0, 0, 0, 0, 1]],
        atol=1e-12,
    )
