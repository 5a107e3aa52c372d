import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sesa2.evaluation.registration import (
    Registration,
    fit_registration,
    horn_matrix,
    least_squares_step,
)
from sesa2.evaluation.trajectory import EvaluationError


def cloud(rng, n=200, spread=(0.2, 0.1, 0.05)):
    return rng.normal(size=(n, 3)) * spread + (0.1, -0.2, 0.4)


@given(st.integers(0, 10_000), st.sampled_from([1e-9, 1e-4, 0.5, 3.0, np.pi - 1e-9, np.pi]))
def test_rigid_recovers_rotation_and_translation(seed, angle):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
    shift = rng.normal(size=3)
    p = cloud(rng)
    found = fit_registration('rigid', p, turn.apply(p) + shift)
    assert (Rotation.from_quat(found.rotation) * turn.inv()).magnitude() < 1e-9
    np.testing.assert_allclose(found.translation, shift, atol=1e-9)
    assert found.rotation[3] >= 0.0
    assert found.angle == pytest.approx(angle, abs=1e-7)


def test_rigid_equals_scipy_on_noise():
    rng = np.random.default_rng(3)
    p = cloud(rng)
    q = Rotation.from_euler('xyz', (0.3, -1.0, 2.0)).apply(p) + rng.normal(0.0, 0.03, p.shape)
    found = fit_registration('rigid', p, q)
    expected, _ = Rotation.align_vectors(q - q.mean(axis=0), p - p.mean(axis=0))
    assert (Rotation.from_quat(found.rotation) * expected.inv()).magnitude() < 1e-9
    np.testing.assert_allclose(found.apply(p).mean(axis=0), q.mean(axis=0), atol=1e-12)


def test_points_in_a_plane_do_and_are_never_mirrored():
    rng = np.random.default_rng(4)
    p = cloud(rng, spread=(0.2, 0.1, 0.0))
    found = fit_registration('rigid', p, p * (1.0, 1.0, -1.0))  # a mirrored plane is a shifted plane
    assert np.linalg.det(Rotation.from_quat(found.rotation).as_matrix()) == pytest.approx(1.0)
    np.testing.assert_allclose(found.apply(p), p * (1.0, 1.0, -1.0), atol=1e-9)


def test_horn_matrix_against_the_singular_values():
    rng = np.random.default_rng(5)
    covariance = rng.normal(size=(500, 3, 3))
    u, s, vt = np.linalg.svd(covariance)
    s[:, 2] *= np.sign(np.linalg.det(u @ vt))
    np.testing.assert_allclose(np.linalg.eigvalsh(horn_matrix(covariance))[:, -1], s.sum(axis=1), atol=1e-12)


def test_translation_turns_nothing():
    rng = np.random.default_rng(6)
    p = cloud(rng)
    found = fit_registration('translation', p, p + np.array((0.1, 0.2, 0.3)), (1.0, 2.0))
    np.testing.assert_allclose(found.translation, (0.1, 0.2, 0.3))
    np.testing.assert_array_equal(found.rotation, (0, 0, 0, 1))
    assert found.fitted_on == (1.0, 2.0)
    still = np.tile(p[:1], (9, 1))  # one marker that never moves is enough
    np.testing.assert_allclose(fit_registration('translation', still, still + 1.0).translation, 1.0)


def test_none_does_nothing():
    p = np.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(fit_registration('none', p, 2 * p).apply(p), p)
    np.testing.assert_array_equal(Registration().apply(p), p)


@pytest.mark.parametrize(
    ('spread', 'message'),
    [
        ((0.0, 0.0, 0.0), r'lie on a point.*Singular values 0\.00, 0\.00, 0\.00 mm rms \(200 points\)'),
        ((0.2, 0.0, 0.0), r'lie on a line.*Singular values \d+\.\d\d, 0\.00, 0\.00 mm rms'),
        ((0.2, 3e-3, 1e-3), r'the second above 1 mm and 2 % of the first'),
    ],
)
def test_rigid_refuses_points_on_a_line(spread, message):
    p = cloud(np.random.default_rng(7), spread=spread)
    turned = Rotation.from_euler('x', 1.0).apply(p)
    with pytest.raises(EvaluationError, match=message):
        fit_registration('rigid', p, turned)


@pytest.mark.parametrize('n', [1, 2])
def test_rigid_refuses_too_few_points(n):
    p = np.random.default_rng(8).normal(size=(n, 3))
    with pytest.raises(EvaluationError, match=f'{n} points'):
        fit_registration('rigid', p, p)


