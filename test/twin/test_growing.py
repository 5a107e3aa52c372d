"""A trial of an arm that grows: its IMUs, its backbones and its markers agree with one another."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from sesa2.configuration import files, validate
from sesa2.sensing.imu.error_model import Bno055Errors
from sesa2.shape.kinematics import create_kinematics
from sesa2.twin.growing import simulate_growing
from sesa2.twin.trial import TrialError

NONE = Bno055Errors().only()
TILTED = Rotation.from_rotvec([0.7, -1.1, 0.4])


def configured(**plant):
    c = files.load_configuration('tri_backbone')
    arm = replace(c.arm, base_orientation=tuple(TILTED.as_quat().tolist()))
    return replace(c, arm=arm, plant=replace(c.plant, **plant))


IDEAL = {'slip': 0.0, 'affine': 0.0, 'affine_spread': 0.0, 'hollow': 0.0, 'sag': 0.0, 'encoder_step': 0.0}


def test_without_errors_the_lengths_and_the_ends_lead_to_the_markers():
    c = configured(**IDEAL)
    trial, times, lengths, coordinates = simulate_growing(c, 30.0, 3, errors=NONE)
    np.testing.assert_array_equal(times, trial.truth_times)
    read = c.backbones.read(lengths)
    np.testing.assert_allclose(read.lengths[:, 0], coordinates[:, 2], atol=1e-9)
    np.testing.assert_allclose(read.bends[:, 0], coordinates[:, :2], atol=1e-9)
    arcs = create_kinematics('pcc', [0.16]).backbone(coordinates)
    for k, s in enumerate(trial.marker_positions):
        expected = TILTED.apply(arcs.positions([s])[:, 0])
        np.testing.assert_allclose(trial.markers[:, k], expected, atol=1e-9)
    # It grows and it bends.
    assert np.ptp(coordinates[:, 2]) > 0.05
    assert np.hypot(*coordinates.T[:2]).max() > 0.8
    q = Slerp(trial.times, Rotation.from_quat(trial.orientations[:, 0]))(trial.stamps[:, 0])
    assert (q.inv() * Rotation.from_quat(trial.measured[:, 0])).magnitude().max() < 1e-6
    on_base = Rotation.from_quat(trial.measured[:, 1])
    assert (TILTED.inv() * on_base).magnitude().max() < 1e-6
    assert trial.sensor_ids.tolist() == [2, 1]


def test_slip_and_errors_are_in_it_and_the_motion_stays():
    clean = simulate_growing(configured(**IDEAL), 20.0, 3, errors=NONE)
    slipping = simulate_growing(configured(), 20.0, 3, errors=NONE)
    np.testing.assert_allclose(slipping.lengths, clean.lengths, atol=1.1e-4)  # what the encoders say
    off = np.abs(slipping.coordinates - clean.coordinates).max(axis=0)
    assert off[2] > 0.003
    assert off[:2].max() > 0.1
    noisy = simulate_growing(configured(), 20.0, 3)
    np.testing.assert_array_equal(noisy.trial.markers, slipping.trial.markers)
    turned = Rotation.from_quat(noisy.trial.measured[:, 0]).inv() * Rotation.from_quat(
        slipping.trial.measured[:, 0]
    )
    assert 0.01 < np.median(turned.magnitude()) < 0.2


def test_a_seed_is_a_trial():
    one, same, other = (simulate_growing(configured(), 8.0, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.trial.measured, same.trial.measured)
    np.testing.assert_array_equal(one.lengths, same.lengths)
    assert np.abs(one.lengths - other.lengths).max() > 1e-3


def test_what_cannot_be_is_refused():
    with pytest.raises(TrialError, match='expected at least'):
        simulate_growing(configured(), 0.5, 1)
    without = validate({'arm': {'length': 0.3}, 'imus': {'ids': [1], 'positions': [0.3]}})
    with pytest.raises(TrialError, match='whose lengths are measured'):
        simulate_growing(without, 5.0, 1)
