"""The simulated arm as a whole: without errors it is geometry, with them as far off as it is meant to be."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from slipping_arms import IDEAL, THIRDS, arm, command_of, drive, tripods

from sesa2.plant.plant_options import HEAVY, MILD
from sesa2.sensing.imu.error_model import Bno055Errors
from sesa2.sensing.lengths import BackboneLengths
from sesa2.shape.arm import GeometryError
from sesa2.shape.kinematics import create_kinematics
from sesa2.shape.kinematics.constant_curvature import arc_to

BASE = Rotation.from_rotvec([0.3, -0.8, 0.5])


@pytest.mark.parametrize('m', [1, 2, 3])
def test_without_errors_it_is_the_arc_that_the_lengths_say(m):
    plant = arm(m=m, base=BASE.as_quat())
    q = np.random.default_rng(m).normal([0.3, -0.2, 0.18], [0.3, 0.3, 0.02], (m, 3)).ravel()
    drive(plant, command_of(plant, q), 0.1)
    arcs = create_kinematics('pcc', [0.16] * m).backbone(q)
    s = 0.16 * np.arange(1, m + 1)
    np.testing.assert_allclose(plant.coordinates, q, atol=1e-12)
    np.testing.assert_allclose(plant.tip, arcs.positions(s[-1:])[0], atol=1e-9)
    np.testing.assert_allclose(plant.encoders, command_of(plant, q), atol=1e-12)
    np.testing.assert_allclose(plant.said_lengths, plant.encoders, atol=1e-12)
    expected = (BASE * Rotation.from_quat(arcs.orientations(s))).as_matrix()
    got = Rotation.from_quat(plant.link_orientations_at(plant.time)).as_matrix()
    np.testing.assert_allclose(got[:-1], expected, atol=1e-9)
    np.testing.assert_allclose(got[-1], BASE.as_matrix(), atol=1e-12)  # the one on the base is the last


def test_racks_beside_the_axis_drive_and_a_length_on_it_is_the_true_one():
    both = BackboneLengths(
        1,
        4,
        angles=[0.0, *THIRDS],
        radii=[0.0, 0.03, 0.03, 0.03],
        scales=[2.0],
        offsets=[0.01, 0.0, 0.0, 0.0],
    )
    plant = arm(replace(MILD, encoder_step=0.0, length_noise=0.0), backbones=both)
    assert plant.driven.tolist() == [1, 2, 3]
    drive(plant, command_of(plant, [0.9, 0.3, 0.2]), 8.0)
    said = both.calibrated(plant.said_lengths)
    assert said[0] == pytest.approx(plant.lengths[0], abs=1e-12)
    np.testing.assert_allclose(said[1:], plant.encoders, atol=1e-12)
    assert np.mean(said[1:]) - said[0] > 0.003  # the racks slipped in common, and do not know it


def test_an_arm_whose_lengths_are_no_racks_has_racks_of_its_own():
    plant = arm(backbones=BackboneLengths(1, 1))
    assert plant.driven.tolist() == []
    drive(plant, command_of(plant, [0.4, 0.0, 0.2]), 0.1)
    np.testing.assert_allclose(plant.said_lengths, [0.2], atol=1e-12)


def test_it_is_at_rest_where_it_begins_under_its_own_weight():
    plant = arm(replace(MILD, sag=0.2), base=Rotation.from_rotvec([1.0, 0.0, 0.0]).as_quat())
    before = plant.coordinates
    assert np.hypot(*before[:2]) > 0.02
    drive(plant, command_of(plant, [0.0, 0.0, 0.12]), 2.0)
    np.testing.assert_allclose(plant.coordinates, before, atol=1e-6)


def test_the_same_seed_is_the_same_arm_and_another_another():
    def run(seed):
        plant = arm(HEAVY, m=2, seed=seed)
        drive(plant, command_of(plant, [0.7, 0.2, 0.2, -0.4, 0.3, 0.15]), 3.0)
        return np.concatenate([plant.tip, plant.encoders, plant.imu_orientations.ravel(), plant.said_lengths])

    np.testing.assert_array_equal(run(5), run(5))
    assert np.linalg.norm((run(5) - run(6))[:3]) > 1e-4


def test_the_past_is_kept_and_imus_lag():
    errors = Bno055Errors().only('latency')
    plant, seen = arm(replace(IDEAL, rate=0.1), errors=errors), []
    for _ in range(1500):
        plant.step([0.17, 0.2, 0.23], 0.01)
        seen.append((plant.time, plant.coordinates, plant.tip))
    for time, q, tip in seen[-500:]:
        np.testing.assert_allclose(plant.coordinates_at(time), q, atol=1e-12)
        np.testing.assert_allclose(plant.tip_at(time), tip, atol=1e-12)
    plant = arm(replace(IDEAL, rate=0.1), errors=errors)
    drive(plant, [0.10, 0.15, 0.17], 0.3, 0.01)
    before = plant.link_orientations_at(plant.time - errors.latency)
    assert np.abs(before[0] - plant.link_orientations_at(plant.time)[0]).max() > 1e-3
    np.testing.assert_allclose(plant.imu_orientations, before, atol=1e-12)


def test_a_push_bends_it_and_goes():
    plant = arm()
    plant.push = np.array([0.35, 0.0])
    drive(plant, plant.encoders, 2.0)
    np.testing.assert_allclose(plant.bends, [[0.35, 0.0]], atol=1e-6)
    np.testing.assert_allclose(plant.encoders, 0.12, atol=1e-12)
    plant.push = np.zeros(2)
    drive(plant, plant.encoders, 2.0)
    np.testing.assert_allclose(plant.bends, 0.0, atol=1e-6)


def test_imus_err_as_told():
    quiet = arm(replace(MILD, imu_errors=0.0))
    drive(quiet, quiet.encoders, 0.1)
    # The chip's resolution is left.
    np.testing.assert_allclose(quiet.imu_orientations, quiet.link_orientations_at(quiet.time), atol=2.0**-13)
    turns = [arm(replace(MILD, mounting_twist=0.1), seed=k).imus.mountings for k in range(60)]
    at_tip, on_base = np.std(turns, axis=0)
    assert at_tip[0] == pytest.approx(np.deg2rad(1.0), rel=0.3)
    assert at_tip[2] == pytest.approx(np.hypot(0.1, np.deg2rad(1.0)), rel=0.3)
    assert on_base[2] < 0.03
    thrice = [arm(replace(MILD, imu_errors=3.0), seed=k).imus.mountings[0, 0] for k in range(60)]
    np.testing.assert_allclose(thrice, 3.0 * np.array(turns)[:, 0, 0], atol=1e-12)


def test_a_push_of_one_number_is_refused():
    with pytest.raises(GeometryError, match='push has 1 numbers'):
        arm(replace(IDEAL, push=(1.0,)))


def test_the_racks_of_several_segments_may_pass_the_first():
    through = BackboneLengths(2, 6, [1, 1, 1, 2, 2, 2], [1], THIRDS * 2, [0.03])
    plant, other = arm(m=2, backbones=through), arm(m=2, backbones=tripods(2))
    q = [0.3, -0.4, 0.15, 0.5, 0.1, 0.2]
    for p in (plant, other):
        drive(p, command_of(p, q), 0.1)
    np.testing.assert_allclose(plant.tip, other.tip, atol=1e-12)


def _errors(options, n_arms, seconds, feedback):
    """Where the tip ends, five random targets for each arm, m: with its true place fed back, or open loop."""
    errors = []
    for seed in range(100, 100 + n_arms):
        rng, plant = np.random.default_rng(seed), arm(options, seed=seed)
        length, theta = rng.uniform(0.13, 0.24, 5), np.deg2rad(rng.uniform(0.0, 75.0, 5))
        azimuth = rng.uniform(0.0, 2.0 * np.pi, 5)
        q = np.stack([theta * np.cos(azimuth), theta * np.sin(azimuth), length], axis=-1)
        for target in create_kinematics('pcc', [0.16]).backbone(q).positions([0.16])[:, 0]:
            told = arc_to(target)
            for _ in range(round(seconds / 0.1)):
                if feedback:
                    told = told + 0.2 * (arc_to(target) - arc_to(plant.tip))
                drive(plant, command_of(plant, told), 0.1)
            errors.append(np.linalg.norm(plant.tip - target))
    return np.array(errors)


@pytest.mark.parametrize(('options', 'size'), [(MILD, 0.023), (HEAVY, 0.040)])
def test_open_loop_it_errs_as_much_as_it_is_meant_to(options, size):
    assert np.mean(_errors(options, 15, 6.0, feedback=False)) == pytest.approx(size, rel=0.12)


@pytest.mark.parametrize(('options', 'left'), [(MILD, 0.001), (HEAVY, 0.01)])
def test_its_targets_can_be_reached_by_who_sees_the_tip(options, left):
    assert np.max(_errors(options, 4, 15.0, feedback=True)) < left
