"""Coordinates through the estimator: lengths as said, slip taken off, present at every output."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.configuration import ConfigurationError, validate
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep

ANGLES = [0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0]
SLIP = [0.3, 0.1, 0.004]


def estimator(**delta):
    return Estimator(
        validate(
            {
                'arm': {'length': 0.16},
                'segments': {'lengths': [0.16], 'stretch': [0.5, 2.0]},
                'lengths': {'names': ['a', 'b', 'c'], 'angles': ANGLES, 'radii': [0.03], 'offsets': [0.01]},
                'imus': {'ids': [1], 'positions': [0.16], 'base_id': 2},
                'markers': {'names': ['tip'], 'positions': [0.16]},
                'models': ['pcc_delta', 'pcc_exact'],
                'pcc_delta': delta,
            }
        )
    )


@pytest.fixture
def arms():
    """Sweeps of arms on a base that moves; their bends, and lengths and bends by the racks."""
    rng = np.random.default_rng(3)
    bend, length = rng.uniform(-0.8, 0.8, (30, 2)), rng.uniform(0.12, 0.24, 30)
    base = Rotation.from_rotvec(rng.normal(size=(30, 3)))
    tip = base * Rotation.from_rotvec(np.stack([-bend[:, 1], bend[:, 0], np.zeros(30)], axis=-1))
    more = 1.3 * bend
    said = length[:, None] - 0.03 * more @ np.stack([np.cos(ANGLES), np.sin(ANGLES)]) - 0.01
    sweeps = [
        Sweep(10**7 * k, tip[k].as_quat()[None], np.ones(1, bool), base[k].as_quat(), said[k])
        for k in range(30)
    ]
    return sweeps, bend, length


def test_coordinates_are_those_of_the_arm_in_its_base(arms):
    sweeps, bend, length = arms
    result = estimator().estimate(sweeps).models['pcc_delta']
    np.testing.assert_allclose(result.coordinates, np.column_stack([bend, length]), atol=1e-9)
    np.testing.assert_allclose(result.twists, 0.0, atol=1e-9)
    # An arc's tip, in the frame of the base.
    theta = np.linalg.norm(bend, axis=-1)
    aside = (length * (1.0 - np.cos(theta)) / theta**2)[:, None] * bend
    expected = np.column_stack([aside, length * np.sin(theta) / theta])
    np.testing.assert_allclose(result.ends[:, -1], expected, atol=1e-9)
    np.testing.assert_allclose(result.markers[:, 0], expected, atol=1e-9)


def test_without_twist_and_slip_it_is_the_stretched_pcc_exact(arms):
    models = estimator().estimate(arms[0]).models
    for field in ('ends', 'markers', 'end_orientations', 'joints'):
        np.testing.assert_allclose(
            getattr(models['pcc_delta'], field), getattr(models['pcc_exact'], field), atol=1e-9
        )


def test_slip_is_off_the_joint_states_as_well(arms):
    sweeps, bend, length = arms
    result = estimator(slip=SLIP).estimate(sweeps).models['pcc_delta']
    theta = np.linalg.norm(bend, axis=-1)
    expected = length - (0.3 * 0.3 * theta * 0.03 + 0.1 * (length - 0.16) + 0.004)
    np.testing.assert_allclose(result.coordinates[:, 2], expected, atol=1e-9)
    np.testing.assert_allclose(result.joints[:, :, 3].sum(axis=-1), expected, atol=1e-9)


def test_a_sweep_without_a_rack_has_no_result(arms):
    sweeps = arms[0][:5]
    sweeps[2] = sweeps[2]._replace(lengths=np.array([0.1, np.nan, 0.1]))
    estimate = estimator(slip=SLIP).estimate(sweeps)
    assert estimate.without_lengths == 1
    assert len(estimate.models['pcc_delta'].coordinates) == 4
    assert not np.isnan(estimate.models['pcc_delta'].coordinates).any()


def test_slip_by_bend_beside_a_length_on_the_axis_is_refused():
    with pytest.raises(ConfigurationError, match='on its axis tells its length'):
        validate(
            {
                'arm': {'length': 0.16},
                'segments': {'lengths': [0.16]},
                'lengths': {
                    'names': ['a', 'b', 'c', 'd'],
                    'angles': [*ANGLES, 0.0],
                    'radii': [0.03, 0.03, 0.03, 0.0],
                },
                'imus': {'ids': [1], 'positions': [0.16]},
                'models': ['pcc_delta'],
                'pcc_delta': {'slip': SLIP},
            }
        )
