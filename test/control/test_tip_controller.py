"""The controller around a simulated arm: what it reaches, and the command that goes out on each fault."""

from dataclasses import replace

import numpy as np
import pytest
from looped_arm import DT, LoopedArm, racks

from sesa2.control import ControlState, TipController
from sesa2.control.controller_options import ControllerOptions
from sesa2.control.tip_controller import ControlError
from sesa2.plant.plant_options import HEAVY, MILD
from sesa2.shape.rotations import from_rotation_vector

TARGET = np.array([0.08, 0.03, 0.15])


def running(plant=MILD, seed=0, **options):
    arm = LoopedArm(replace(plant, seed=seed), **options)
    arm.run(0.2)
    arm.controller.start()
    return arm


@pytest.mark.parametrize('law', ['rates', 'paper'])
@pytest.mark.parametrize('plant', [MILD, HEAVY])
def test_with_the_true_tip_fed_back_the_target_is_reached(law, plant):
    arm = running(plant, owner=None, law=law, gain=2.5 if law == 'rates' else 1.0)
    arm.go(TARGET, 12.0)
    assert arm.controller.state is ControlState.RUNNING, arm.controller.reason
    assert np.linalg.norm(arm.plant.tip - TARGET) < 0.008


def test_a_jump_of_the_target_is_none_of_the_command():
    arm = running()
    arm.go(TARGET, 3.0)
    arm.go([-0.08, 0.0, 0.16], 1.0)
    lengths = np.array([c for _, c in arm.sent])
    assert np.abs(np.diff(lengths, axis=0)).max() <= 0.06 * DT * 1.001


def test_three_segments():
    arm = running(
        segments=(0.11, 0.11, 0.11), stretch=(0.95, 1.10), owner=None, length_limits=(0.04, 0.2), damping=0.02
    )
    goal = arm.plant.tip + np.array([0.06, -0.05, -0.03])
    arm.go(goal, 8.0)
    assert arm.controller.state is ControlState.RUNNING, arm.controller.reason
    assert np.linalg.norm(arm.plant.tip - goal) < 0.006


def test_it_starts_stopped_and_without_a_target_holds_the_tip():
    arm = LoopedArm(MILD)
    arm.run(0.5)
    assert arm.controller.state is ControlState.STOPPED
    assert not arm.sent
    arm.controller.start()
    before = arm.plant.tip
    arm.run(1.0)
    assert arm.controller.state is ControlState.RUNNING
    assert len(arm.sent) > 90
    assert np.linalg.norm(arm.plant.tip - before) < 0.002


def held(arm, seconds=1.0):
    """Runs it into a fault; what went out last are the measured lengths, and then nothing."""
    arm.run(seconds)
    assert arm.controller.state is ControlState.HOLD
    n = len(arm.sent)
    arm.run(0.5)
    assert len(arm.sent) == n
    return arm.controller.reason


@pytest.mark.parametrize(
    ('silent', 'reason'),
    [
        ('estimate', 'the estimate of the tip: nothing new for 0.2'),
        ('lengths', 'the lengths of the backbones'),
    ],
)
def test_feedback_that_is_old(silent, reason):
    arm = running()
    arm.go(TARGET, 0.8)
    arm.silent = silent
    measured = arm.controller._measured
    assert reason in held(arm)
    _, last = arm.sent[-1]
    if silent == 'lengths':
        np.testing.assert_allclose(last, measured, rtol=0, atol=1e-12)


def test_after_a_hold_it_goes_on_from_the_encoders():
    arm = running()
    arm.go(TARGET, 0.8)
    arm.silent = 'estimate'
    held(arm)
    arm.silent = None
    where = arm.plant.encoders
    arm.controller.start()
    arm.run(0.05)
    first = next(c for t, c in arm.sent if t > arm.t - 0.05)
    assert np.abs(first - where).max() < 0.002
    arm.run(6.0)
    assert np.linalg.norm(arm.tip_estimated - TARGET) < 0.005


def test_an_imu_that_is_frozen_while_the_encoders_move():
    for seed in range(5):
        arm = running(seed=seed)
        arm.go(TARGET, 2.0)
        arm.freeze = True
        arm.controller.hear_target([-0.08, -0.02, 0.16])
        assert 'IMU 1 is frozen' in held(arm)


def test_an_imu_that_is_frozen_but_for_its_last_bits():
    arm = running()
    arm.go(TARGET, 2.0)
    arm.freeze = True
    hear, rng = arm.controller.hear_imu, np.random.default_rng(0)
    arm.controller.hear_imu = lambda now, i, q: hear(now, i, q + 1e-5 * rng.standard_normal(4))
    arm.controller.hear_target([-0.08, -0.02, 0.16])
    assert 'its IMU saw nothing of it' in held(arm, 4.0)


def test_an_imu_that_is_knocked():
    for seed in range(5):
        arm = running(seed=seed)
        arm.go(TARGET, 3.0)
        arm.knock = from_rotation_vector(np.radians(30.0) * np.array([0.6, -0.8, 0.0]))
        assert 'the estimated tip jumped' in held(arm)


@pytest.mark.parametrize('plant', [MILD, HEAVY])
def test_a_minute_of_motion_and_rest_is_no_fault(plant):
    rng = np.random.default_rng(5)
    arm = running(plant, seed=3)
    for _ in range(12):
        bend, way = rng.uniform(0.0, 1.2), rng.uniform(0, 2 * np.pi)
        q = [bend * np.cos(way), bend * np.sin(way), rng.uniform(0.13, 0.22)]
        arm.go(arm.kinematics.backbone(q).positions([0.16])[0], 5.0)
        assert arm.controller.state is ControlState.RUNNING, arm.controller.reason


