"""The tangent spline against scipy's CubicSpline, quadrature, a circle and a bent cantilever."""

from functools import partial

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from sesa2.shape.arm import Arm
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model
from sesa2.shape.rotations import normalize

EIGHT = (0.08, 0.16, 0.24, 0.32, 0.40, 0.48, 0.56, 0.64)
LAYOUTS = [
    Layout(Arm(0.66), EIGHT),
    Layout(Arm(0.64), EIGHT),  # the last IMU at the tip
    Layout(Arm(1.3), (0.07, 0.3, 0.35, 0.8, 0.9)),
    Layout(Arm(0.5), (0.1, 0.2, 0.45)),
    Layout(Arm(0.5), (0.2, 0.4)),
    Layout(Arm(0.5), (0.3,)),
]


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def bent(rng, n, step=0.4):
    turns = Rotation.from_rotvec(step * rng.normal(size=(n + 1, 3)))
    stations = [turns[0]]
    for turn in turns[1:]:
        stations.append(stations[-1] * turn)
    q = np.array([r.as_quat() for r in stations])
    return q[1:], q[0]


def oracle(layout, q, base):
    """scipy's spline of the tangents; the slope at the last IMU is sought so that the slope at the tip vanishes."""
    at = layout.stations
    t = Rotation.from_quat(np.vstack([base, q])).apply([0.0, 0.0, 1.0])
    if len(at) == 2:  # t₀ + (t₁ − t₀) u (2 − u) / u₁ (2 − u₁)
        u1 = at[1] / layout.arm.length
        return lambda s: (
            t[0] + (t[1] - t[0]) * (s / layout.arm.length) * (2 - s / layout.arm.length) / (u1 * (2 - u1))
        )

    def with_slope(m):
        # Three stations and two slopes would be a quartic's worth: there one cubic does, through all of them.
        return CubicSpline(at, t, bc_type=('not-a-knot', (1, m)))

    zero = np.zeros(3)
    at_zero, at_one = (with_slope(m)(layout.arm.length, 1) for m in (zero, zero + 1.0))
    return with_slope(-at_zero / (at_one - at_zero))


def unit(spline, s):
    tangent = spline(s)
    return tangent / np.linalg.norm(tangent)


@pytest.mark.parametrize('layout', LAYOUTS, ids=lambda x: f'{x.n_imu} IMUs, {x.arm.length} m')
def test_positions_are_the_integral_of_scipys_spline_at_unit_speed(rng, layout):
    q, base = bent(rng, len(layout.imu_positions))
    spline = oracle(layout, q, base)
    s = np.linspace(0.0, layout.arm.length, 17)
    got = create_model('spline', layout).fit(Measured(q, base)).positions(s)
    for x, p in zip(s, got, strict=True):
        inner = [k for k in layout.stations if 0.0 < k < x]
        expected, _ = quad_vec(partial(unit, spline), 0.0, x, points=inner or None, epsabs=1e-13)
        np.testing.assert_allclose(p, expected, atol=4e-5)


@pytest.mark.parametrize('n_imu', [1, 2, 3, 8])
def test_the_arm_keeps_its_length_however_few_the_imus_are(rng, n_imu):
    """Chords of an arm that turns by about 80° from IMU to IMU, against its links', which have their full length."""
    layout = Layout(Arm(0.66), tuple(0.66 * (i + 1) / n_imu for i in range(n_imu)))
    model = create_model('spline', layout, links=1024)
    turns = rng.normal(size=(n_imu, 3)) * [1.0, 1.0, 0.1]
    turns *= 1.4 / np.linalg.norm(turns, axis=1)[:, None]
    q = [Rotation.identity()]
    for turn in turns:
        q.append(q[-1] * Rotation.from_rotvec(turn))
    backbone = model.fit(Measured(np.array([r.as_quat() for r in q[1:]])))
    points = backbone.positions(model.link_ends)
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    np.testing.assert_allclose(chords.sum(), 0.66, atol=1e-4)
    links = Rotation.from_quat(backbone.orientations(model.link_middles)).apply([0.0, 0.0, 1.0])
    chain = np.cumsum(0.66 / 1024 * links, axis=0)
    np.testing.assert_allclose(points[1:], chain, atol=3e-4)


@pytest.mark.parametrize('layout', LAYOUTS, ids=lambda x: f'{x.n_imu} IMUs, {x.arm.length} m')
def test_orientations_are_blended_quaternions_swung_onto_the_tangent(rng, layout):
    q, base = bent(rng, len(layout.imu_positions))
    spline = oracle(layout, q, base)
    stations = np.vstack([base, q])
    for i in range(1, len(stations)):
        stations[i] *= np.sign(stations[i] @ stations[i - 1])
    s = np.linspace(0.0, layout.arm.length, 23)
    signs = rng.choice([-1.0, 1.0], len(q))[:, None]
    got = Rotation.from_quat(create_model('spline', layout).fit(Measured(signs * q, base)).orientations(s))
    blended = Rotation.from_quat([[np.interp(x, layout.stations, c) for c in stations.T] for x in s])
    tangents = np.array([spline(x) / np.linalg.norm(spline(x)) for x in s])
    np.testing.assert_allclose(got.apply([0.0, 0.0, 1.0]), tangents, atol=1e-12)
    swing = (got * blended.inv()).as_rotvec()
    z = blended.apply([0.0, 0.0, 1.0])
    # The least rotation between two directions turns about their common normal, by the angle between them.
    np.testing.assert_allclose(np.sum(swing * z, axis=1), 0.0, atol=1e-12)
    angle = np.arccos(np.clip(np.sum(z * tangents, axis=1), -1.0, 1.0))
    np.testing.assert_allclose(np.linalg.norm(swing, axis=1), angle, atol=1e-7)
    at_imus = create_model('spline', layout).fit(Measured(q, base)).orientations(layout.stations[1:])
    same = np.abs(np.sum(at_imus * q, axis=1))
    np.testing.assert_allclose(same, 1.0, atol=1e-14)


