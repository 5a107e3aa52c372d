"""The shape models against scipy, a circle and each other."""

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.spatial.transform import Rotation, Slerp

from sesa2.shape import chain
from sesa2.shape.arm import Arm, GeometryError
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.models import MODELS, create_model
from sesa2.shape.rotations import IDENTITY, multiply, normalize

LAYOUT = Layout(Arm(0.66), (0.08, 0.16, 0.24, 0.32, 0.40, 0.48, 0.56, 0.64))
S = np.linspace(0.0, LAYOUT.arm.length, 34)
BY_ORIENTATIONS = [name for name, model in MODELS.items() if 'orientations' in model.needs]


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def options(name, layout, n=2):
    return {'rigid': {}, 'pcc': {'segments': [n] * len(layout.imu_positions)}}.get(name, {})


def bent_arm(rng, layout, batch=(), step=0.7):
    """Orientations whose neighbours differ by a random rotation of about `step` rad, with random signs."""
    n = len(layout.imu_positions)
    q = np.empty((*batch, n, 4))
    base = last = normalize(rng.normal(size=(*batch, 4)))
    for i in range(n):
        turn = Rotation.from_rotvec(step * rng.normal(size=(*batch, 3)).reshape(-1, 3) / np.sqrt(3)).as_quat()
        last = multiply(turn.reshape(*batch, 4), last)
        q[..., i, :] = last * rng.choice([-1.0, 1.0], size=(*batch, 1))
    return q, base


def scipy_pcc(layout, q, base, n, s):
    """Paper eq. 3–7 with scipy's Slerp, link by link."""
    at, stations = layout.stations, np.vstack([base, q])
    slerp = Slerp(at, Rotation.from_quat(stations))
    joints, tangents, ends = [np.zeros(3)], [], [0.0]
    for i in range(len(q)):
        length = (at[i + 1] - at[i]) / n
        for k in range(n):
            t = slerp(at[i] + (2 * k + 1) / (2 * n) * (at[i + 1] - at[i])).apply([0, 0, 1])
            tangents.append(t)
            joints.append(joints[-1] + length * t)
            ends.append(ends[-1] + length)
    tangents.append(Rotation.from_quat(q[-1]).apply([0, 0, 1]))
    ends.append(layout.arm.length)
    link = np.clip(np.searchsorted(ends, s, side='right') - 1, 0, len(tangents) - 1)
    return np.array([joints[j] + (x - ends[j]) * tangents[j] for x, j in zip(s, link, strict=True)])


@pytest.mark.parametrize('n', [1, 2, 5])
def test_pcc_is_the_papers_chain(rng, n):
    q, base = bent_arm(rng, LAYOUT)
    model = create_model('pcc', LAYOUT, segments=[n] * 8)
    np.testing.assert_allclose(
        model.fit(Measured(q, base)).positions(S), scipy_pcc(LAYOUT, q, base, n, S), atol=1e-13
    )


@pytest.mark.parametrize('angle', [0.0, 1e-12, 1e-8, 1e-7, 1e-4, 3.0, np.pi - 1e-6])
def test_pcc_is_the_papers_chain_where_sections_hardly_bend_or_bend_back(rng, angle):
    axes = rng.normal(size=(8, 3))
    turns = Rotation.from_rotvec(angle * axes / np.linalg.norm(axes, axis=1)[:, None])
    base = last = Rotation.random(random_state=1)
    q = np.empty((8, 4))
    for i in range(8):
        last = turns[i] * last
        q[i] = last.as_quat() * rng.choice([-1.0, 1.0])
    model = create_model('pcc', LAYOUT, segments=[8] * 8)
    expected = scipy_pcc(LAYOUT, q, base.as_quat(), 8, S)
    np.testing.assert_allclose(
        model.fit(Measured(q, base.as_quat())).positions(S), expected, rtol=0.0, atol=1e-9
    )
    # scipy's own logarithm costs it digits near π
    if angle < 3.1:
        np.testing.assert_allclose(
            model.fit(Measured(q, base.as_quat())).positions(S), expected, rtol=0.0, atol=1e-13
        )


