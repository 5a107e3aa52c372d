"""What holds for every family of shapes with coordinates."""

from functools import partial

import numpy as np
import pytest
from frame_oracle import chain, differences
from scipy.spatial.transform import Rotation

from sesa2.shape.arm import GeometryError
from sesa2.shape.backbone import Backbone
from sesa2.shape.kinematics import KINEMATICS, create_kinematics
from sesa2.shape.kinematics.coordinates import Kinematics
from sesa2.shape.rotations import to_matrix

assert_close = partial(np.testing.assert_allclose, rtol=0.0)  # atol alone says how close

LENGTHS = (0.11, 0.14, 0.08)
# Not in order, some at the clamp, at joints, at the tip, twice at one place.
S = np.array([0.30, 0.02, 0.11, 0.0, 0.25, 0.17, 0.33, 0.055, 0.17])
SECTIONS = [2, 0, 0, 0, 1, 1, 2, 0, 1]
FRACTIONS = [0.625, 0.02 / 0.11, 1.0, 0.0, 1.0, 0.06 / 0.14, 1.0, 0.5, 0.06 / 0.14]

every_family = pytest.mark.parametrize('name', KINEMATICS)


def bends(kinematics):
    return np.array(['bend' in name for name in kinematics.coordinate_names])


def bent(kinematics, size, seed, stretch=0.2):
    """Coordinates with bends up to `size` and lengths off their rest by up to `stretch`."""
    rng = np.random.default_rng(seed)
    noise = rng.uniform(-1.0, 1.0, kinematics.n_coordinates)
    return np.where(bends(kinematics), size * noise, kinematics.rest * (1.0 + stretch * noise))


def curvatures(kinematics, q):
    """Curvature over the fraction of each segment, and lengths, from the coordinates' names alone."""
    by_name = dict(zip(kinematics.coordinate_names, q, strict=True))

    def of(k):
        def curvature(v):
            if f'segment_{k}_bend_x' in by_name:
                return by_name[f'segment_{k}_bend_x'], by_name[f'segment_{k}_bend_y']
            return tuple(
                by_name[f'segment_{k}_bend_{a}0'] + (v - 0.5) * by_name[f'segment_{k}_bend_{a}1']
                for a in 'xy'
            )

        return curvature, by_name[f'segment_{k}_length']

    return zip(*[of(k + 1) for k in range(len(kinematics.segment_lengths))], strict=True)


def test_registry():
    assert set(KINEMATICS) == {'pcc', 'affine'}
    with pytest.raises(GeometryError, match=r"'arcs' is not known, expected one of .*pcc"):
        create_kinematics('arcs', [0.1])


def test_two_families_of_one_name_are_refused():
    with pytest.raises(
        GeometryError, match=r"'pcc' of .*: sesa2.shape.kinematics.constant_curvature has one"
    ):
        type('Other', (Kinematics,), {'name': 'pcc', '__module__': __name__})
    assert KINEMATICS['pcc'].__name__ == 'ConstantCurvature'


def test_coordinate_names():
    assert create_kinematics('pcc', [0.1, 0.2]).coordinate_names == (
        'segment_1_bend_x',
        'segment_1_bend_y',
        'segment_1_length',
        'segment_2_bend_x',
        'segment_2_bend_y',
        'segment_2_length',
    )
    assert create_kinematics('affine', [0.1]).coordinate_names == (
        'segment_1_bend_x0',
        'segment_1_bend_y0',
        'segment_1_bend_x1',
        'segment_1_bend_y1',
        'segment_1_length',
    )


@every_family
def test_rest_is_the_straight_arm(name):
    kinematics = create_kinematics(name, LENGTHS)
    assert kinematics.n_coordinates == len(kinematics.coordinate_names) == len(kinematics.rest)
    assert not kinematics.rest[bends(kinematics)].any()
    np.testing.assert_array_equal(kinematics.rest[~bends(kinematics)], LENGTHS)
    backbone = kinematics.backbone(kinematics.rest)
    assert isinstance(backbone, Backbone)
    assert_close(backbone.positions(S), np.outer(S, [0, 0, 1]), atol=1e-15)
    assert_close(backbone.orientations(S), np.tile([0, 0, 0, 1.0], (len(S), 1)), atol=1e-15)


