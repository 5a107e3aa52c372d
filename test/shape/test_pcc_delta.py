"""Chains of twist-free arcs against scipy's rotations, exact PCC and each other."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.shape.arm import Arm
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
    np.testing.assert_allclose(got.twists, np.tile(twists, (30, 1)), atol=1e-12)
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
    np.testing.assert_allclose(got.twists, [0.2, -0.5, 0.4], atol=1e-12)


def test_coordinates_are_those_of_the_segments():
    got = fit('pcc_delta', chain(np.random.default_rng(4))).coordinates
    assert got.shape == (30, 12)
    np.testing.assert_allclose(got[:, 2::3], np.tile([0.11, 0.19, 0.15, 0.05], (30, 1)))
    np.testing.assert_array_equal(got[:, 9:11], 0.0)
