"""The smoothest rod against a quadratic programme on a grid, curvature that scipy integrates and fits, and arcs."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

from sesa2.shape.arm import Arm
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model

LAYOUTS = [
    Layout(Arm(0.66), (0.16, 0.32, 0.48, 0.64)),
    Layout(Arm(1.3), (0.07, 0.3, 0.35, 0.8, 0.9)),
    Layout(Arm(0.5), (0.2, 0.5)),
    Layout(Arm(0.5), (0.3,)),
]
EACH = pytest.mark.parametrize('layout', LAYOUTS, ids=lambda x: f'{x.n_imu} IMUs, {x.arm.length} m')


@pytest.fixture
def rng():
    return np.random.default_rng(12)


def bent(rng, layout, batch=(), turn=4.0):
    """Orientations of which each is turned against the one before by `turn` rad per arm length, about any axis."""
    turns = rng.normal(size=(layout.n_imu + 1, *batch, 3))
    turns *= turn / layout.arm.length / np.linalg.norm(turns, axis=-1, keepdims=True)
    stations = [Rotation.from_rotvec(turns[0].reshape(-1, 3))]
    for one, width in zip(turns[1:], np.diff(layout.stations), strict=True):
        stations.append(stations[-1] * Rotation.from_rotvec(width * one.reshape(-1, 3)))
    q = np.stack([r.as_quat() for r in stations], axis=1).reshape(*batch, layout.n_imu + 1, 4)
    return q[..., 1:, :], q[..., 0, :]


def smoothest(stations, length, turns, n=1200):
    """κ at n + 1 places with ∫κ over each section given, κ = 0 at the tip, least ∫κ''² plus κ'² at the tip over its
    variance: as a quadratic programme on a grid, by its normal equations.
    """
    h = length / n
    grid = np.linspace(0.0, length, n + 1)
    second = (np.eye(n - 1, n + 1) - 2 * np.eye(n - 1, n + 1, 1) + np.eye(n - 1, n + 1, 2)) / h**1.5
    at_tip = np.zeros((1, n + 1))
    at_tip[0, -2:] = np.array([-1.0, 1.0]) / h
    # In arm lengths κ's slope at the tip has variance 1/2 where the walk has variance 1 per arm length.
    cost = np.vstack([second, at_tip * np.sqrt(2.0 / length)])
    rows = np.zeros((len(stations), n + 1))
    for i, (a, b) in enumerate(pairwise(stations)):
        # Integral of each hat function over [a, b]: the trapezoidal rule is exact for the linear interpolant.
        inside = grid[(grid > a) & (grid < b)]
        knots = np.array([a, *inside, b])
        weights = np.zeros(len(knots))
        weights[:-1] += 0.5 * np.diff(knots)
        weights[1:] += 0.5 * np.diff(knots)
        for x, w in zip(knots, weights, strict=True):
            k = min(int(x / h), n - 1)
            f = x / h - k
            rows[i, k] += w * (1 - f)
            rows[i, k + 1] += w * f
    rows[-1, -1] = 1.0
    values = np.append(turns, 0.0)
    H, m = cost.T @ cost, len(rows)
    kkt = np.block([[H, rows.T], [rows, np.zeros((m, m))]])
    return grid, np.linalg.solve(kkt, np.append(np.zeros(n + 1), values))[: n + 1]


@EACH
def test_in_a_plane_it_is_the_least_change_of_curvature(rng, layout):
    turns = rng.uniform(-1.0, 1.0, layout.n_imu)
    q = Rotation.from_rotvec(np.outer(np.cumsum(turns), [0.0, 1.0, 0.0])).as_quat()
    grid, curvature = smoothest(layout.stations, layout.arm.length, turns)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(grid) * (curvature[1:] + curvature[:-1]))])
    backbone = create_model('smooth_rod', layout).fit(Measured(q.reshape(-1, 4)))
    expected = Rotation.from_rotvec(np.outer(angle[::20], [0.0, 1.0, 0.0]))
    got = Rotation.from_quat(backbone.orientations(grid[::20]))
    np.testing.assert_allclose((got * expected.inv()).magnitude(), 0.0, atol=2e-3)


def kernel(u, v):
    """cov(κ(u), κ(v)) from the tip: a walk of the slope, which begins with variance 1/2."""
    a, b = min(u, v), max(u, v)
    return a * a * (3.0 * b - a) / 6.0 + 0.5 * u * v


def solved(layout, q, base, s):
    """Positions and orientations at s of the rod with κ = Σ weight · ∫ kernel over a section, all by scipy."""
    length, at = layout.arm.length, layout.stations / layout.arm.length
    places = np.linspace(0.0, 1.0, 101)
    functions = np.array(
        [
            [
                quad(lambda x, u=u: kernel(1.0 - u, 1.0 - x), a, b, points=[min(max(u, a), b)])[0]
                for u in places
            ]
            for a, b in pairwise(at)
        ]
    )
    curvature = CubicSpline(places, functions, axis=1)

    def run(weights, ends):
        def rate(u, y):
            kappa = curvature(u) @ weights.reshape(-1, 3)
            r = y[:9].reshape(3, 3)
            return np.append(np.cross(r, kappa[None]).ravel(), r[:, 2])

        start = np.append(Rotation.from_quat(base).as_matrix().ravel(), np.zeros(3))
        return solve_ivp(rate, (0.0, max(ends)), start, t_eval=ends, rtol=1e-9, atol=1e-10).y

    def off(weights):
        got = Rotation.from_matrix(run(weights, at[1:])[:9].T.reshape(-1, 3, 3))
        return (Rotation.from_quat(q).inv() * got).as_rotvec().ravel()

    stations = Rotation.from_quat(np.vstack([base, q]))
    turns = (stations[:-1].inv() * stations[1:]).as_rotvec()
    within = [[curvature.integrate(a, b)[k] for k in range(len(q))] for a, b in pairwise(at)]
    weights = fsolve(off, np.linalg.solve(within, turns).ravel(), xtol=1e-10)
    y = run(weights, s / length)
    return length * y[9:].T, Rotation.from_matrix(y[:9].T.reshape(-1, 3, 3))


@EACH
def test_in_space_it_is_what_scipy_integrates_and_solves(rng, layout):
    q, base = bent(rng, layout)
    s = np.linspace(0.0, layout.arm.length, 12)
    positions, orientations = solved(layout, q, base, s)
    backbone = create_model('smooth_rod', layout).fit(Measured(q, base))
    np.testing.assert_allclose(backbone.positions(s), positions, atol=1e-4)
    got = Rotation.from_quat(backbone.orientations(s))
    np.testing.assert_allclose((got * orientations.inv()).magnitude(), 0.0, atol=3e-4)


@EACH
def test_it_is_oriented_as_the_imus_and_as_the_base(rng, layout):
    q, base = bent(rng, layout, batch=(40,))
    backbone = create_model('smooth_rod', layout).fit(Measured(q, base))
    got = backbone.orientations(layout.stations)
    same = np.abs(np.sum(got * np.concatenate([base[:, None], q], axis=1), axis=-1))
    np.testing.assert_allclose(2.0 * np.arccos(np.minimum(same, 1.0)), 0.0, atol=5e-4)
    assert backbone.fallen_back == 0


@EACH
def test_its_links_end_where_it_does(rng, layout):
    q, base = bent(rng, layout)
    model = create_model('smooth_rod', layout, links=1000)
    backbone = model.fit(Measured(q, base))
    links = Rotation.from_quat(backbone.orientations(model.link_middles)).apply([0.0, 0.0, 1.0])
    chain = np.cumsum(np.diff(model.link_ends)[:, None] * links, axis=0)
    np.testing.assert_allclose(backbone.positions(model.link_ends[1:]), chain, atol=2e-5)


def test_no_curvature_at_the_tip(rng):
    q, base = bent(rng, LAYOUTS[0])
    s = 0.66 - np.array([2e-3, 1e-3, 0.0])
    got = Rotation.from_quat(create_model('smooth_rod', LAYOUTS[0]).fit(Measured(q, base)).orientations(s))
    before, last = (got[:-1].inv() * got[1:]).magnitude() / 1e-3
    assert last < 0.4 * before < 2.0


def test_half_turns_fall_back_to_arcs_and_are_counted(rng):
    layout = LAYOUTS[0]
    q, base = bent(rng, LAYOUTS[0], batch=(60,))
    lost = np.arange(60) % 3 == 0
    q[lost], base[lost] = bent(rng, LAYOUTS[0], batch=(20,), turn=12.8)
    s = np.linspace(0.0, 0.66, 7)
    backbone = create_model('smooth_rod', layout).fit(Measured(q, base))
    assert 10 <= backbone.fallen_back <= 20
    arcs = create_model('pcc_exact', layout).fit(Measured(q, base))
    as_arcs = np.abs(backbone.positions(s) - arcs.positions(s)).max(axis=(1, 2)) < 2e-4
    assert as_arcs.sum() == backbone.fallen_back
    assert not as_arcs[~lost].any()
    dots = np.abs(np.sum(backbone.orientations(s) * arcs.orientations(s), axis=-1)).min(axis=1)
    assert (dots[as_arcs] > 1.0 - 1e-6).all()


def test_on_a_real_cable_five_imus_do(recordings):
    """Median errors, % of arc length, at two vertices between the stations."""
    imus = np.genfromtxt(recordings / 'cable/imu.csv', delimiter=',', skip_header=1)[::3, 1:]
    truth = np.genfromtxt(recordings / 'cable/truth.csv', delimiter=',', skip_header=1)[::3, 1:]
    places = np.array([0.5034253289701565, 0.9110130325345416])
    at = (0.207278505658621, 0.4024380940657865, 0.6044409888807419, 0.813756065157613, 0.9876366388441138)
    model = create_model('smooth_rod', Layout(Arm(1.0118113528518646), at))
    backbone = model.fit(Measured(imus.reshape(-1, 5, 4)))
    errors = np.linalg.norm(backbone.positions(places) - truth.reshape(-1, 2, 3), axis=-1)
    assert (np.median(errors, axis=0) / places < [0.038, 0.021]).all()
    assert backbone.fallen_back < 0.02 * len(imus)


def test_on_a_simulated_arm_four_imus_do_nearly_as_well_as_eight(recordings):
    with np.load(recordings / 'twin/trial_A_bno055_seed1.npz') as trial:
        q = trial['qtrue'][::10, [2, 4, 6, 8]][..., [1, 2, 3, 0]]
        times, truth = trial['ti'][::10] - 0.02, trial['M100']
        at = [[np.interp(times, trial['t100'], truth[:, m, i]) for i in range(3)] for m in range(2)]
    places = np.array([0.36, 0.60])
    points = create_model('smooth_rod', LAYOUTS[0]).fit(Measured(q)).positions(places)
    errors = np.linalg.norm(points - np.array(at).transpose(2, 0, 1), axis=-1)
    assert (np.median(errors, axis=0) / places < [0.0115, 0.0082]).all()
