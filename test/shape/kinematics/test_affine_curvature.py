"""Linear curvature against the frame's equation, the clothoid's closed form and arcs."""

from functools import partial
from itertools import product

import numpy as np
import pytest
from frame_oracle import along, differences
from scipy.special import fresnel

from sesa2.shape.kinematics.affine_curvature import AffineCurvature
from sesa2.shape.kinematics.constant_curvature import ConstantCurvature
from sesa2.shape.rotations import conjugate, multiply, to_matrix, to_rotation_vector

assert_close = partial(np.testing.assert_allclose, rtol=0.0)  # atol alone says how close

V = np.linspace(0.0, 1.0, 12)


@pytest.fixture
def segment():
    return AffineCurvature([1.0])


def test_without_slope_it_is_constant_curvature():
    lengths = [0.11, 0.14]
    arcs, affine = ConstantCurvature(lengths), AffineCurvature(lengths)
    rng, s = np.random.default_rng(1), np.linspace(0.0, 0.25, 9)
    q = arcs.rest + rng.uniform(-1.5, 1.5, (50, 6)) * np.tile([1.0, 1.0, 0.02], 2)
    same = np.zeros((50, 2, 5))
    same[..., [0, 1, 4]] = q.reshape(50, 2, 3)
    a, b = arcs.backbone(q), affine.backbone(same.reshape(50, 10))
    assert_close(b.positions(s), a.positions(s), atol=1e-12)
    assert_close(to_matrix(b.orientations(s)), to_matrix(a.orientations(s)), atol=1e-11)
    shared = b.jacobian(s).reshape(50, 9, 6, 2, 5)[..., [0, 1, 4]].reshape(50, 9, 6, 6)
    assert_close(shared, a.jacobian(s), atol=1e-11)


@pytest.mark.parametrize('signs', list(product([-1.0, 1.0], repeat=3)))
def test_a_right_angle_per_axis_with_slopes_as_large(segment, signs):
    bend_x0, bend_y0, bend_x1, bend_y1 = np.pi / 2 * np.array([1.0, *signs])
    q = np.array([bend_x0, bend_y0, bend_x1, bend_y1, 0.3])
    p, R = along(lambda v: (bend_x0 + bend_x1 * (v - 0.5), bend_y0 + bend_y1 * (v - 0.5)), 0.3, V)
    backbone = segment.backbone(q)
    assert_close(backbone.positions(V), p[:-1], atol=1e-11)
    assert_close(to_matrix(backbone.orientations(V)), R[:-1], atol=1e-11)
    assert_close(backbone.jacobian(V), differences(segment, q, V), atol=1e-10)


@pytest.mark.parametrize('azimuth', [0.0, 1.1, np.pi, 4.0])
@pytest.mark.parametrize(('mean', 'slope'), [(0.6, 1.4), (-1.2, 0.9), (0.0, 1.5), (1.5, -1.5)])
def test_planar_is_the_clothoid(segment, azimuth, mean, slope):
    """θ(v) = κ₀ v + κ₁ v²/2 as Baaij et al. have it, κ₀ = mean − slope/2; ∫ exp(iθ) by Fresnel's integrals."""
    first = mean - slope / 2
    scale = np.sqrt(abs(slope) / np.pi)
    sine, cosine = fresnel(scale * (V + first / slope))
    sine0, cosine0 = fresnel(scale * first / slope)
    path = (cosine - cosine0) + 1j * np.sign(slope) * (sine - sine0)
    path = path * np.exp(-0.5j * first**2 / slope) / scale
    direction = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    expected = 0.2 * (np.outer(path.imag, direction) + np.outer(path.real, [0.0, 0.0, 1.0]))
    backbone = segment.backbone([*(mean * direction[:2]), *(slope * direction[:2]), 0.2])
    assert_close(backbone.positions(V), expected, atol=1e-14)
    angle = first * V + slope * V**2 / 2
    turn = np.outer(angle, [-direction[1], direction[0], 0.0])
    assert_close(to_rotation_vector(backbone.orientations(V)), turn, atol=1e-13)


def test_the_frame_never_turns_about_its_tangent(segment):
    """Between close places it turns about an axis in its own cross-section, by the curvature there."""
    bend0, bend1, step = np.array([1.0, -0.6]), np.array([0.9, 1.5]), 1e-4
    for v in (0.1, 0.5, 0.93):
        q = segment.backbone([*bend0, *bend1, 0.2]).orientations([v - step, v + step])
        rate = to_rotation_vector(multiply(conjugate(q[0]), q[1])) / (2 * step)
        x, y = bend0 + bend1 * (v - 0.5)
        assert_close(rate, [-y, x, 0.0], atol=1e-7)


def test_tip_of_a_planar_segment_turns_by_the_mean_whatever_the_slope(segment):
    for slope in (-2.0, 0.0, 2.0):
        tip = segment.backbone([0.9, 0.0, slope, 0.0, 0.1]).orientations([1.0])
        assert_close(to_rotation_vector(tip), [[0.0, 0.9, 0.0]], atol=1e-14)