def test_links_tend_to_the_curve_at_unit_speed_as_the_square_of_their_number(rng):
    layout = LAYOUTS[0]
    q, base = bent(rng, 8)
    spline = oracle(layout, q, base)

    tip, _ = quad_vec(partial(unit, spline), 0.0, layout.arm.length, points=list(EIGHT), epsabs=1e-13)
    errors = []
    for links in (64, 128, 256):
        model = create_model('spline', layout, links=links)
        middles = Rotation.from_quat(model.fit(Measured(q, base)).orientations(model.link_middles))
        chain = np.sum(np.diff(model.link_ends)[:, None] * middles.apply([0.0, 0.0, 1.0]), axis=0)
        errors.append(np.linalg.norm(chain - tip))
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4.0, rtol=0.1)


def test_a_steady_twist_comes_out_as_slerp_has_it():
    twist = Rotation.from_rotvec(np.outer(np.deg2rad(30.0) * np.arange(9), [0.0, 0.0, 1.0])).as_quat()
    s = np.linspace(0.0, EIGHT[-1], 200)
    got = Rotation.from_quat(
        create_model('spline', LAYOUTS[0]).fit(Measured(twist[1:], twist[0])).orientations(s)
    )
    steady = Rotation.from_rotvec(np.outer(np.deg2rad(30.0) * s / 0.08, [0.0, 0.0, 1.0]))
    assert np.rad2deg((got * steady.inv()).magnitude().max()) < 0.05


def test_curvature_is_continuous(rng):
    """Across a station the second derivative of the positions changes by O(h); that of arcs jumps."""
    q, base = bent(rng, 8, step=0.3)

    def jump(model, h):
        around = np.concatenate([s + h * np.arange(-2, 3) for s in EIGHT[:-1]])
        p = model.fit(Measured(q, base)).positions(around).reshape(7, 5, 3)
        before, after = p[:, 0] - 2 * p[:, 1] + p[:, 2], p[:, 2] - 2 * p[:, 3] + p[:, 4]
        return np.linalg.norm(after - before, axis=-1).max() / h**2

    spline, arcs = create_model('spline', LAYOUTS[0]), create_model('pcc_exact', LAYOUTS[0])
    assert jump(spline, 1e-3) < 0.15 * jump(spline, 1e-2)
    assert jump(arcs, 1e-3) > 0.8 * jump(arcs, 1e-2) > 1.0


def test_error_at_the_tip_falls_as_a_cubic_splines_may():
    """An arm whose curvature falls smoothly to zero at its tip; a spline's integral is of fourth order or better."""

    def angle(u):
        return 1.5 * (1.0 - (1.0 - u) ** 3)

    expected, _ = quad_vec(lambda u: np.array([np.sin(angle(u)), 0.0, np.cos(angle(u))]), 0.0, 1.0)
    errors = []
    for n in (8, 16, 32):
        layout = Layout(Arm(1.0), tuple((i + 1) / n for i in range(n)))
        q = Rotation.from_rotvec(np.outer(angle(layout.stations), [0.0, 1.0, 0.0])).as_quat()
        tip = create_model('spline', layout).fit(Measured(q[1:], q[0])).positions([1.0])[0]
        errors.append(np.linalg.norm(tip - expected))
    assert errors[0] < 3e-4
    assert (np.divide(errors[:-1], errors[1:]) > 14.0).all()


def test_one_imu_bends_as_a_cantilever_under_a_force_at_its_tip():
    """Linear theory: slope θ(u) = θ_tip u (2 − u), deflection θ_tip L (1 − 1/3) at the tip."""
    layout, small = Layout(Arm(0.5), (0.5,)), 1e-4
    q = Rotation.from_rotvec([[0.0, small, 0.0]]).as_quat()
    tip = create_model('spline', layout).fit(Measured(q)).positions([0.5])[0]
    np.testing.assert_allclose(tip, [small * 0.5 * 2 / 3, 0.0, 0.5], atol=1e-8)


def test_opposite_tangents_do_not_break_the_orientations():
    layout = Layout(Arm(0.5), (0.5,))
    q = np.array([[1.0, 0.0, 0.0, 0.0]])
    s = np.linspace(0.0, 0.5, 1001)
    s[500] = 0.5 * (1.0 - np.sqrt(0.5))  # where the parabola passes through zero
    turned = create_model('spline', layout).fit(Measured(q)).orientations(s)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1.0, atol=1e-12)


def test_base_may_differ_from_sweep_to_sweep(rng):
    q, base = normalize(rng.normal(size=(5, 8, 4))), normalize(rng.normal(size=(5, 4)))
    model = create_model('spline', LAYOUTS[0])
    together = model.fit(Measured(q, base)).positions([0.1, 0.66])
    for i in range(5):
        np.testing.assert_allclose(
            together[i], model.fit(Measured(q[i], base[i])).positions([0.1, 0.66]), atol=1e-14
        )
