"""A trial from end to end: the simulated arm, its IMUs and its markers agree with one another."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.configuration.files import find, load
from sesa2.sensing.imu.error_model import Bno055Errors, orientations_at
from sesa2.sensing.imu.mounting import Mounting
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model
from sesa2.shape.rotations import conjugate, from_rotation_vector, multiply, to_rotation_vector
from sesa2.twin.simulation import simulate
from sesa2.twin.trial import TrialError

SECONDS = 4.0
needs_elastica = pytest.mark.usefixtures('elastica')


@pytest.fixture(scope='module')
def elastica():
    return pytest.importorskip('elastica', reason="the twin needs PyElastica, extra 'sim'")


@pytest.fixture(scope='module')
def configuration():
    whole = load(find('prototype3_8'))
    return replace(whole, imus=replace(whole.imus, ids=(1, 2, 3, 4, 5, 6, 7, 8)))


@pytest.fixture(scope='module')
def trial(elastica, configuration):
    return simulate(configuration, SECONDS, seed=1)


def angle(p, q):
    return np.linalg.norm(to_rotation_vector(multiply(conjugate(p), q)), axis=-1)


def test_the_trial_is_straight_and_then_moves(trial):
    assert trial.times[-1] == pytest.approx(SECONDS)
    assert np.abs(trial.markers[0] - [[0.0, 0.0, 0.36], [0.0, 0.0, 0.6]]).max() < 1e-12
    straight = trial.truth_times <= 1.0
    assert np.abs(trial.markers[straight] - [[0.0, 0.0, 0.36], [0.0, 0.0, 0.6]]).max() < 3e-3
    assert np.linalg.norm(np.ptp(trial.markers[:, 1], axis=0)) > 0.05
    lengths = np.linalg.norm(np.diff(trial.backbone, axis=1), axis=-1).sum(axis=1)
    np.testing.assert_allclose(lengths, 0.66, rtol=0.01)
    np.testing.assert_allclose(trial.backbone[:, [36, 60]], trial.markers[::10], atol=1e-12)


def test_the_orientations_lead_to_the_markers(configuration, trial):
    model = create_model('pcc_exact', configuration.layout)
    estimate = model.fit(Measured(trial.motion(trial.truth_times), trial.base)).positions(
        trial.marker_positions
    )
    error = np.linalg.norm(estimate - trial.markers, axis=-1)
    assert np.median(error, axis=0) / trial.marker_positions == pytest.approx(0.0, abs=0.02)


def test_the_samples_are_the_truth_with_the_injected_errors(configuration, trial):
    assert trial.stamps.shape == (390, 8)
    np.testing.assert_allclose(np.diff(trial.stamps[:, 0]), 1.0 / configuration.serial.rate_hz)
    true = orientations_at(trial.times, trial.orientations, trial.stamps - 0.020)
    mountings = multiply(from_rotation_vector(trial.mountings), configuration.mountings)
    for i in (0, 200, 389):
        links = Mounting(mountings, trial.headings[i]).link_orientations(trial.measured[i])
        assert angle(links, true[i]).max() < np.deg2rad(5.0)  # tilt and noise are left
    assert np.median(angle(trial.measured, true)) > np.deg2rad(1.0)


@needs_elastica
def test_an_imu_on_the_base_is_read_last_in_its_own_mounting(configuration):
    on_base = Rotation.from_rotvec([0.3, -1.7, 0.9])
    imus = replace(
        configuration.imus,
        ids=configuration.imus.ids[:-1],
        positions=configuration.imus.positions[:-1],
        enabled=configuration.imus.enabled[:-1],
        base_id=8,
        base_mount_orientation=tuple(1.008 * on_base.as_quat()),
    )
    tilted = Rotation.from_rotvec([0.5, 0.2, -0.4])
    arm = replace(configuration.arm, base_orientation=tuple(tilted.as_quat()))
    trial = simulate(replace(configuration, arm=arm, imus=imus), 1.0, seed=1, errors=Bno055Errors().only())
    assert trial.sensor_ids.tolist() == [1, 2, 3, 4, 5, 6, 7, 8]
    turns = (tilted * on_base).inv() * Rotation.from_quat(trial.measured[:, -1])
    np.testing.assert_allclose(turns.magnitude(), 0.0, atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(trial.measured, axis=-1), 1.0, atol=1e-12)


@needs_elastica
def test_errors_leave_the_motion_and_the_seed_decides_it(configuration, trial):
    perfect = simulate(configuration, SECONDS, seed=1, errors=Bno055Errors().only())
    np.testing.assert_array_equal(perfect.markers, trial.markers)
    true = orientations_at(perfect.times, perfect.orientations, perfect.stamps)
    assert angle(perfect.measured, true).max() < 1e-7
    other = simulate(configuration, 2.0, seed=2)
    assert np.abs(trial.markers[: len(other.markers)] - other.markers).max() > 1e-2


@needs_elastica
def test_an_imu_on_the_base_a_hanging_arm_and_twist(configuration):
    hanging = replace(
        configuration,
        imus=replace(configuration.imus, ids=(1, 2, 3, 4, 5, 6, 7), positions=configuration.imus.positions[:7],
                     enabled=(True,) * 7, base_id=8),
        arm=replace(configuration.arm, base_orientation=(1.0, 0.0, 0.0, 0.0)),
        markers=replace(configuration.markers, names=(), positions=()),
    )  # fmt: skip
    done = []
    trial = simulate(hanging, 2.0, seed=4, progress=done.append, twist=1.0)
    assert list(trial.sensor_ids) == [1, 2, 3, 4, 5, 6, 7, 8]
    assert trial.measured.shape[1:] == (8, 4)
    assert trial.orientations.shape[1:] == (7, 4)
    assert trial.markers.shape[1:] == (0, 3)
    assert trial.backbone[0, -1] == pytest.approx([0.0, 0.0, -0.66])
    twisted = to_rotation_vector(multiply(conjugate(trial.base), trial.orientations[:, -1]))[..., 2]
    assert np.rad2deg(np.abs(twisted).max()) > 1.0
    assert done == sorted(done)
    assert done[-1] == 1.0


@needs_elastica
def test_a_thin_arm_can_be_simulated(configuration):
    thin = replace(configuration, arm=replace(configuration.arm, radius=0.004))
    assert np.isfinite(simulate(thin, 1.0, seed=1).markers).all()


@needs_elastica
def test_a_motion_that_becomes_unstable_is_reported(configuration, monkeypatch):
    monkeypatch.setattr('sesa2.twin.rod._COURANT', 5.0)
    with pytest.raises(TrialError, match=r'0\.66 m long and 0\.0125 m in radius, flew apart after 0\.'):
        simulate(configuration, 1.0, seed=1)


def test_without_pyelastica_the_message_names_the_extra(configuration, monkeypatch):
    monkeypatch.setitem(sys.modules, 'sesa2.twin.rod', None)
    with pytest.raises(TrialError, match=r"pip install 'sesa2\[sim\]'"):
        simulate(configuration, 4.0, seed=1)


@needs_elastica
def test_no_time_is_no_trial(configuration):
    for seconds in (0.0, -3.0, float('nan')):
        with pytest.raises(TrialError, match='expected at least 1'):
            simulate(configuration, seconds, seed=1)