@every_family
@pytest.mark.parametrize('size', [0.0, 1e-9, 0.3, np.pi / 2])
def test_poses_obey_the_frames_equation(name, size):
    kinematics = create_kinematics(name, LENGTHS)
    q = bent(kinematics, size, seed=1)
    p, R = chain(*curvatures(kinematics, q), SECTIONS, FRACTIONS)
    backbone = kinematics.backbone(q)
    assert_close(backbone.positions(S), p, atol=2e-11)
    orientations = backbone.orientations(S)
    assert_close(to_matrix(orientations), R, atol=2e-11)
    assert_close(np.linalg.norm(orientations, axis=-1), 1.0, atol=1e-13)


@every_family
@pytest.mark.parametrize('lengths', [LENGTHS[:1], LENGTHS], ids=['one segment', 'three'])
@pytest.mark.parametrize('size', [0.0, 1e-11, 1e-7, 1e-3, 0.3, 1.0, 1.6, 3.0])
def test_jacobian_against_differences(name, lengths, size):
    kinematics = create_kinematics(name, lengths)
    q = bent(kinematics, size, seed=2)
    s = S[sum(lengths) >= S]
    J = kinematics.jacobian(q, s)
    expected = differences(kinematics, q, s)
    scale = np.abs(expected).max(axis=(0, 2))  # of each row; a straight arm does not twist at all
    error = np.abs(J - expected).max(axis=(0, 2))
    assert (error < 1e-8 * np.where(scale < 1e-6, 1.0, scale)).all()


@every_family
def test_jacobian_where_one_bend_is_zero(name):
    kinematics = create_kinematics(name, LENGTHS)
    for zero in range(kinematics.n_coordinates):
        q = bent(kinematics, 0.8, seed=3)
        q[zero] = 0.0 if bends(kinematics)[zero] else q[zero]
        assert_close(kinematics.jacobian(q, S), differences(kinematics, q, S), atol=1e-9)


@every_family
def test_no_place_moves_by_what_is_beyond_it(name):
    kinematics = create_kinematics(name, LENGTHS)
    J = kinematics.jacobian(bent(kinematics, 1.0, seed=4), S)
    each = len(kinematics.segment_coordinates)
    for i, section in enumerate(SECTIONS):
        assert not J[i, :, each * (section + 1) :].any()


@every_family
def test_batches_are_what_single_shapes_are(name):
    kinematics = create_kinematics(name, LENGTHS)
    q = np.stack([[bent(kinematics, size, seed) for seed in (5, 6, 7)] for size in (0.0, 1.2)])
    backbone, J = kinematics.backbone(q), kinematics.jacobian(q, S)
    assert backbone.positions(S).shape == (2, 3, 9, 3)
    assert backbone.orientations(S).shape == (2, 3, 9, 4)
    assert J.shape == (2, 3, 9, 6, kinematics.n_coordinates)
    for index in np.ndindex(2, 3):
        one = kinematics.backbone(q[index])
        assert_close(backbone.positions(S)[index], one.positions(S), atol=1e-15)
        assert_close(backbone.orientations(S)[index], one.orientations(S), atol=1e-15)
        assert_close(J[index], one.jacobian(S), atol=2e-15)
    assert kinematics.jacobian(q[:0], S).shape == (0, 3, 9, 6, kinematics.n_coordinates)
    assert kinematics.jacobian(q, []).shape == (2, 3, 0, 6, kinematics.n_coordinates)


@every_family
def test_places_stay_at_their_fraction_when_a_segment_stretches(name):
    kinematics = create_kinematics(name, LENGTHS)
    q = kinematics.rest.copy()
    q[~bends(kinematics)] *= [1.5, 0.8, 1.0]
    # Straight: a marker in the middle of a segment stays in its middle, and the next segment begins where it ends.
    z = kinematics.backbone(q).positions([0.055, 0.11, 0.18, 0.25, 0.33])[:, 2]
    np.testing.assert_allclose(z, [0.0825, 0.165, 0.221, 0.277, 0.357], rtol=1e-14)
    # Bent: a uniform stretch scales the shape and turns nothing.
    q = bent(kinematics, 1.0, seed=8, stretch=0.0)
    longer = np.where(bends(kinematics), q, 1.3 * q)
    here, there = kinematics.backbone(q), kinematics.backbone(longer)
    assert_close(there.positions(S), 1.3 * here.positions(S), atol=1e-15)
    assert_close(there.orientations(S), here.orientations(S), atol=1e-15)