def test_refuses_no_points_and_unknown_kinds():
    with pytest.raises(EvaluationError, match='got none'):
        fit_registration('translation', np.empty((0, 3)), np.empty((0, 3)))
    with pytest.raises(EvaluationError, match="'affine', expected one of none, translation, rigid"):
        fit_registration('affine', np.zeros((3, 3)), np.zeros((3, 3)))


def bending(rng, n=300, m=3):
    """Markers on links that turn every way, and where they are if they sit beside the axis."""
    links = Rotation.from_rotvec(rng.normal(0.0, 0.6, (n * m, 3)))
    p = rng.normal(0.0, 0.1, (n, m, 3)) + np.arange(1, m + 1)[:, None] * (0.0, 0.0, 0.2)
    offsets = rng.normal(0.0, 0.02, (m, 3))
    beside = p + links.apply(np.broadcast_to(offsets, p.shape).reshape(-1, 3)).reshape(p.shape)
    return p, links.as_quat().reshape(n, m, 4), offsets, beside


@pytest.mark.parametrize('kind', ['offsets', 'rigid+offsets'])
def test_offsets_are_found_in_their_links(kind):
    rng = np.random.default_rng(8)
    p, links, offsets, beside = bending(rng)
    turn = Rotation.from_rotvec((0.4, -2.0, 1.0) if kind == 'rigid+offsets' else (0.0, 0.0, 0.0))
    shift = np.array((0.1, -0.2, 0.3))
    truth = turn.apply(beside.reshape(-1, 3)).reshape(beside.shape) + shift
    found = fit_registration(kind, p, truth, (1.0, 2.0), links)
    np.testing.assert_allclose(found.offsets, offsets, atol=1e-7)
    np.testing.assert_allclose(found.translation, shift, atol=1e-7)
    assert (Rotation.from_quat(found.rotation) * turn.inv()).magnitude() < 1e-6
    np.testing.assert_allclose(found.apply(p, links), truth, atol=1e-7)
    assert found.told().count('(') == (4 if kind == 'rigid+offsets' else 3)


def test_what_was_not_seen_does_not_count():
    rng = np.random.default_rng(9)
    p, links, offsets, truth = bending(rng)
    truth[:100, 0] = np.nan
    p[200:, 1] = np.nan
    np.testing.assert_allclose(fit_registration('offsets', p, truth, None, links).offsets, offsets, atol=1e-9)


def test_an_arm_that_does_not_turn_is_given_no_offsets_but_a_translation():
    rng = np.random.default_rng(10)
    p = rng.normal(0.0, 0.1, (50, 1, 3))
    links = np.broadcast_to((0.0, 0.0, 0.0, 1.0), (50, 1, 4))
    moved = p + np.array((0.02, 0.0, 0.0))
    found = fit_registration('offsets', p, moved, None, links)
    np.testing.assert_allclose(found.apply(p, links), moved, atol=1e-12)
    assert np.linalg.norm(found.offsets) < 0.021


def test_with_a_turn_offsets_that_noise_alone_tells_stay_small():
    """Of an arm that hardly bends; where it bends, the same noise does no harm."""
    for bend, most in ((0.01, 0.01), (0.6, 0.003)):
        rng = np.random.default_rng(12)
        links = Rotation.from_rotvec(rng.normal(0.0, bend, (200, 3)))
        p = links.apply([0.0, 0.0, 0.3])[:, None] + rng.normal(0.0, 0.03, (200, 1, 3))
        offset = np.array([0.0, 0.0, 0.0])
        truth = p + links.apply(offset)[:, None] + rng.normal(0.0, 0.004, p.shape)
        found = fit_registration('rigid+offsets', p, truth, None, links.as_quat()[:, None])
        assert np.linalg.norm(found.offsets) < most


def test_offsets_need_orientations():
    p = np.zeros((5, 1, 3))
    with pytest.raises(EvaluationError, match='offsets needs the orientations of the markers'):
        fit_registration('offsets', p, p)


def test_least_squares_step_equals_numpy_and_leaves_out_what_is_not_told():
    rng = np.random.default_rng(11)
    A, b = rng.normal(size=(100, 5)), rng.normal(size=100)
    np.testing.assert_allclose(least_squares_step(A, b, 1e-3), np.linalg.lstsq(A, b, rcond=None)[0])
    A[:, 4] = A[:, 3] * (1.0 + 1e-6)
    expected = np.linalg.lstsq(A, b, rcond=1e-2)[0]
    np.testing.assert_allclose(least_squares_step(A, b, 1e-2), expected, rtol=1e-5)
