"""The error budget against closed forms, and against sources worked out on a simulated trial."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sesa2.configuration import validate
from sesa2.configuration.files import find, load
from sesa2.evaluation.budget import CONFIGURED, LINKS, SPACING, TOGETHER, BudgetError, draw_budget
from sesa2.sensing.imu.error_model import SOURCES, Bno055Errors, distort, gauss_markov
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model

DATA = Path(os.environ.get('SESA2_DATA', Path(__file__).resolve().parents[2] / '../shared/data'))
TRIAL_A = DATA / 'twin/trial_A_bno055_seed1.npz'
MARKERS = np.array([0.36, 0.60])


@pytest.fixture(scope='module')
def thesis():
    return replace(load(find('prototype3_8')), models=('pcc', 'pcc_exact'))


@pytest.fixture(scope='module')
def budget(thesis):
    return draw_budget(thesis)


def errors(budget, model='pcc', layout=CONFIGURED):
    return next(e.errors for e in budget.models if (e.layout, e.model) == (layout, model))


def straight(**arm):
    """One rigid link as long as the arm."""
    return validate(
        {
            'arm': {'length': 0.5, **arm},
            'imus': {'ids': [1], 'positions': [0.25]},
            'markers': {'names': ['tip'], 'positions': [0.5]},
            'models': ['rigid'],
        }
    )


def test_tilt_of_one_link_has_the_median_of_a_rayleigh_distribution():
    # Two axes: σ √(2 ln 2), and not the 1.25 σ of thesis 5.5.2; twist about the link does nothing.
    sensor = Bno055Errors(white=0.01, tilt=0.02, heading=0.03, heading_wander=0.04)
    got = errors(draw_budget(straight(), sensor, bend=1e-6, samples=8000), 'rigid')
    median = np.sqrt(2.0 * np.log(2.0))
    assert got['noise'][0] == pytest.approx(0.5 * median * 0.01, rel=0.03)
    assert got['tilt'][0] == pytest.approx(0.5 * median * 0.02, rel=0.03)
    assert got['mounting'][0] == pytest.approx(0.5 * median * sensor.mounting, rel=0.03)
    assert got['heading'][0] < 1e-6  # the link stands upright
    assert got[SPACING][0] < 1e-6


def test_heading_of_a_lying_arm_has_the_median_of_a_gaussians_modulus():
    lying = straight(base_orientation=[0.0, float(np.sqrt(0.5)), 0.0, float(np.sqrt(0.5))])
    sensor = Bno055Errors(heading=0.03, heading_wander=0.04)
    got = errors(draw_budget(lying, sensor, bend=1e-6, samples=8000), 'rigid')
    assert got['heading'][0] == pytest.approx(0.5 * 0.6745 * 0.05, rel=0.03)


def test_latency_costs_speed_times_latency_and_can_be_taken_off(thesis):
    sensor = Bno055Errors(latency=0.03, read_interval=0.0)
    late = errors(draw_budget(thesis, sensor, speed=0.3), 'pcc_exact')['latency']
    assert late[1] == pytest.approx(0.3 * 0.03, rel=0.06)
    known = replace(thesis, imus=replace(thesis.imus, latency=0.03))
    assert errors(draw_budget(known, sensor, speed=0.3), 'pcc_exact')['latency'].max() < 1e-9
    # Reading one IMU after the other is what time_alignment takes off.
    reading = Bno055Errors(latency=0.0, read_interval=0.002)
    assert errors(draw_budget(thesis, reading), 'pcc')['latency'].min() > 5e-4
    aligned = replace(thesis, time_alignment='interpolate')
    assert errors(draw_budget(aligned, reading), 'pcc')['latency'].max() < 1e-9


def test_more_links_and_more_imus_err_less(thesis, budget):
    finer = thesis.with_options('pcc', segments=(4,) * 8)
    coarse, fine = errors(budget)[LINKS], errors(draw_budget(finer))[LINKS]
    np.testing.assert_allclose(fine, coarse / 4.0, rtol=0.05)  # second order in their length
    together = [errors(budget, 'pcc_exact', f'{n} evenly spaced')[TOGETHER] for n in (2, 4, 8)]
    assert (np.diff(together, axis=0) < 0.0).all()
    # The configured places are nearly these: the last is 2 cm before the tip.
    np.testing.assert_allclose(together[2], errors(budget, 'pcc_exact')[TOGETHER], rtol=0.05)
    assert LINKS not in errors(budget, 'pcc_exact')


def test_together_is_more_than_the_root_sum_of_squares_and_less_than_the_sum(budget):
    # Medians of errors that are large in some poses and small in others do not add up as variances do.
    got = errors(budget)
    alone = np.array([got[source] for source in (*SOURCES, SPACING)])
    assert (got[TOGETHER] > 0.95 * np.sqrt((alone**2).sum(axis=0))).all()
    assert (got[TOGETHER] < alone.sum(axis=0)).all()


def test_a_disabled_imu_costs_accuracy_and_a_perfect_sensor_none(thesis):
    one_less = replace(
        thesis, imus=replace(thesis.imus, enabled=(True, True, True, False, True, True, True, True))
    )
    perfect = Bno055Errors().only()
    whole, less = (errors(draw_budget(c, perfect), 'pcc_exact') for c in (thesis, one_less))
    assert (less[SPACING] > 1.2 * whole[SPACING]).all()
    assert all(whole[source].max() < 1e-12 for source in SOURCES)
    np.testing.assert_allclose(whole[TOGETHER], whole[SPACING])


def test_an_imu_on_the_base_adds_its_own_errors(thesis):
    imus = replace(
        thesis.imus, ids=(1, 2, 3, 4, 5, 6, 7), positions=thesis.imus.positions[:7], enabled=(True,) * 7
    )
    known = replace(thesis, models=('pcc_exact',), imus=imus)
    measured = replace(known, imus=replace(imus, base_id=8))
    sensor = Bno055Errors().only('mounting')
    a, b = (errors(draw_budget(c, sensor), 'pcc_exact')['mounting'] for c in (known, measured))
    assert (b > 1.01 * a).all()


def test_bend_and_speed_are_what_was_asked_for(thesis):
    narrow, wide = (draw_budget(thesis, bend=np.deg2rad(angle)) for angle in (20.0, 140.0))
    assert (errors(narrow)[SPACING] < 0.2 * errors(wide)[SPACING]).all()
    slow, fast = (errors(draw_budget(thesis, speed=v))['latency'] for v in (0.1, 0.4))
    np.testing.assert_allclose(fast / slow, 4.0, rtol=0.05)


def test_a_seed_is_a_budget(thesis, budget):
    np.testing.assert_array_equal(errors(draw_budget(thesis))[TOGETHER], errors(budget)[TOGETHER])
    other = errors(draw_budget(thesis, seed=1))[TOGETHER]
    assert (other != errors(budget)[TOGETHER]).all()
    np.testing.assert_allclose(other, errors(budget)[TOGETHER], rtol=0.1)


def test_json_and_table_say_the_same(budget):
    whole = json.loads(json.dumps(budget.json()))
    assert list(whole['layouts']) == [CONFIGURED, '2 evenly spaced', '4 evenly spaced', '8 evenly spaced']
    pcc = whole['layouts'][CONFIGURED]['pcc']
    assert pcc['imu_positions_m'][0] == 0.08
    cell = pcc['errors']['M2']['mounting']
    assert cell['median_pct'] == pytest.approx(cell['median_mm'] / 6.0)
    assert whole['sensor']['latency'] == 0.02
    table = budget.table()
    row = next(line for line in table.splitlines() if line.startswith('mounting'))
    assert f'{cell["median_mm"]:.1f} ({cell["median_pct"]:.2f})' in row
    assert 'M1 at 360 mm, M2 at 600 mm' in table
    assert {len(line) for line in table.split('\n\n')[1].splitlines()} == {len(row)}
    assert next(line for line in table.splitlines() if line.startswith(LINKS)).endswith('–')


def test_shipped_configurations_have_a_budget():
    for name in (
        'prototype3_4',
        'prototype3_2_rigid',
        'prototype3_2_pcc',
        'single_section',
        'authors_recording',
    ):
        budget = draw_budget(load(find(name)), samples=200)
        assert all(np.isfinite(e.errors[TOGETHER]).all() for e in budget.models)


def test_without_markers_the_tip_is_budgeted(thesis):
    budget = draw_budget(
        replace(thesis, markers=replace(thesis.markers, names=(), positions=())), samples=200
    )
    assert budget.marker_names == ('tip',)
    assert budget.marker_positions == (0.66,)


@pytest.mark.parametrize(
    ('wrong', 'message'),
    [
        ({'bend': 0.0}, 'bend = 0.0 rad'),
        ({'speed': -0.1}, 'speed = -0.1 m/s'),
        ({'bend': float('nan')}, 'bend = nan'),
        ({'samples': 3}, 'samples = 3, expected at least 100'),
    ],
)
def test_senseless_requests_are_refused(thesis, wrong, message):
    with pytest.raises(BudgetError, match=message):
        draw_budget(thesis, **wrong)


def test_a_marker_on_the_base_is_refused(thesis):
    with pytest.raises(BudgetError, match='marker B is at 0 m'):
        draw_budget(replace(thesis, markers=replace(thesis.markers, names=('A', 'B'), positions=(0.3, 0.0))))


@pytest.mark.skipif(not TRIAL_A.exists(), reason=f'{TRIAL_A} is absent (SESA2_DATA)')
def test_the_sources_are_as_large_as_on_the_simulated_trial(thesis, budget):
    """Within a third of what the same errors do to the true orientations of trial A, and the model's within a half."""
    with np.load(TRIAL_A) as trial:
        times, true = trial['ti'][::4], trial['qtrue'][::4, 1:, [1, 2, 3, 0]].astype(float)
        # its true orientations are already 20 ms old
        truth = np.stack(
            [
                [np.interp(times - 0.02, trial['t100'], trial['M100'][:, m, k]) for k in range(3)]
                for m in range(2)
            ]
        ).transpose(2, 0, 1)
    model = create_model('pcc', thesis.layout, segments=(2,) * 8)
    perfect = model.fit(Measured(true)).positions(MARKERS)
    rng = np.random.default_rng(0)
    got = errors(budget)

    def distance(a, b):
        return np.median(np.linalg.norm(a - b, axis=-1), axis=0)

    for source in ('noise', 'mounting', 'heading', 'tilt'):
        sensor, expected = Bno055Errors().only(source), []
        for _ in range(16):
            disturbance = sensor.white * rng.standard_normal((len(times), 8, 3))
            disturbance[..., :2] += sensor.tilt * gauss_markov(times, sensor.tilt_time, (8, 2), rng)
            heading = sensor.heading * rng.standard_normal(8)
            heading = heading + sensor.heading_wander * gauss_markov(times, sensor.heading_time, (8,), rng)
            mounting = sensor.mounting * rng.standard_normal((8, 3))
            said = distort(true, mounting, heading, disturbance, sensor.step)
            expected.append(distance(model.fit(Measured(said)).positions(MARKERS), perfect))
        np.testing.assert_allclose(got[source], np.median(expected, axis=0), rtol=0.33, err_msg=source)
    np.testing.assert_allclose(got[SPACING], distance(perfect, truth), rtol=0.5)
