"""The twin of any arm: from 30 mm to 3 m, standing, hanging and lying, with one IMU and with sixteen."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sesa2.configuration import validate
from sesa2.configuration.files import find, load
from sesa2.evaluation.budget import draw_budget
from sesa2.sensing.imu.error_model import Bno055Errors
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model

UP, DOWN = [0.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0]
FLAT = [0.0, 0.5**0.5, 0.0, 0.5**0.5]
GRAVITY, YOUNG, DENSITY = 9.80665, 2e6, 1200.0

# Length, radius, m; IMUs; how the arm stands.
ARMS = {
    '30 mm': (0.03, 0.0125, 1, DOWN),
    '200 mm': (0.2, 0.0125, 2, UP),
    '1 m, thin': (1.0, 0.004, 8, FLAT),
    '3 m': (3.0, 0.0125, 16, UP),
}


def arm(length, radius, n_imu, base):
    """Configured; more IMUs than ids are allowed go past the validation."""
    configuration = validate(
        {
            'arm': {'length': length, 'radius': radius, 'base_orientation': base},
            'imus': {'ids': [1], 'positions': [length], 'enabled': [True]},
            'markers': {'names': ['middle', 'end'], 'positions': [0.5 * length, length]},
            'models': ['rigid', 'pcc', 'pcc_exact', 'spline'],
        }
    )
    places = length * np.arange(1, n_imu + 1) / n_imu
    imus = replace(
        configuration.imus,
        ids=tuple(range(1, n_imu + 1)),
        positions=tuple(places.tolist()),
        enabled=(True,) * n_imu,
    )
    return replace(configuration, imus=imus).with_options('pcc', segments=(4,) * n_imu)


@pytest.mark.parametrize('name', ARMS)
def test_energy_stays_bounded_and_the_motion_is_one(name):
    pytest.importorskip('elastica', reason="the twin needs PyElastica, extra 'sim'")
    from sesa2.twin.simulation import simulate

    length, radius, n_imu, base = ARMS[name]
    trial = simulate(arm(length, radius, n_imu, base), 2.0, seed=1, errors=Bno055Errors().only())
    area = np.pi * radius**2
    weight, stiffness = DENSITY * area * length * GRAVITY, YOUNG * area * radius**2 / 4.0
    # As much as bends the arm into a circle, stretches it by a twentieth, or lets it fall to the other side.
    bound = (
        0.5 * stiffness * (2.0 * np.pi) ** 2 / length
        + 0.00125 * YOUNG * area * length
        + 2.0 * weight * length
    )
    assert np.abs(trial.energies - trial.energies[0]).max() < bound
    lengths = np.linalg.norm(np.diff(trial.backbone, axis=1), axis=-1)
    np.testing.assert_allclose(lengths.sum(axis=1), length, rtol=0.12)
    np.testing.assert_allclose(lengths, length / lengths.shape[1], rtol=0.2)
    assert np.linalg.norm(np.ptp(trial.markers[:, 1], axis=0)) > 0.01 * length
    step = np.linalg.norm(np.diff(trial.markers, axis=0), axis=-1).max()
    assert step < 0.05 * length  # within 10 ms
    if n_imu > 1:
        model = create_model('pcc_exact', arm(length, radius, n_imu, base).layout)
        found = model.fit(Measured(trial.motion(trial.truth_times), trial.base)).positions(
            trial.marker_positions
        )
        assert np.median(np.linalg.norm(found - trial.markers, axis=-1)) < 0.05 * length


def test_the_shipped_single_section_does_not_fly_apart():
    pytest.importorskip('elastica', reason="the twin needs PyElastica, extra 'sim'")
    from sesa2.twin.simulation import simulate

    trial = simulate(load(find('single_section')), 2.0, seed=1)
    assert np.linalg.norm(trial.markers, axis=-1).max() < 0.21


@pytest.mark.parametrize('name', ARMS)
def test_a_budget_is_drawn_up(name):
    length, radius, n_imu, base = ARMS[name]
    budget = draw_budget(arm(length, radius, n_imu, base), samples=100)
    json.dumps(budget.json())
    errors = np.array([e for entry in budget.models for e in entry.errors.values()])
    assert np.isfinite(errors).all()
    spaced = {e.model: e.errors['IMU spacing'][1] for e in budget.models if e.layout == 'configured'}
    if n_imu == 16:
        assert spaced['spline'] < 0.005 * length
    together = [e.errors['together'][1] for e in budget.models if e.layout == '8 evenly spaced']
    assert 0.001 * length < min(together)
    assert budget.table().count('\n') > 10
