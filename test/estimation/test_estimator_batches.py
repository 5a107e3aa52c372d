"""What the estimator says of a sweep does not hang on the sweeps and the models it is estimated with."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.configuration import validate
from sesa2.estimation.estimator import Estimator, ModelResult
from sesa2.estimation.sweeps import Sweep
from sesa2.shape.measured import Measured
from sesa2.shape.rotations import from_rotation_vector, multiply, normalize

MODELS = ['rigid', 'pcc', 'spline', 'pcc_exact', 'smooth_rod', 'pcc_delta']
COUNTS = ('near_singular', 'fallen_back')
BASE = normalize(np.array([0.3, -0.2, 0.5, 0.7]))


def estimator(*models, frame='base'):
    return Estimator(
        validate(
            {
                'arm': {'length': 0.66, 'base_orientation': BASE.tolist(), 'output_frame': frame},
                'imus': {'ids': [1, 2, 3, 4], 'positions': [0.16, 0.32, 0.48, 0.64]},
                'markers': {'names': ['M1', 'M2'], 'positions': [0.36, 0.60]},
                'models': list(models),
                'pcc': {'segments': [3, 8, 1, 20]},
            }
        )
    )


def bent_sweeps(n, bend=0.5):
    """Sweeps of an arm that bends by about `bend` rad from IMU to IMU, some IMUs missing, signs at random."""
    rng = np.random.default_rng(11)
    q, last = np.empty((n, 4, 4)), np.tile(BASE, (n, 1))
    for i in range(4):
        last = multiply(last, from_rotation_vector(bend * rng.normal(size=(n, 3))))
        q[:, i] = last * rng.choice([-1.0, 1.0], size=(n, 1))
    return [Sweep(10**7 * k, q[k], rng.random(4) < 0.9, None) for k in range(n)]


def assert_same(got, expected):
    """To the last digit; joint angles as far as joints near their singularity let them."""
    for field in ModelResult._fields:
        if getattr(got, field) is None:
            assert getattr(expected, field) is None, field
            continue
        atol = {'joints': 1e-12, 'joint_velocities': 1e-9}.get(field, 1e-15)
        np.testing.assert_allclose(
            getattr(got, field), getattr(expected, field), rtol=0.0, atol=atol, err_msg=field
        )


@pytest.mark.parametrize('frame', ['base', 'world'])
@pytest.mark.parametrize('bend', [0.0, 1e-9, 0.5, 1.5])
def test_a_batch_of_sweeps_is_the_sweeps_one_by_one(frame, bend):
    sweeps = bent_sweeps(300, bend)
    together, alone = estimator(*MODELS, frame=frame), estimator(*MODELS, frame=frame)
    batch = together.estimate(sweeps)
    single = [alone.estimate([sweep]) for sweep in sweeps]
    for name in MODELS:
        rows = [one.models[name] for one in single]
        fields = {f: [getattr(row, f) for row in rows] for f in ModelResult._fields}
        expected = ModelResult(
            **{
                f: sum(of) if f in COUNTS else None if of[0] is None else np.concatenate(of)
                for f, of in fields.items()
            }
        )
        assert_same(batch.models[name], expected)
        assert (batch.models[name].coordinates is not None) == (name == 'pcc_delta')
    assert bend < 1.0 or any(result.near_singular for result in batch.models.values())


def test_sweeps_that_a_model_cannot_solve_are_counted():
    q = from_rotation_vector(np.outer(3.1 * np.arange(1, 5), [1.0, 0.0, 0.0]))
    crossed = from_rotation_vector(np.outer(3.1 * np.arange(1, 5), [0.0, 1.0, 0.0]))
    q[2:] = multiply(crossed[2:], q[2:])
    half_turns = Sweep(10**10, multiply(BASE, q), np.ones(4, bool), None)
    sweeps = [*bent_sweeps(20), half_turns, half_turns]
    models = estimator('pcc_exact', 'smooth_rod').estimate(sweeps).models
    assert models['smooth_rod'].fallen_back == 2
    assert models['pcc_exact'].fallen_back == 0
    np.testing.assert_allclose(models['smooth_rod'].markers[-1], models['pcc_exact'].markers[-1], atol=1e-3)


@pytest.mark.parametrize('bend', [0.5, 1.5])
def test_models_together_are_each_model_alone(bend):
    sweeps = bent_sweeps(40, bend)
    for order in (MODELS, MODELS[::-1]):
        together = estimator(*order).estimate(sweeps)
        assert list(together.models) == order
        for name in order:
            assert_same(together.models[name], estimator(name).estimate(sweeps).models[name])


def test_ends_are_oriented_as_the_link_before_them():
    sweeps = [sweep._replace(measured=np.ones(4, bool)) for sweep in bent_sweeps(3)]
    e = estimator(*MODELS, frame='world')
    estimate = e.estimate(sweeps)
    measured = Measured(np.stack([sweep.orientations for sweep in sweeps]), BASE)
    for name, model in e.models.items():
        backbone, result = model.fit(measured), estimate.models[name]
        links, tip = backbone.orientations(model.link_middles), backbone.orientations([0.66])
        expected = np.concatenate([links[:, :1], links[:, :-1], tip], axis=1)
        np.testing.assert_allclose(result.end_orientations, expected, rtol=0.0, atol=1e-15)
        np.testing.assert_allclose(result.ends, backbone.positions(model.link_ends), rtol=0.0, atol=1e-15)
        np.testing.assert_allclose(
            result.marker_orientations, backbone.orientations([0.36, 0.6]), rtol=0.0, atol=1e-15
        )
        np.testing.assert_allclose(result.markers, backbone.positions([0.36, 0.6]), rtol=0.0, atol=1e-15)


@pytest.mark.parametrize('together', [True, False])
@pytest.mark.parametrize('models', [['rigid'], ['pcc', 'rigid', 'spline']])
def test_at_a_singularity_x_goes_on_from_the_sweep_before(models, together):
    sweeps = []
    for k, z in enumerate([1.0, 0.5 * np.pi, 0.5 * np.pi, 1.2]):
        q = multiply(BASE, Rotation.from_euler('XZY', [0.7, z, -0.4]).as_quat())
        sweeps.append(Sweep(10**7 * k, np.tile(q, (4, 1)), np.ones(4, bool), None))
    e = estimator(*models)
    results = [
        e.estimate(part).models['rigid'] for part in ([sweeps] if together else [[one] for one in sweeps])
    ]
    joints = np.concatenate([result.joints for result in results])
    np.testing.assert_allclose(joints[:, 0, 0], 0.7, atol=1e-12)
    np.testing.assert_allclose(joints[:, 0, 2], -0.4, atol=1e-7)
    np.testing.assert_allclose(joints[:, 1:], 0.0, atol=1e-7)
    assert sum(result.near_singular for result in results) == 2


def test_what_was_handed_out_stays_as_it_was():
    one, other = bent_sweeps(2)
    e = estimator(*MODELS)
    first = e.estimate([one])
    kept = {name: [np.copy(value) for value in result] for name, result in first.models.items()}
    base = first.base.copy()
    e.estimate([other])
    for name, values in kept.items():
        for got, expected in zip(first.models[name], values, strict=True):
            if got is None:
                continue
            np.testing.assert_array_equal(got, expected)
    first.base[:] = 0.0  # nor does what a reader does to it reach the next
    np.testing.assert_array_equal(e.estimate([other]).base, base)
