"""Chains of twist-free arcs against scipy's rotations, exact PCC and each other."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.shape.arm import Arm, GeometryError
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model
from sesa2.shape.segment_bend import TWIST_OWNERS

LAYOUT = Layout(Arm(0.5), (0.11, 0.3, 0.45))
S = np.linspace(0.0, 0.5, 21)


def chain(rng, twist_at_tip=(0.0, 0.0, 0.0), n=30):
    """Stations (4 × n) of arcs on a base of any orientation, each twisted at its tip."""
    stations = [Rotation.random(n, random_state=5)]
    for twist in twist_at_tip:
        v = 0.8 * rng.normal(size=(n, 3)) * [1.0, 1.0, 0.0]
        stations.append(stations[-1] * Rotation.from_rotvec(v) * Rotation.from_rotvec([0.0, 0.0, twist]))
    return stations


def fit(name, stations, **options):
    q = np.stack([r.as_quat() for r in stations[1:]], axis=1)
    return create_model(name, LAYOUT, **options).fit(Measured(q, stations[0].as_quat()))


@pytest.mark.parametrize('twist', TWIST_OWNERS)
def test_arcs_without_twist_are_exact_pcc(twist):
    stations = chain(np.random.default_rng(4))
    got, expected = fit('pcc_delta', stations, twist=twist), fit('pcc_exact', stations)
    np.testing.assert_allclose(got.positions(S), expected.positions(S), atol=1e-10)
    turned = [Rotation.from_quat(b.orientations(S).reshape(-1, 4)) for b in (got, expected)]
    np.testing.assert_allclose((turned[0].inv() * turned[1]).magnitude(), 0.0, atol=1e-7)
    np.testing.assert_allclose(got.twists, 0.0, atol=1e-9)


def test_an_arm_that_twists_at_its_joints_is_met_where_the_tips_own_the_twist():
    twists = (0.5, -0.8, 0.3)
    stations = chain(np.random.default_rng(4), twists)
    got = fit('pcc_delta', stations, twist='tip')
    np.testing.assert_allclose(got.twists, np.tile((*twists, 0.0), (30, 1)), atol=1e-12)
    # Each arc by itself: along it the tangent turns evenly from the start of one to its end, about their common normal.
    at, place = LAYOUT.stations, np.zeros((30, 3))
    for i in range(3):
        start, end = stations[i].apply([0.0, 0.0, 1.0]), stations[i + 1].apply([0.0, 0.0, 1.0])
        angle = np.arccos(np.sum(start * end, axis=1))[:, None]
        place = place + (at[i + 1] - at[i]) * (start + end) * np.tan(0.5 * angle) / angle
        np.testing.assert_allclose(got.positions([at[i + 1]])[:, 0], place, atol=1e-12)
    just_after = Rotation.from_quat(got.orientations([0.3 + 1e-12])[:, 0])
    np.testing.assert_allclose((just_after.inv() * stations[2]).magnitude(), 0.0, atol=1e-9)
    past = got.positions([0.45, 0.5])
    np.testing.assert_allclose(past[:, 1] - past[:, 0], 0.05 * stations[3].apply([0, 0, 1.0]), atol=1e-12)


def test_heading_errors_of_the_imus_leave_nothing():
    rng = np.random.default_rng(6)
    true = [Rotation.from_rotvec([0.3, -0.1, 0.7])]
    for _ in range(3):
        true.append(true[-1] * Rotation.from_rotvec(0.4 * rng.normal(size=3) * [1.0, 1.0, 0.0]))
    seen = [
        true[0],
        *(Rotation.from_rotvec([0.0, 0.0, a]) * r for a, r in zip((0.2, -0.3, 0.1), true[1:], strict=True)),
    ]

    def shape(stations, **options):
        q = np.stack([r.as_quat() for r in stations[1:]])
        return create_model('pcc_delta', LAYOUT, **options).fit(Measured(q, stations[0].as_quat()))

    got, expected = shape(seen, twist='heading'), shape(true)
    np.testing.assert_allclose(got.positions(S), expected.positions(S), atol=1e-12)
    np.testing.assert_allclose(got.twists, [0.2, -0.5, 0.4, 0.0], atol=1e-12)


def test_coordinates_are_those_of_the_segments():
    got = fit('pcc_delta', chain(np.random.default_rng(4))).coordinates
    assert got.shape == (30, 12)
    np.testing.assert_allclose(got[:, 2::3], np.tile([0.11, 0.19, 0.15, 0.05], (30, 1)))
    np.testing.assert_allclose(got[:, 9:11], 0.0, atol=1e-15)
    assert create_model('pcc_delta', LAYOUT).coordinate_names[9:] == (
        'segment_4_bend_x',
        'segment_4_bend_y',
        'segment_4_length',
    )


def a_segment(n, bend, affine, places):
    """Orientations at fractions of a segment, n × len(places), whose curvature changes along it in one plane."""
    along = places + affine[:, None] * places * (1.0 - places)
    axis = np.stack([-bend[:, 1], bend[:, 0], np.zeros(n)], axis=-1)
    return Rotation.from_rotvec((along[..., None] * axis[:, None]).reshape(-1, 3)).as_quat().reshape(n, -1, 4)


def positions_of(bend, affine, length, v):
    """Six-point Gauss up to the fraction v, (n, 3)."""
    x, weights = np.polynomial.legendre.leggauss(6)
    u = 0.5 * v * (x + 1.0)
    theta = np.linalg.norm(bend, axis=-1)[:, None]
    angle = theta * (u + affine[:, None] * u * (1.0 - u))
    along = np.stack([np.sin(angle) @ weights, np.cos(angle) @ weights], axis=-1) * 0.5 * v * length[:, None]
    return np.concatenate([along[:, :1] * bend / theta, along[:, 1:]], axis=-1)


@pytest.fixture
def bends():
    rng = np.random.default_rng(8)
    return rng.uniform(-0.9, 0.9, (40, 2)), rng.uniform(0.12, 0.24, 40), rng.uniform(-0.5, 0.5, 40)


def test_segments_are_as_long_as_measured_and_bend_affinely(bends):
    bend, length, _ = bends
    layout = Layout(Arm(0.16), (0.16,), (0.16,), stretches=True)
    q = a_segment(40, bend, np.zeros(40), np.ones(1))
    for a in (0.0, 0.35, -0.4):
        shape = create_model('pcc_delta', layout, affine=(a,)).fit(Measured(q, lengths=length[:, None]))
        for v in (0.3, 1.0):
            expected = positions_of(bend, np.full(40, a), length, v)
            np.testing.assert_allclose(shape.positions([0.16 * v])[:, 0], expected, atol=1e-10)
        got = shape.orientations([0.04])[:, 0]
        np.testing.assert_allclose(
            np.abs(np.sum(got * a_segment(40, bend, np.full(40, a), np.array([0.25]))[:, 0], axis=-1)), 1.0
        )
    assert shape.coordinates.shape == (40, 5)
    np.testing.assert_allclose(shape.coordinates[:, 2:4], 0.8 * bend, atol=1e-12)


def test_an_imu_inside_a_segment_tells_how_its_curvature_changes(bends):
    bend, length, affine = bends
    layout = Layout(Arm(0.16), (0.064, 0.16), (0.16,), stretches=True)
    q = a_segment(40, bend, affine, np.array([0.4, 1.0]))
    model = create_model('pcc_delta', layout)
    assert model.coordinate_names[2:] == ('segment_1_bend_x1', 'segment_1_bend_y1', 'segment_1_length')
    shape = model.fit(Measured(q, lengths=length[:, None]))
    theta = np.linalg.norm(bend, axis=-1)
    found = -0.5 * shape.coordinates[:, 2] / shape.coordinates[:, 0]
    # The maximum a posteriori, by a grid: the IMU says the angle to 1°, the prior a to 0.25.
    grid = np.linspace(-2.0, 2.0, 40001)
    for t, a, got in zip(theta, affine, found, strict=True):
        off = t * 0.24 * (grid - a) / np.deg2rad(1.0)
        assert got == pytest.approx(grid[np.argmin(off**2 + (grid / 0.25) ** 2)], abs=2e-4)
    bent = theta > 0.5
    expected = positions_of(bend, affine, length, 1.0)
    off = np.linalg.norm(shape.positions([0.16])[:, 0] - expected, axis=-1)
    blind = create_model('pcc_exact', Layout(Arm(0.16), (0.16,))).fit(Measured(q[:, 1:]))
    blind = np.linalg.norm(blind.positions([0.16])[:, 0] * (length / 0.16)[:, None] - expected, axis=-1)
    assert off[bent].max() < 0.0025
    assert np.median(off[bent]) < 0.15 * np.median(blind[bent])


def test_a_straight_segment_takes_the_curvature_that_is_given():
    layout = Layout(Arm(0.16), (0.08, 0.16), (0.16,))
    shape = create_model('pcc_delta', layout, affine=(0.3,)).fit(
        Measured(np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)))
    )
    np.testing.assert_allclose(shape.positions([0.16]), [[0.0, 0.0, 0.16]], atol=1e-15)


def test_slip_is_taken_off_the_measured_length(bends):
    bend, length, _ = bends
    layout = Layout(Arm(0.16), (0.16,), (0.16,), stretches=True, backbone_radii=(0.03,))
    q = a_segment(40, bend, np.zeros(40), np.ones(1))
    more = 1.4 * bend
    c = (0.3, 0.1, 0.004)
    shape = create_model('pcc_delta', layout, slip=c).fit(
        Measured(q, lengths=length[:, None], backbone_bends=more[:, None])
    )
    theta = np.linalg.norm(bend, axis=-1)
    expected = length - (0.3 * 0.4 * theta * 0.03 + 0.1 * (length - 0.16) + 0.004)
    np.testing.assert_allclose(shape.coordinates[:, 2], expected, atol=1e-12)
    without_bend = create_model('pcc_delta', layout, slip=(0.0, 0.1, 0.004)).fit(
        Measured(q, lengths=length[:, None], backbone_bends=np.full((40, 1, 2), np.nan))
    )
    np.testing.assert_allclose(
        without_bend.coordinates[:, 2], length - 0.1 * (length - 0.16) - 0.004, atol=1e-12
    )


def test_two_segments_between_which_no_imu_is_are_one_bend_in_two_halves():
    """Interpolated by slerp: the bend of each is its share of the whole."""
    bend = np.array([0.7, -0.4])
    layout = Layout(Arm(0.3), (0.3,), (0.1, 0.2))
    q = a_segment(1, bend[None], np.zeros(1), np.ones(1))[0]
    model = create_model('pcc_delta', layout)
    assert 'segment 1 ends at 0.1 m' in model.doubts[0]
    np.testing.assert_allclose(
        model.fit(Measured(q)).coordinates, [*(bend / 3.0), 0.1, *(bend * 2.0 / 3.0), 0.2], atol=1e-12
    )


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ({'affine': (0.1, 0.2, 0.3)}, 'affine has 3 numbers, expected 1 or 2'),
        ({'slip': (0.1, 0.2)}, 'slip has 2 numbers, expected 3 or 6'),
        ({'slip': (0.1, 0.0, 0.0)}, 'backbones do not tell how a segment bends'),
    ],
)
def test_options_that_do_not_fit_the_segments_are_refused(options, message):
    with pytest.raises(GeometryError, match=message):
        create_model('pcc_delta', Layout(Arm(0.3), (0.3,), (0.1, 0.2), stretches=True), **options)
