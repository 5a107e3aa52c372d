"""Every model stretches: against integrals of its own tangents by scipy, and against closed forms."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from sesa2.shape.arm import Arm, GeometryError
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.models import MODELS, create_model
from sesa2.shape.rotations import multiply, rotate

IMUS = (0.1, 0.17, 0.3, 0.45)
# Segments that end at IMUs, between them, and one only; the arm goes on past the last IMU.
SEGMENTS = {'at IMUs': (0.1, 0.2, 0.2), 'between': (0.13, 0.08, 0.29), 'one': (0.5,)}
OURS = sorted(
    name
    for name, model in MODELS.items()
    if model.__module__.startswith('sesa2.') and 'orientations' in model.needs
)
S = np.array([0.0, 0.05, 0.1, 0.13, 0.15, 0.21, 0.29, 0.4, 0.5])


def stretching(segments, imus=IMUS):
    return Layout(Arm(0.5), imus, segments, stretches=True)


def bent(rng, batch=(), n=4, angle=0.4):
    """Orientations of base and IMUs that turn from one to the next, and their signs at random."""
    q = [Rotation.random(random_state=int(rng.integers(1e6))).as_quat() * np.ones((*batch, 4))]
    for _ in range(n):
        turn = Rotation.from_rotvec(angle * rng.normal(size=(int(np.prod(batch)), 3))).as_quat()
        q.append(multiply(q[-1], turn.reshape(*batch, 4)))
    q = np.stack(q, axis=-2)
    q *= rng.choice([-1.0, 1.0], size=q.shape[:-1])[..., None]
    return q[..., 1:, :], q[..., 0, :]


@pytest.mark.parametrize('name', OURS)
@pytest.mark.parametrize('segments', SEGMENTS.values(), ids=SEGMENTS)
def test_a_place_is_where_the_stretched_tangents_lead(name, segments):
    rng = np.random.default_rng(5)
    layout = stretching(segments)
    q, base = bent(rng)
    lengths = np.array(segments) * rng.uniform(0.7, 1.5, len(segments))
    model = create_model(name, layout)
    backbone = model.fit(Measured(q, base, lengths))
    ends = layout.segment_ends
    own = model.link_ends if name in ('rigid', 'pcc') else layout.stations
    kinks = sorted({*ends, *own})

    def velocity(s, axis):
        k = min(int(np.searchsorted(ends[1:], s)), len(segments) - 1)
        return lengths[k] / segments[k] * rotate(backbone.orientations([s])[0], (0.0, 0.0, 1.0))[axis]

    expected = []
    for s in S:
        knots = [*[k for k in kinks if k < s], s]
        pieces = list(pairwise(knots))
        expected.append(
            [sum(quad(velocity, a, b, (i,), epsabs=1e-11)[0] for a, b in pieces) for i in range(3)]
        )
    # The cubic of `spline` is integrated by panels: 6 µm where an arm of two IMUs turns by 90°.
    np.testing.assert_allclose(backbone.positions(S), expected, atol=2e-6 if name == 'spline' else 1e-7)
    np.testing.assert_array_equal(backbone.lengths, lengths)


@pytest.mark.parametrize('name', ['pcc_exact', 'pcc_delta'])
def test_an_arc_that_grows_is_the_closed_form(name):
    model = create_model(name, stretching((0.5,), (0.5,)))
    bend = np.array([[0.4, -1.1], [0.0, 0.9], [1.5, 1.5]])
    length = np.array([0.37, 0.5, 0.8])
    theta = np.linalg.norm(bend, axis=1)
    axes = np.stack([-bend[:, 1], bend[:, 0], 0.0 * theta], axis=1)
    for share in (0.3, 1.0):
        a = share * theta
        aside = ((1.0 - np.cos(a)) / theta)[:, None] * bend / theta[:, None]
        expected = (length / theta)[:, None] * np.column_stack([aside * theta[:, None], np.sin(a)])
        q = Rotation.from_rotvec(axes).as_quat()[:, None]
        got = model.fit(Measured(q, lengths=length[:, None])).positions([share * 0.5])[:, 0]
        np.testing.assert_allclose(got, expected, atol=1e-14)


@pytest.mark.parametrize('name', OURS)
def test_at_rest_it_is_the_arm_that_does_not_stretch_and_orientations_are_its_own(name):
    rng = np.random.default_rng(6)
    segments = SEGMENTS['between']
    layout = stretching(segments)
    q, base = bent(rng, (3, 2))
    rest = create_model(name, replace(layout, stretches=False)).fit(Measured(q, base))
    lengths = rng.uniform(0.05, 0.4, (3, 2, 3))
    model = create_model(name, layout)
    at_rest = model.fit(Measured(q, base, np.broadcast_to(segments, (3, 2, 3))))
    np.testing.assert_allclose(at_rest.positions(S), rest.positions(S), atol=1e-15)
    longer = model.fit(Measured(q, base, lengths))
    np.testing.assert_array_equal(longer.orientations(S), rest.orientations(S))
    assert rest.lengths is None


@pytest.mark.parametrize('name', OURS)
def test_one_of_a_batch_is_as_alone_and_a_turned_arm_is_turned(name):
    rng = np.random.default_rng(7)
    layout = stretching(SEGMENTS['between'])
    model = create_model(name, layout)
    q, base = bent(rng, (4, 3))
    lengths = rng.uniform(0.05, 0.4, (4, 3, 3))
    together = model.fit(Measured(q, base, lengths)).positions(S)
    alone = model.fit(Measured(q[2, 1], base[2, 1], lengths[2, 1])).positions(S)
    np.testing.assert_allclose(together[2, 1], alone, atol=1e-14)
    same = model.fit(Measured(q, base, lengths[0, 0])).positions(S)  # one length for a whole batch
    np.testing.assert_allclose(same[0, 0], together[0, 0], atol=1e-14)
    turn = Rotation.random(random_state=4)
    turned = model.fit(Measured(multiply(turn.as_quat(), q), multiply(turn.as_quat(), base), lengths))
    np.testing.assert_allclose(turned.positions(S)[2, 1], turn.apply(alone), atol=1e-13)


@given(st.floats(-12.0, 0.0), st.lists(st.floats(0.01, 10.0), min_size=3, max_size=3))
@pytest.mark.parametrize('name', OURS)
def test_a_nearly_straight_arm_is_as_long_as_its_segments(name, exponent, stretches):
    layout = stretching(SEGMENTS['between'])
    lengths = np.array(SEGMENTS['between']) * stretches
    q, base = bent(np.random.default_rng(8), angle=0.2 * 10.0**exponent)
    backbone = create_model(name, layout).fit(Measured(q, base, lengths))
    ends = rotate(np.array([-1.0, -1.0, -1.0, 1.0]) * base, backbone.positions(layout.segment_ends))
    straight = np.array([0.0, *np.cumsum(lengths)])
    off = np.abs(ends - straight[:, None] * [0.0, 0.0, 1.0]).max() / straight[-1]
    assert off <= 2.0 * 10.0**exponent + 1e-13
    chords = np.linalg.norm(np.diff(backbone.positions(layout.segment_ends), axis=0), axis=1)
    assert (chords <= lengths * (1.0 + 1e-12)).all()  # a chord is no longer than its arc


@pytest.mark.parametrize('name', OURS)
def test_links_end_where_segments_do_and_only_where_the_arm_stretches(name):
    layout = stretching((0.13, 0.07, 0.3))
    model, rest = (create_model(name, one) for one in (layout, replace(layout, stretches=False)))
    assert {0.13, 0.2} <= set(np.round(model.link_ends, 12))
    assert set(rest.link_ends) <= set(model.link_ends)
    assert len(model.link_ends) <= len(rest.link_ends) + 2
    without = create_model(name, Layout(Arm(0.5), IMUS))
    np.testing.assert_array_equal(rest.link_ends, without.link_ends)
    # The links' lengths are those of the segments; each lies in one.
    pieces = model.stretching.pieces(model.link_ends)
    np.testing.assert_allclose(np.array([0.13, 0.07, 0.3]) @ pieces, np.diff(model.link_ends), atol=1e-15)
    assert (np.count_nonzero(pieces > 1e-9, axis=0) == 1).all()
    np.testing.assert_allclose(pieces.sum(axis=1), 1.0)


def test_an_arm_that_stretches_needs_its_lengths():
    layout = stretching((0.2, 0.3))
    model, q = create_model('pcc_exact', layout), np.tile([0.0, 0.0, 0.0, 1.0], (4, 1))
    assert model.needs == ('orientations', 'lengths')
    assert create_model('pcc_exact', replace(layout, stretches=False)).needs == ('orientations',)
    for lengths, expected in [
        (None, "'pcc_exact' needs lengths"),
        ([0.2], r'lengths of shape \(1,\), expected \(..., 2\)'),
        ([0.2, np.nan], 'got nan m'),
        ([0.2, 0.0], 'got 0.0 m'),
        ([np.inf, 0.2], 'got inf m'),
    ]:
        with pytest.raises(GeometryError, match=expected):
            model.fit(Measured(q, lengths=lengths))
    with pytest.raises(GeometryError, match='not on the arm'):
        model.fit(Measured(q, lengths=[0.3, 0.3])).positions([0.55])  # longer, but not of more material
    for arguments, expected in [
        (((0.2, 0.2),), 'add up to 0.4 m'),
        (((0.6, -0.1),), r'segment_lengths\[1\]'),
        (((), True), 'segment_lengths is empty'),
    ]:
        with pytest.raises(GeometryError, match=expected):
            Layout(Arm(0.5), IMUS, *arguments)