def test_rigid_is_the_papers_chain(rng):
    q, base = bent_arm(rng, LAYOUT)
    t = Rotation.from_quat(q).apply([0, 0, 1])
    for boundaries, ends in [
        ('midpoint', [0.12, 0.20, 0.28, 0.36, 0.44, 0.52, 0.60, 0.66]),
        ('endpoint', [0.08, 0.16, 0.24, 0.32, 0.40, 0.48, 0.56, 0.66]),
        ([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.65], [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.65, 0.66]),
    ]:
        joints = np.cumsum(np.diff([0.0, *ends])[:, None] * t, axis=0)
        backbone = create_model('rigid', LAYOUT, boundaries=boundaries).fit(Measured(q, base))
        np.testing.assert_allclose(backbone.positions(ends), joints, atol=1e-15)
    model = create_model('rigid', LAYOUT, base_link_length=0.05)
    assert model.n_links == 9
    t0 = Rotation.from_quat(base).apply([0, 0, 1])
    np.testing.assert_allclose(
        model.fit(Measured(q, base)).positions([0.05, 0.12]), [0.05 * t0, 0.05 * t0 + 0.07 * t[0]]
    )


def test_exact_pcc_is_the_integral_of_the_slerped_tangent(rng):
    q, base = bent_arm(rng, LAYOUT)
    slerp = Slerp(LAYOUT.stations, Rotation.from_quat(np.vstack([base, q])))

    def tangent(s):
        return slerp(min(s, 0.64)).apply([0, 0, 1])

    backbone = create_model('pcc_exact', LAYOUT).fit(Measured(q, base))
    for s in (0.0, 0.03, 0.08, 0.39, 0.64, 0.66):
        knots = [k for k in LAYOUT.stations if 0 < k < s]
        expected, _ = quad_vec(tangent, 0.0, s, points=knots or None, epsabs=1e-12)
        np.testing.assert_allclose(backbone.positions([s])[0], expected, atol=1e-10)
        np.testing.assert_allclose(
            Rotation.from_quat(backbone.orientations([s])[0]).as_matrix(),
            slerp(min(s, 0.64)).as_matrix(),
            atol=1e-12,
        )


@pytest.mark.parametrize(
    'bend', [0.0, 1e-12, 1e-9, 1e-7, 1e-4, 9e-3, 1.1e-2, 0.5, np.pi / 2, 3.0, np.pi - 1e-9]
)
def test_exact_pcc_on_a_circle(bend):
    """An arm bent in one plane by `bend` per section lies on a circle; chord and sagitta are known."""
    n = np.arange(1, 9)
    q = np.stack([0 * n, np.sin(n * bend / 2), 0 * n, np.cos(n * bend / 2)], axis=-1)
    s = np.linspace(0.0, 0.64, 23)
    angle = s / 0.08 * bend
    points = create_model('pcc_exact', LAYOUT).fit(Measured(q)).positions(s)
    chord = s * np.sinc(angle / 2 / np.pi)
    np.testing.assert_allclose(points[:, 0], chord * np.sin(angle / 2), atol=1e-14)
    np.testing.assert_allclose(points[:, 2], chord * np.cos(angle / 2), atol=1e-14)
    np.testing.assert_allclose(points[:, 1], 0.0, atol=1e-15)


def test_pcc_tends_to_exact_pcc_as_the_square_of_the_links(rng):
    q, base = bent_arm(rng, LAYOUT)
    exact = create_model('pcc_exact', LAYOUT).fit(Measured(q, base)).positions(LAYOUT.stations)
    error = [
        np.abs(
            create_model('pcc', LAYOUT, segments=[n] * 8).fit(Measured(q, base)).positions(LAYOUT.stations)
            - exact
        ).max()
        for n in (4, 8, 16, 32)
    ]
    np.testing.assert_allclose(np.divide(error[:-1], error[1:]), 4.0, rtol=0.03)


