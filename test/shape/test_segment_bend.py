"""The closed forms of a segment's bend against minimisers, made-up twists and each other."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from sesa2.shape.arm import GeometryError
from sesa2.shape.segment_bend import TWIST_OWNERS, fit_bend

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture
def rng():
    return np.random.default_rng(21)


def arc(bend):
    bend = np.asarray(bend)
    return Rotation.from_rotvec(np.stack([-bend[..., 1], bend[..., 0], 0.0 * bend[..., 0]], axis=-1))


def about_z(angle):
    return Rotation.from_rotvec(np.multiply.outer(angle, UP))


def bends(rng, n=300, most=2.8):
    direction = rng.uniform(0.0, 2.0 * np.pi, n)
    return rng.uniform(0.0, most, n)[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)


@pytest.mark.parametrize('owner', TWIST_OWNERS)
def test_without_twist_all_give_the_arc(rng, owner):
    expected = np.concatenate([bends(rng), np.outer([0.0, 1e-12, 1e-9, 1e-7, 1e-4], [0.6, -0.8])])
    signs = rng.choice([-1.0, 1.0], len(expected))[:, None]
    base = Rotation.random(len(expected), random_state=3)
    vertical = base.inv().apply(UP)
    got = fit_bend(signs * arc(expected).as_quat(), owner, vertical)
    np.testing.assert_allclose(got.bend, expected, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(got.twist, 0.0, atol=1e-11)


def test_the_tip_owns_what_was_turned_after_the_arc(rng):
    expected, twist = bends(rng), rng.uniform(-2.0, 2.0, 300)
    got = fit_bend((arc(expected) * about_z(twist)).as_quat(), 'tip')
    np.testing.assert_allclose(got.bend, expected, atol=1e-12)
    np.testing.assert_allclose(got.twist, twist, atol=1e-12)


def test_the_base_owns_what_was_turned_before_the_arc(rng):
    expected, twist = bends(rng), rng.uniform(-2.0, 2.0, 300)
    got = fit_bend((about_z(twist) * arc(expected)).as_quat(), 'base')
    np.testing.assert_allclose(got.bend, expected, atol=1e-12)
    np.testing.assert_allclose(got.twist, twist, atol=1e-12)


def test_heading_takes_off_what_was_turned_about_the_vertical(rng):
    expected, turn = bends(rng, most=1.2), rng.uniform(-0.6, 0.6, 300)
    base = Rotation.from_rotvec(0.5 * rng.normal(size=(300, 3)) / np.sqrt(3.0))
    tip = about_z(turn) * base * arc(expected)
    got = fit_bend((base.inv() * tip).as_quat(), 'heading', base.inv().apply(UP))
    np.testing.assert_allclose(got.bend, expected, atol=1e-12)
    np.testing.assert_allclose(got.twist, turn, atol=1e-12)


def test_with_an_upright_base_heading_is_the_base(rng):
    q = (about_z(rng.uniform(-1.0, 1.0, 300)) * arc(bends(rng))).as_quat()
    by_heading, by_base = fit_bend(q, 'heading', UP), fit_bend(q, 'base')
    np.testing.assert_allclose(by_heading.bend, by_base.bend, atol=1e-12)
    np.testing.assert_allclose(by_heading.twist, by_base.twist, atol=1e-12)


def test_shared_is_the_least_error_of_orientation(rng):
    """Hughes et al. eq. 3: the scalar part of q_measured conj(q_arc) is the greatest."""
    q = about_z(0.3 * rng.normal(size=20)) * arc(bends(rng, 20, 2.0)) * about_z(0.3 * rng.normal(size=20))
    got = fit_bend(q.as_quat(), 'shared').bend

    def error(bend, one):
        return 1.0 - (one * arc(bend).inv()).as_quat()[3] ** 2

    for one, expected in zip(q, got, strict=True):
        start = [one.as_matrix()[0, 2], one.as_matrix()[1, 2]]
        found = minimize(error, start, args=(one,), method='BFGS', options={'gtol': 1e-10})
        np.testing.assert_allclose(found.x, expected, atol=1e-6)


@pytest.mark.parametrize('owner', ['tip', 'base', 'heading'])
def test_the_owner_of_the_twist_leaves_no_error_of_orientation(rng, owner):
    """The minimum over bend and twist together, found from eq. 4's guess, is the closed form, and is zero."""
    q = about_z(0.3 * rng.normal(size=12)) * arc(bends(rng, 12, 1.5)) * about_z(0.3 * rng.normal(size=12))
    vertical = np.array([0.2, -0.3, 0.9]) / np.linalg.norm([0.2, -0.3, 0.9])
    got = fit_bend(q.as_quat(), owner, vertical)

    def made(x):
        turn = Rotation.from_rotvec(x[2] * (vertical if owner == 'heading' else UP))
        return arc(x[:2]) * turn if owner == 'tip' else turn * arc(x[:2])

    for one, bend, twist in zip(q, got.bend, got.twist, strict=True):
        start = [one.as_matrix()[0, 2], one.as_matrix()[1, 2], 0.0]
        found = minimize(
            lambda x, one=one: 1.0 - (one * made(x).inv()).as_quat()[3] ** 2,
            start,
            method='BFGS',
            options={'gtol': 1e-10},
        )
        np.testing.assert_allclose(found.x, [*bend, twist], atol=1e-5)
        assert found.fun < 1e-10


def test_shared_bends_halfway_between_tip_and_base(rng):
    """With ψ / 2 of twist at each end; tan of half the bend is large by 1 / cos(ψ/2)."""
    expected, twist = bends(rng), rng.uniform(-1.0, 1.0, 300)
    q = (about_z(0.5 * twist) * arc(expected) * about_z(0.5 * twist)).as_quat()
    shared, tip, base = (fit_bend(q, owner).bend @ [1.0, 1j] for owner in ('shared', 'tip', 'base'))
    along = expected @ [1.0, 1j]
    np.testing.assert_allclose(np.abs(np.angle(shared / along)), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.angle(tip / shared), 0.5 * twist, atol=1e-9)
    np.testing.assert_allclose(np.angle(base / shared), -0.5 * twist, atol=1e-9)
    np.testing.assert_allclose(
        np.tan(0.5 * np.abs(shared)), np.tan(0.5 * np.abs(along)) / np.cos(0.5 * twist), rtol=1e-9
    )


@pytest.mark.parametrize('owner', TWIST_OWNERS)
def test_half_turns_are_finite(owner):
    q = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0], [0, 0, 0, -1.0]])
    got = fit_bend(q, owner, [1.0, 0.0, 0.0])
    assert np.isfinite(got.bend).all()
    assert np.isfinite(got.twist).all()


@pytest.mark.parametrize(
    ('owner', 'message'), [('me', "'me', expected one of shared"), ('heading', 'needs the vertical')]
)
def test_what_cannot_be_is_refused(owner, message):
    with pytest.raises(GeometryError, match=message):
        fit_bend([0.0, 0.0, 0.0, 1.0], owner)
