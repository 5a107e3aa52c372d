"""Arcs against scipy's rotations, the exact model and their own inverse."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sesa2.shape.arm import Arm, GeometryError
from sesa2.shape.kinematics.constant_curvature import ConstantCurvature, arc_to
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model
from sesa2.shape.rotations import to_matrix

assert_close = partial(np.testing.assert_allclose, rtol=0.0)  # atol alone says how close

LENGTHS = (0.11, 0.14, 0.08)
ENDS = np.cumsum(LENGTHS)
S = np.linspace(0.0, ENDS[-1], 23)
magnitudes = st.one_of(st.just(0.0), st.floats(1e-12, 1e-3), st.floats(1e-3, 6.2))


def rotation_products(q):
    """scipy's rotations at the ends of the segments."""
    turns, now = [], Rotation.identity()
    for bend_x, bend_y, _ in q.reshape(-1, 3):
        now = now * Rotation.from_rotvec([-bend_y, bend_x, 0.0])
        turns.append(now)
    return Rotation.concatenate(turns)


def test_a_quarter_circle_towards_x_and_one_towards_y():
    arm = ConstantCurvature([0.2])
    radius = 0.2 / (np.pi / 2)
    x, y = arm.backbone([[np.pi / 2, 0.0, 0.2], [0.0, np.pi / 2, 0.2]]).positions([0.2])[:, 0]
    assert_close(x, [radius, 0.0, radius], atol=1e-15)
    assert_close(y, [0.0, radius, radius], atol=1e-15)
    tip = arm.backbone([np.pi / 2, 0.0, 0.2]).orientations([0.2])[0]
    assert_close(Rotation.from_quat(tip).apply([0, 0, 1]), [1, 0, 0], atol=1e-15)


@pytest.mark.parametrize('size', [0.0, 1e-8, 0.4, 1.5])
def test_against_rotation_products_and_the_exact_model(size):
    kinematics = ConstantCurvature(LENGTHS)
    rng = np.random.default_rng(1)
    for _ in range(20):
        q = kinematics.rest.copy().reshape(-1, 3)
        q[:, :2] = size * rng.uniform(-1, 1, (3, 2))
        backbone, ends = kinematics.backbone(q.ravel()), rotation_products(q)
        assert_close(to_matrix(backbone.orientations(ENDS)), ends.as_matrix(), atol=1e-14)
        exact = create_model('pcc_exact', Layout(Arm(ENDS[-1]), tuple(ENDS))).fit(Measured(ends.as_quat()))
        assert_close(backbone.positions(S), exact.positions(S), atol=1e-14)
        assert_close(to_matrix(backbone.orientations(S)), to_matrix(exact.orientations(S)), atol=1e-14)


def test_both_sides_of_the_series_border_agree():
    arm = ConstantCurvature([1.0])
    for direction in (0.0, 0.7, 2.0, 4.0):
        below, above = (
            arm.jacobian([(1.0 + e) * np.cos(direction), (1.0 + e) * np.sin(direction), 1.0], [1.0])
            for e in (-1e-14, 1e-14)
        )
        assert_close(below, above, atol=2e-14)


def test_rates_keep_their_digits_near_straight():
    """∂z/∂bend vanishes with the bend; divided by it, it is a series that starts with −1/3."""
    bend = np.logspace(-150, -1, 300)
    q = np.stack([bend, 0 * bend, np.ones_like(bend)], axis=-1)
    s = bend**2
    series = -1 / 3 + s / 30 - s**2 / 840 + s**3 / 45360
    np.testing.assert_allclose(
        ConstantCurvature([1.0]).jacobian(q, [1.0])[:, 0, 2, 0] / bend, series, rtol=1e-14
    )


@given(magnitudes, st.floats(-np.pi, np.pi), st.floats(0.01, 1.0))
def test_inverse_of_forward(magnitude, azimuth, length):
    q = np.array([magnitude * np.cos(azimuth), magnitude * np.sin(azimuth), length])
    tip = ConstantCurvature([length]).backbone(q).positions([length])[0]
    # Towards a whole turn the tip comes back to the clamp and the inverse is as ill conditioned as 1 / chord².
    tolerance = 1e-14 * (length / np.linalg.norm(tip)) ** 2
    np.testing.assert_allclose(arc_to(tip), q, rtol=10 * tolerance, atol=10 * tolerance)


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(0.01, 0.4))
def test_forward_of_inverse(x, y, z):
    q = arc_to([x, y, z])
    assert 0.0 <= np.hypot(q[0], q[1]) < np.pi
    np.testing.assert_allclose(
        ConstantCurvature([1.0]).backbone(q).positions([1.0])[0], [x, y, z], atol=1e-15, rtol=1e-13
    )


def test_inverse_near_straight_and_below_the_base():
    np.testing.assert_array_equal(arc_to([0.0, 0.0, 0.3]), [0.0, 0.0, 0.3])
    np.testing.assert_allclose(arc_to([1e-200, 0.0, 0.5]), [4e-200, 0.0, 0.5], rtol=1e-15)
    np.testing.assert_allclose(arc_to([0.2, 0.0, 0.0]), [np.pi, 0.0, 0.1 * np.pi], rtol=1e-15)
    below = arc_to([[0.0, 0.1, -0.1], [-0.1, 0.0, -0.1]])
    np.testing.assert_allclose(below[0], [0.0, 1.5 * np.pi, 1.5 * np.pi * 0.1], rtol=1e-14, atol=1e-15)
    assert below.shape == (2, 3)
    np.testing.assert_allclose(below[1, :2], [-1.5 * np.pi, 0.0], rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize(
    'point', [[0.0, 0.0, 0.0], [0.0, 0.0, -0.1], [np.nan, 0.0, 0.1], [0.1, np.inf, 0.1], [1e-320, 0.0, -0.1]]
)
def test_points_that_no_arc_reaches(point):
    with pytest.raises(GeometryError, match='no arc from the origin'):
        arc_to([[0.0, 0.0, 0.1], point])


def test_inverse_wants_points():
    with pytest.raises(GeometryError, match=r'points of shape \(2,\), expected \(\.\.\., 3\)'):
        arc_to([0.1, 0.2])
