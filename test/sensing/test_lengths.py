"""Lengths of backbones against arcs that are integrated, and against least squares by another route."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import lsq_linear

from sesa2.sensing.lengths import BackboneLengths, outside_stretch
from sesa2.shape.arm import GeometryError

THIRDS = (0.0, 2.0944, 4.1888)


def integrated(length, bend, radius, angle, affine=0.0):
    """Length of a line beside the axis of a segment whose frame is integrated, turning without twist."""
    axis = np.array([-bend[1], bend[0], 0.0])
    own = radius * np.array([np.cos(angle), np.sin(angle), 0.0])

    def slope(s, y):
        R = y[:9].reshape(3, 3)
        w = axis / length * (1.0 + affine * (1.0 - 2.0 * s / length))
        turn = np.cross(np.eye(3), w) * -1.0
        line = R @ (np.array([0.0, 0.0, 1.0]) + np.cross(w, own))
        return [*(R @ turn).ravel(), np.linalg.norm(line)]

    y = solve_ivp(slope, (0.0, length), [*np.eye(3).ravel(), 0.0], rtol=1e-11, atol=1e-13).y[:, -1]
    return y[9]


@pytest.mark.parametrize('affine', [0.0, 0.4, -0.8])
def test_three_racks_say_length_and_bend_of_a_segment_however_it_curves(affine):
    backbones = BackboneLengths(1, 3, angles=THIRDS, radii=[0.03])
    length, bend = 0.17, np.array([0.9, -0.5])
    lines = [integrated(length, bend, 0.03, phi, affine) for phi in THIRDS]
    np.testing.assert_allclose(backbones.backbones([length], [bend]), lines, atol=1e-9)
    said = backbones.read(lines)
    np.testing.assert_allclose(said.lengths, [length], atol=1e-6)  # angles are rounded to 1e-4
    np.testing.assert_allclose(said.bends, [bend], atol=1e-4)


def test_the_closed_form_of_the_papers():
    phi, lines = np.arange(3) * 2.0 * np.pi / 3.0, np.array([0.15, 0.17, 0.19])
    said = BackboneLengths(1, 3, angles=phi, radii=[0.03]).read(lines)
    np.testing.assert_allclose(said.lengths, [lines.mean()], atol=1e-15)
    expected = -2.0 / (3.0 * 0.03) * np.array([lines @ np.cos(phi), lines @ np.sin(phi)])
    np.testing.assert_allclose(said.bends, [expected], atol=1e-13)


def test_racks_from_the_clamp_say_every_segment_and_a_batch_is_many():
    rng = np.random.default_rng(2)
    angles = [*THIRDS, *(a + 0.4 for a in THIRDS), *(a + 0.8 for a in THIRDS), 1.0]
    backbones = BackboneLengths(
        3, 10, [1, 1, 1, 2, 2, 2, 3, 3, 3, 3], [1] * 9 + [2], angles, [0.03] * 9 + [0.02]
    )
    lengths, bends = rng.uniform(0.1, 0.2, (5, 4, 3)), rng.uniform(-1.0, 1.0, (5, 4, 3, 2))
    lines = backbones.backbones(lengths, bends)
    by_hand = [
        sum(
            lengths[2, 3, k] - 0.03 * bends[2, 3, k] @ [np.cos(angles[7]), np.sin(angles[7])]
            for k in range(3)
        ),
        sum(lengths[2, 3, k] - 0.02 * bends[2, 3, k] @ [np.cos(1.0), np.sin(1.0)] for k in (1, 2)),
    ]
    np.testing.assert_allclose(lines[2, 3, [7, 9]], by_hand, atol=1e-15)
    said = backbones.read(lines)
    np.testing.assert_allclose(said.lengths, lengths, atol=1e-14)
    np.testing.assert_allclose(said.bends, bends, atol=1e-12)


def test_one_on_the_axis_is_the_length_whatever_the_racks_say():
    backbones = BackboneLengths(1, 4, angles=[*THIRDS, 0.0], radii=[0.03] * 3 + [0.0])
    lines = backbones.backbones([0.16], [[0.3, 0.2]]) + np.array([0.01, 0.012, 0.01, 0.0])  # racks slip
    said = backbones.read(lines)
    np.testing.assert_allclose(said.lengths, [0.16], atol=1e-15)
    np.testing.assert_array_equal(backbones.length_weights, [[0.0, 0.0, 0.0, 1.0]])
    alone = BackboneLengths(1, 3, angles=THIRDS, radii=[0.03]).read(lines[:3])
    np.testing.assert_allclose(said.bends, alone.bends, atol=1e-5)
    assert alone.lengths[0] > 0.17


def test_what_the_axis_leaves_open_is_the_least_squares_of_the_racks():
    rng = np.random.default_rng(3)
    backbones = BackboneLengths(
        2, 8, [1, 1, 1, 2, 2, 2, 2, 2], [1] * 7 + [2], rng.uniform(0, 6, 8), [0.03] * 7 + [0.0]
    )
    lines = rng.uniform(0.1, 0.3, 8)
    said = backbones.read(lines)
    assert said.lengths[1] == pytest.approx(lines[7], abs=1e-14)
    system = np.stack(
        [
            backbones.backbones(e[[0, 3]], [e[1:3], e[4:6]])
            for e in np.eye(6)
        ],
        axis=-1,
    )  # fmt: skip
    fixed = system[:7, 3] * lines[7]
    left = lsq_linear(system[:7, [0, 1, 2, 4, 5]], lines[:7] - fixed, tol=1e-14).x
    np.testing.assert_allclose(said.lengths[0], left[0], atol=1e-9)
    np.testing.assert_allclose(said.bends, left[1:].reshape(2, 2), atol=1e-7)


def test_scale_and_offset_come_first():
    backbones = BackboneLengths(2, 2, [1, 2], [1, 2], scales=[2.0, -1.0], offsets=[0.01, 0.3])
    np.testing.assert_allclose(backbones.read([0.05, 0.1]).lengths, [0.11, 0.2])
    np.testing.assert_allclose(backbones.calibrated([0.05, 0.1]), [0.11, 0.2])


def test_what_is_not_measured_takes_what_depends_on_it_and_no_more():
    backbones = BackboneLengths(3, 3, [1, 2, 3], [1, 1, 3])
    lines = np.array([[0.1, 0.3, 0.2], [0.1, np.nan, 0.2], [np.nan, 0.3, 0.2], [0.1, 0.3, np.nan]])
    said = backbones.read(lines)
    nan = np.nan
    expected = [[0.1, 0.2, 0.2], [0.1, nan, 0.2], [nan, nan, 0.2], [0.1, 0.2, nan]]
    np.testing.assert_allclose(said.lengths, expected, atol=1e-15)
    assert np.isnan(said.bends).all()


@pytest.mark.parametrize(
    ('angles', 'radii', 'told'),
    [
        ([0.0], [0.0], True),
        ([0.0], [0.03], False),
        ([0.0, np.pi], [0.03], True),
        ([0.0, 2.0], [0.03], False),
        ([0.0, 0.5 * np.pi, np.pi], [0.03], True),
        ([0.0, 0.8, 1.6], [0.03], True),
        ([0.0, 0.1, 0.2], [0.03], False),  # an error of each would come through 200 times as large
        ([1.0, 1.0], [0.03, 0.01], True),  # two at unequal distances on one side
        ([1.0, 1.0], [0.03, 0.029], False),
    ],
)
def test_whether_backbones_tell_a_length(angles, radii, told):
    backbones = BackboneLengths(1, len(angles), angles=angles, radii=radii)
    assert backbones.untold == (() if told else (1,))
    if told:
        assert backbones.read(backbones.backbones([0.2], [[0.1, 0.0]])).lengths == pytest.approx(
            [0.2], abs=1e-14
        )


def test_what_cannot_be_is_refused():
    for make, expected in [
        (lambda: BackboneLengths(1, 0), 'at least one'),
        (lambda: BackboneLengths(1, 3, angles=[0.0, 1.0]), 'angles has 2 entries, expected 1 or 3'),
        (lambda: BackboneLengths(1, 1, segments=[2]), 'expected 1 to 1'),
        (lambda: BackboneLengths(2, 1, segments=[1], starts=[2]), 'runs from segment 2 through 1'),
        (lambda: BackboneLengths(1, 1, radii=[-0.1]), 'at least 0'),
        (lambda: BackboneLengths(1, 2).read([0.1]), r'shape \(1,\), expected \(..., 2\)'),
    ]:
        with pytest.raises(GeometryError, match=expected):
            make()


def test_outside_the_stretch():
    got = outside_stretch([[0.09, 0.21], [0.1, np.nan], [0.131, 0.2]], [0.1, 0.2], (0.95, 1.3))
    np.testing.assert_array_equal(got, [[True, False], [False, False], [True, False]])


def test_mean_radii_are_those_of_backbones_that_tell_length_and_bend():
    angles = [0.0, 2.0, 4.0]
    assert BackboneLengths(1, 3, angles=angles, radii=[0.02, 0.03, 0.04]).mean_radii == pytest.approx([0.03])
    opposite = BackboneLengths(1, 2, angles=[0.0, np.pi], radii=[0.03])
    assert opposite.mean_radii == (0.0,)
    both = BackboneLengths(1, 4, angles=[*angles, 0.0], radii=[0.03, 0.03, 0.03, 0.0])
    assert both.mean_radii == (0.0,)


def test_chosen_ones_run_where_they_did_and_what_is_said_can_be_undone():
    both = BackboneLengths(
        2, 7, [1] * 4 + [2] * 3, [1], [0.0, *THIRDS, *THIRDS], [0.0] + [0.03] * 6, [2.0], [0.01]
    )
    assert not both.drives
    racks = both.chosen([1, 2, 3, 4, 5, 6])
    assert racks.drives
    lengths, bends = np.array([0.12, 0.2]), np.array([[0.3, -0.4], [0.1, 0.2]])
    said = both.uncalibrated(both.backbones(lengths, bends))
    np.testing.assert_allclose(both.read(said).lengths, lengths, atol=1e-12)
    own = both.backbones(lengths, bends)[1:]
    np.testing.assert_allclose(racks.backbones(lengths, bends), own, atol=1e-12)
    np.testing.assert_allclose(racks.read(own).bends, bends, atol=1e-12)
    assert not both.chosen([1, 2, 3]).drives