def test_links_of_a_curve_tend_to_it_as_the_square_of_their_number(rng):
    q, base = bent_arm(rng, LAYOUT)
    errors = []
    for links in (66, 132, 264):  # a joint at every IMU, so that no link straddles a jump of curvature
        model = create_model('pcc_exact', LAYOUT, links=links)
        backbone = model.fit(Measured(q, base))
        tangents = Rotation.from_quat(backbone.orientations(model.link_middles)).apply([0, 0, 1])
        ends = np.vstack([np.zeros(3), np.cumsum(np.diff(model.link_ends)[:, None] * tangents, axis=0)])
        errors.append(np.abs(ends - backbone.positions(model.link_ends)).max())
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4.0, rtol=0.05)


@pytest.mark.parametrize('name', BY_ORIENTATIONS)
def test_signs_of_quaternions_mean_nothing(rng, name):
    q, base = bent_arm(rng, LAYOUT, batch=(30,))
    model = create_model(name, LAYOUT, **options(name, LAYOUT))
    expected = model.fit(Measured(q, base)).positions(S)
    flipped = model.fit(Measured(q * rng.choice([-1.0, 1.0], size=(30, 8, 1)), -base)).positions(S)
    np.testing.assert_allclose(flipped, expected, atol=1e-13)


@pytest.mark.parametrize('name', BY_ORIENTATIONS)
def test_a_batch_is_its_members(rng, name):
    q, base = bent_arm(rng, LAYOUT, batch=(2, 3))
    model = create_model(name, LAYOUT, **options(name, LAYOUT))
    together = model.fit(Measured(q, base))
    assert together.positions(S).shape == (2, 3, len(S), 3)
    alone = model.fit(Measured(q[1, 2], base[1, 2]))
    np.testing.assert_allclose(together.positions(S)[1, 2], alone.positions(S), atol=1e-15)
    np.testing.assert_allclose(together.orientations(S)[1, 2], alone.orientations(S), atol=1e-15)
    middles = model.link_middles
    np.testing.assert_allclose(together.orientations(middles)[1, 2], alone.orientations(middles), atol=1e-15)