@every_family
def test_nothing_jumps_on_the_way_through_straight(name):
    """From one side of straight to the other in small and in large steps, no change exceeds what the rates allow."""
    kinematics = create_kinematics(name, LENGTHS)
    direction = np.where(bends(kinematics), bent(kinematics, 1.0, seed=9), 0.0)
    direction /= np.linalg.norm(direction)
    near = np.concatenate([[0.0], np.logspace(-12, np.log10(2.0), 400)])
    t = np.concatenate([-near[:0:-1], near])
    q = kinematics.rest + t[:, None] * direction
    backbone, steps = kinematics.backbone(q), np.diff(t)
    for values, bound in (
        (backbone.positions(S), 0.4),
        (backbone.orientations(S), 2.0),
        (kinematics.jacobian(q, S), 4.0),
    ):
        jumps = np.abs(np.diff(values, axis=0)).reshape(len(steps), -1).max(axis=1)
        assert (jumps <= bound * steps + 2e-15).all()


@every_family
def test_a_backbone_is_not_changed_from_outside(name):
    kinematics = create_kinematics(name, LENGTHS)
    q = bent(kinematics, 0.5, seed=10)
    backbone = kinematics.backbone(q)
    expected = kinematics.backbone(q.copy()).positions(S)
    q += 1.0
    backbone.positions(S)[:] = 0.0
    backbone.orientations(S)[:] = 0.0
    np.testing.assert_array_equal(backbone.positions(S), expected)
    with pytest.raises(ValueError, match='read-only'):
        kinematics.rest[0] = 1.0


@every_family
def test_turn_is_the_rotation_vector_in_the_base_frame(name):
    kinematics = create_kinematics(name, LENGTHS)
    q, step = bent(kinematics, 0.7, seed=11), 1e-6 * np.ones(kinematics.n_coordinates)
    before, after = (Rotation.from_quat(kinematics.backbone(x).orientations(S)) for x in (q, q + step))
    predicted = Rotation.from_rotvec(kinematics.jacobian(q, S)[:, 3:] @ step) * before
    assert (predicted * after.inv()).magnitude().max() < 1e-10


@pytest.mark.parametrize(
    ('lengths', 'message'),
    [
        ([], r'shape \(0,\)'),
        (0.1, r'shape \(\)'),
        ([[0.1]], r'shape \(1, 1\)'),
        ([0.1, 0.0], r'segment_lengths\[1\] = 0.0 m'),
        ([-0.1], r'segment_lengths\[0\] = -0.1 m'),
        ([0.1, np.nan], r'segment_lengths\[1\] = nan m'),
        ([np.inf], r'segment_lengths\[0\] = inf m'),
    ],
)
def test_segments_that_cannot_be(lengths, message):
    with pytest.raises(GeometryError, match=message):
        create_kinematics('pcc', lengths)


@every_family
def test_shapes_that_do_not_fit(name):
    kinematics = create_kinematics(name, LENGTHS)
    n = kinematics.n_coordinates
    for wrong in (np.zeros(n + 1), np.zeros((n, 1)), np.float64(0.0)):
        with pytest.raises(GeometryError, match=rf'coordinates of shape .*, expected \(\.\.\., {n}\)'):
            kinematics.backbone(wrong)
    for wrong in (0.1, [[0.1]]):
        with pytest.raises(GeometryError, match='arc lengths of shape'):
            kinematics.jacobian(kinematics.rest, wrong)
    for wrong in (-0.01, 0.3301, np.nan):
        with pytest.raises(GeometryError, match=f'{wrong} m is not on the arm'):
            kinematics.backbone(kinematics.rest).positions([0.1, wrong])


@every_family
@pytest.mark.parametrize('lengths', [LENGTHS, LENGTHS[:1]])
@pytest.mark.parametrize('batch', [(), (4,)])
def test_matrices_are_those_of_the_quaternions(name, lengths, batch):
    kinematics = create_kinematics(name, lengths)
    q = np.stack([bent(kinematics, 1.5, seed) for seed in range(4)])[:: 1 if batch else 4].reshape(*batch, -1)
    s = S[sum(lengths) >= S]
    backbone = kinematics.backbone(q)
    matrices = backbone.matrices(s)
    assert matrices.shape == (*batch, len(s), 3, 3)
    assert_close(matrices, to_matrix(backbone.orientations(s)), atol=1e-14)