@pytest.mark.parametrize('seed', [1001, 2002])
def test_headings_that_turn_the_bend_are_no_fault(seed):
    # Three times the errors of a BNO055: what the IMUs bend by is turned by 30° against what the encoders do.
    arm = running(HEAVY, seed=seed, owner='shared')
    for target in ([0.0, -0.08, 0.12], [-0.03, 0.01, 0.22], [0.08, 0.06, 0.17], [-0.08, 0.04, 0.16]):
        arm.go(target, 4.0)
        assert arm.controller.state is ControlState.RUNNING, arm.controller.reason


def test_an_imu_that_turns_while_the_encoders_rest():
    arm = running()
    arm.go(TARGET, 4.0)
    watch, now, stamp = arm.controller.watch, arm.t, arm.k * 10_000_000
    bends = arm.controller._feedback.coordinates[:2]
    for k in range(1, 200):  # slower than a jump, farther than a push
        watch.hear_lengths(now + k * DT, stamp + k * 10_000_000, watch._encoders)
        watch.hear_tip(now + k * DT, stamp + k * 10_000_000, watch._tip, bends[None] - [0.0, 0.01 * k])
        if reason := watch.fault(now + k * DT):
            break
    assert 'an IMU is loose' in reason
    assert 79 < k < 87


def test_unbent_it_lengthens_while_it_is_straight():
    # Racks slip where the arm is bent, and what they slip in common nobody sees: it is the error of length.
    slips = {}
    for path in ('direct', 'unbent'):
        arm = running(seed=7, route=path)
        for target in ([0.09, 0.03, 0.12], [0.08, 0.05, 0.18]):
            arm.go(target, 9.0)
            assert arm.controller.state is ControlState.RUNNING, arm.controller.reason
            assert np.linalg.norm(arm.tip_estimated - target) < 0.005
        slips[path] = arm.plant.encoders.mean() - arm.plant.lengths[0]
    assert abs(slips['unbent']) < 0.4 * abs(slips['direct'])


def test_of_a_model_with_more_coordinates_bend_and_length_are_taken():
    arm = running()
    arm.controller.hear_target(TARGET)
    hear = arm.controller.hear_estimate

    def of_affine(now, stamp, tip, q):
        hear(now, stamp, tip, [q[0], q[1], -0.6 * q[0], -0.6 * q[1], q[2]])
        np.testing.assert_array_equal(arm.controller._feedback.coordinates, q)

    arm.controller.hear_estimate = of_affine
    arm.run(4.0)
    assert arm.controller.state is ControlState.RUNNING
    assert np.linalg.norm(arm.tip_estimated - TARGET) < 0.005


def test_stamps_that_stand_still_are_no_news():
    arm = running()
    arm.go(TARGET, 0.5)
    hear = arm.controller.hear_estimate
    stuck = arm.k * 10_000_000
    arm.controller.hear_estimate = lambda now, stamp, *rest: hear(now, stuck, *rest)
    assert 'the estimate of the tip: nothing new' in held(arm)


@pytest.mark.parametrize(
    'target', [(np.nan, 0, 0.1), (0, 0, np.inf), (0, 0, 0), (0.05, 0, -0.01), (0.0, 0.1)]
)
def test_a_target_that_is_none_leaves_the_old_one(target):
    arm = running()
    arm.controller.hear_target(TARGET)
    with pytest.raises(ControlError, match='the one before stays'):
        arm.controller.hear_target(target)
    np.testing.assert_array_equal(arm.controller.target, TARGET)
    assert arm.controller.refused['targets'] == 1


def test_what_is_out_of_reach_is_approached_and_told():
    arm = running(owner=None)
    arm.go([0.0, 0.4, 0.2], 6.0)
    assert arm.controller.state is ControlState.LIMITED
    assert arm.controller.reached.left > 0.1
    assert np.linalg.norm(arm.plant.tip - arm.controller.reached.point) < 0.01
    arm.go(TARGET, 6.0)
    assert arm.controller.state is ControlState.RUNNING
    assert np.linalg.norm(arm.plant.tip - TARGET) < 0.006


@pytest.mark.parametrize(
    ('change', 'why'),
    [
        (lambda q: q[:2], 'expected 3 numbers'),
        (lambda q: q * [1, np.nan, 1], 'expected positive numbers'),
        (lambda q: q * [1, -1, 1], 'expected positive numbers'),
        (lambda q: q + np.array([0, 0.02, 0]), 'from the last ones in 10 ms'),
    ],
)
def test_lengths_that_are_none_are_refused_and_counted_and_then_it_holds(change, why):
    arm = running()
    arm.go(TARGET, 0.5)
    hear, whys = arm.controller.hear_lengths, []

    def wrong(now, stamp, q):
        try:
            hear(now, stamp, change(q))
        except ControlError as error:
            whys.append(str(error))

    arm.controller.hear_lengths = wrong
    assert 'the lengths of the backbones: nothing new' in held(arm)
    assert why in whys[0]
    assert arm.controller.refused['lengths'] == len(whys) > 15


def test_stopping_sends_the_measured_lengths_once():
    arm = running()
    arm.go(TARGET, 0.5)
    n = len(arm.sent)
    arm.controller.stop()
    arm.run(0.3)
    assert len(arm.sent) == n + 1
    assert arm.controller.state is ControlState.STOPPED


def test_backbones_that_do_not_drive_are_refused():
    with pytest.raises(ControlError, match='three a segment'):
        TipController(
            ControllerOptions(),
            segment_lengths=[0.1, 0.1],
            backbones=racks(2).chosen([0, 1, 2]),
            bend_max=1.6,
            stretch=(0.9, 1.1),
            imu_positions={},
        )