@pytest.mark.parametrize(
    ('name', 'given'), [('rigid', {}), ('pcc', {'segments': [8] * 8}), ('pcc', {'segments': [600] * 8})]
)
def test_a_batch_of_several_blocks_is_its_members(rng, name, given):
    model = create_model(name, LAYOUT, **given)
    size = max(1, chain._BLOCK // model.n_links)
    q, base = bent_arm(rng, LAYOUT, batch=(3, size))
    q, base = q[:, : size - size // 3], base[:, : size - size // 3]  # the last block is not full
    together = model.fit(Measured(q, base))
    positions, orientations = together.positions(S), together.orientations(S)
    for i in {0, size // 2, len(base[0]) - 1}:
        for k in range(3):
            alone = model.fit(Measured(q[k, i], base[k, i]))
            np.testing.assert_allclose(positions[k, i], alone.positions(S), rtol=0.0, atol=1e-15)
            np.testing.assert_allclose(orientations[k, i], alone.orientations(S), rtol=0.0, atol=1e-15)


@pytest.mark.parametrize('name', BY_ORIENTATIONS)
@pytest.mark.parametrize('n_imu', [1, 2, 3, 8])
def test_a_straight_arm_is_straight(name, n_imu):
    layout = Layout(Arm(0.5), tuple(0.5 * (i + 1) / n_imu for i in range(n_imu)))
    backbone = create_model(name, layout, **options(name, layout)).fit(
        Measured(np.tile(IDENTITY, (n_imu, 1)))
    )
    points = backbone.positions([0.0, 0.1, 0.5])
    np.testing.assert_allclose(points, [[0, 0, 0], [0, 0, 0.1], [0, 0, 0.5]], atol=1e-15)


@pytest.mark.parametrize('name', BY_ORIENTATIONS)
def test_the_whole_turns_with_its_orientations(rng, name):
    q, base = bent_arm(rng, LAYOUT)
    turn = normalize(rng.normal(size=4))
    model = create_model(name, LAYOUT, **options(name, LAYOUT))
    turned = model.fit(Measured(multiply(turn, q), multiply(turn, base))).positions(S)
    np.testing.assert_allclose(
        turned, Rotation.from_quat(turn).apply(model.fit(Measured(q, base)).positions(S)), atol=1e-13
    )


@pytest.mark.parametrize('name', BY_ORIENTATIONS)
@pytest.mark.parametrize('angle', [np.pi - 1e-3, np.pi - 1e-9, np.pi])
def test_half_a_turn_between_neighbours_gives_a_finite_arm(name, angle):
    q = Rotation.from_rotvec(np.outer(np.arange(1, 9) * angle, [1.0, 0.0, 0.0])).as_quat()
    backbone = create_model(name, LAYOUT, **options(name, LAYOUT)).fit(Measured(q))
    points = backbone.positions(S)
    assert np.isfinite(points).all()
    # Where a spline's cubic passes through zero its direction jumps: the quadrature then errs by some of a panel.
    slack = 0.2 if name == 'spline' else 1e-9
    assert (np.linalg.norm(np.diff(points, axis=0), axis=1) <= np.diff(S) * (1 + slack)).all()


@pytest.mark.parametrize(
    ('make', 'message'),
    [
        (lambda: Layout(Arm(0.0), (0.1,)), 'length = 0.0'),
        (lambda: create_model('pcc', Layout(Arm(0.5))), 'at least one'),
        (lambda: Layout(Arm(0.5), (0.0, 0.1)), r'imu_positions\[0\] = 0.0 m is not after the base'),
        (lambda: Layout(Arm(0.5), (0.2, 0.2)), r'imu_positions\[1\] = 0.2 m is not after 0.2 m'),
        (lambda: Layout(Arm(0.5), (0.2, np.nan)), r'imu_positions\[1\]'),
        (lambda: Layout(Arm(0.5), (0.2, 0.6)), 'beyond the tip'),
        (lambda: create_model('pcx', LAYOUT), 'one of .*pcc'),
        (lambda: create_model('pcc', LAYOUT, segments=[2] * 7), 'has 7 entries, expected 8'),
        (lambda: create_model('pcc', LAYOUT, segments=[2] * 7 + [0]), r'segments\[7\] = 0'),
        (lambda: create_model('rigid', LAYOUT, boundaries='middle'), "'middle', expected 'midpoint'"),
        (lambda: create_model('rigid', LAYOUT, boundaries=[0.1]), 'has 1 entries, expected 7'),
        (
            lambda: create_model('rigid', LAYOUT, boundaries=[0.1, 0.3, 0.2, 0.4, 0.5, 0.6, 0.65]),
            'increasing',
        ),
        (lambda: create_model('rigid', LAYOUT, base_link_length=0.3), 'increasing'),
        (lambda: create_model('pcc_exact', LAYOUT, links=0), 'links = 0'),
        (
            lambda: create_model('pcc_exact', LAYOUT).fit(Measured(np.zeros((7, 4)))),
            r'expected \(..., 8, 4\)',
        ),
        (
            lambda: create_model('pcc_exact', LAYOUT).fit(Measured(np.ones((8, 4)) / 2)).positions([0.7]),
            '0.7 m is not on',
        ),
        (
            lambda: create_model('rigid', LAYOUT).fit(Measured(np.ones((8, 4)) / 2)).positions([-0.1]),
            '-0.1 m is not on',
        ),
    ],
)
def test_what_cannot_be_is_refused(make, message):
    with pytest.raises(GeometryError, match=message):
        make()
