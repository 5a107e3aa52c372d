"""Sweeps with the lengths of backbones through the estimator."""

import numpy as np
import pytest

from sesa2.configuration import validate
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep
from sesa2.shape.measured import Measured
from sesa2.shape.rotations import normalize

T0 = 10**18


def configured(**changes):
    return validate(
        {
            'arm': {'length': 0.3},
            'imus': {'ids': [1, 2], 'positions': [0.1, 0.3]},
            'segments': {'lengths': [0.1, 0.2], 'stretch': [0.9, 1.5]},
            'lengths': {
                'names': ['b1', 'b2', 'b3', 'far'],
                'segments': [1, 1, 1, 2],
                'angles': [0.0, 2.0944, 4.1888, 0.0],
                'radii': [0.03, 0.03, 0.03, 0.0],
                'scales': [1.1],
                'offsets': [0.02],
            },
            'models': ['pcc', 'spline'],
            'links': 5,
            **changes,
        }
    )


def sweeps_of(lengths, rng):
    """Backbones as they are said, of segments of these lengths."""
    backbones = configured().backbones
    bends = rng.uniform(-0.5, 0.5, (len(lengths), 2, 2))
    said = (backbones.backbones(lengths, bends) - 0.02) / 1.1
    q = normalize([0.0, 0.0, 0.0, 1.0] + 0.2 * rng.normal(size=(len(lengths), 2, 4)))
    return (
        [Sweep(T0 + k * 10**7, q[k], np.ones(2, bool), None, said[k]) for k in range(len(lengths))],
        q,
        bends,
    )


def test_results_are_of_an_arm_with_these_lengths():
    c, rng = configured(), np.random.default_rng(1)
    lengths = rng.uniform([0.09, 0.18], [0.15, 0.3], (6, 2))
    sweeps, q, _ = sweeps_of(lengths, rng)
    estimate = Estimator(c).estimate(sweeps)
    for name, result in estimate.models.items():
        model = c.create_model(name)
        backbone = model.fit(Measured(q, c.base, lengths))
        np.testing.assert_allclose(result.ends, backbone.positions(model.link_ends), atol=1e-14)
        assert result.joints.shape == (6, model.n_links, 4)
        np.testing.assert_allclose(result.joints[..., 3].sum(axis=1), lengths.sum(axis=1), atol=1e-14)
        first = model.link_ends[1:] <= 0.1 + 1e-9
        np.testing.assert_allclose(result.joints[:, first, 3].sum(axis=1), lengths[:, 0], atol=1e-14)
        rates = np.diff(result.joints[..., 3], axis=0) / 0.01
        np.testing.assert_allclose(result.joint_velocities[1:, :, 3], rates, atol=1e-12)
    assert estimate.without_lengths == 0
    assert estimate.outside_stretch.tolist() == [0, 0]


def test_models_see_the_bends_that_the_racks_tell():
    c, rng = configured(), np.random.default_rng(2)
    sweeps, _, bends = sweeps_of(np.full((1, 2), 0.2), rng)
    seen = []
    estimator = Estimator(c)
    for model in estimator.models.values():
        model._fit = lambda m, f=model._fit: (seen.append(m), f(m))[1]
    estimator.estimate(sweeps)
    np.testing.assert_allclose(seen[0].backbone_bends[0, 0], bends[0, 0], atol=1e-3)
    assert np.isnan(seen[0].backbone_bends[0, 1]).all()


@pytest.mark.parametrize('lost', [np.nan, -0.5])
def test_sweeps_without_a_length_give_no_result_and_are_counted(lost):
    c, rng = configured(), np.random.default_rng(3)
    sweeps, _, _ = sweeps_of(np.full((5, 2), 0.15), rng)
    sweeps[1].lengths[3] = lost
    sweeps[2].lengths[0] = lost
    sweeps[3] = sweeps[3]._replace(lengths=None)
    estimate = Estimator(c).estimate(sweeps)
    assert estimate.stamps_ns.tolist() == [T0, T0 + 4 * 10**7]
    assert estimate.without_lengths == 3
    assert {len(result.ends) for result in estimate.models.values()} == {2}
    # Whatever else is lost, velocities are of the time since the last result.
    result = estimate.models['pcc']
    np.testing.assert_allclose(
        result.joint_velocities[1, 0, 0], (result.joints[1, 0, 0] - result.joints[0, 0, 0]) / 0.04
    )
    one_by_one = Estimator(c)
    each = [one_by_one.estimate([sweep]) for sweep in sweeps]
    assert [len(one.stamps_ns) for one in each] == [1, 0, 0, 0, 1]
    assert each[1].models == {}
    np.testing.assert_allclose(each[4].models['pcc'].ends[0], result.ends[1], atol=1e-15)
    np.testing.assert_allclose(
        each[4].models['pcc'].joint_velocities[0], result.joint_velocities[1], atol=1e-9
    )


def test_a_length_outside_the_stretch_is_used_and_counted():
    c, rng = configured(), np.random.default_rng(4)
    lengths = np.array([[0.1, 0.2], [0.08, 0.2], [0.16, 0.31]])
    estimate = Estimator(c).estimate(sweeps_of(lengths, rng)[0])
    assert estimate.outside_stretch.tolist() == [2, 1]
    np.testing.assert_allclose(
        estimate.models['spline'].joints[..., 3].sum(axis=1), lengths.sum(axis=1), atol=1e-14
    )


def test_without_lengths_nothing_is_there_of_them():
    c = configured(lengths={})
    sweeps, _, _ = sweeps_of(np.full((2, 2), 0.15), np.random.default_rng(5))
    estimate = Estimator(c).estimate([s._replace(lengths=None) for s in sweeps])
    assert estimate.models['pcc'].joints.shape[-1] == 3
    assert len(estimate.outside_stretch) == estimate.without_lengths == 0
