"""The examples do what they say, run as a user runs them."""

import importlib.util
import math
import os
import signal
import tty

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from made_bags import stamps_of, write_bag
from processes import REPOSITORY, Program, command
from sensor_msgs.msg import JointState, MagneticField
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

import sesa2
from sesa2.ros.qos import ANY_BURSTS, STREAM
from sesa2.shape.model import MODELS

EXAMPLES = REPOSITORY / 'examples'


def imported(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f'{name}.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def own_model():
    before = dict(MODELS)
    yield imported('own_model')
    MODELS.clear()
    MODELS.update(before)


def test_a_node_of_ones_own_reads_the_shape(graph, tmp_path):
    with (
        Program([EXAMPLES / 'read_the_shape.py'], tmp_path) as reader,
        command(tmp_path, 'run', '--config', 'prototype3_8', '--source', 'sim') as system,
    ):
        graph.until(lambda: 'tip at' in reader.errors + reader.output, 'the tip')
        reader.signal(signal.SIGINT)
        assert reader.ended() == 0
        assert 'Traceback' not in reader.errors
        system.signal(signal.SIGINT)
        assert system.ended() == 0


def test_a_driver_of_another_imu_is_heard(graph, tmp_path):
    with (
        Program([EXAMPLES / 'imu_driver.py', *range(1, 9)], tmp_path) as driver,
        command(tmp_path, 'run', '--config', 'prototype3_8', '--source', 'external') as system,
    ):
        tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
        graph.until(lambda: len(tips) > 50, 'fifty results')
        for program in (driver, system):
            program.signal(signal.SIGINT)
            assert program.ended() == 0
            assert 'Traceback' not in program.errors
    # It swings about x: the tip stays in the plane of y and z.
    for tip in tips:
        assert abs(tip.pose.position.x) < 1e-9
        assert tip.pose.position.z > 0.5


def test_counts_of_encoders_become_lengths(graph, tmp_path):
    per_count = math.pi * 0.012 / 2048
    device, port = os.openpty()
    tty.setraw(port)
    try:
        with Program(
            [EXAMPLES / 'length_driver.py', '--port', os.ttyname(port), 'b1', 'b2', 'b3'], tmp_path
        ) as driver:
            heard = graph.listen(JointState, 'backbone_lengths', ANY_BURSTS)

            def say(line):
                before = len(heard)
                os.write(device, line)
                return before

            # The first line may be the end of one that began before anybody listened.
            def begun():
                say(b'100 -32768 0\n')
                return heard

            graph.until(begun, 'the driver')
            graph.until(lambda: heard[-1].name == ['b1', 'b2', 'b3'], 'its names')
            np.testing.assert_allclose(heard[-1].position, 0.12)
            say(b'200 32767 -50\n')  # the second has run over
            graph.until(lambda: heard[-1].position[0] > 0.1201, 'another length')
            np.testing.assert_allclose(
                np.subtract(heard[-1].position, 0.12), per_count * np.array([100, -1, -50]), atol=1e-12
            )
            assert heard[-1].header.stamp.sec > 1_700_000_000
            n = say(b'1 2\n')
            say(b'1 x 3\n')
            say(b'300 32')  # a line in two pieces
            say(b'767 -50\n')
            graph.until(lambda: len(heard) > n and heard[-1].position[0] > 0.12 + 199 * per_count, 'the next')
            assert all(len(m.position) == 3 for m in heard)
            assert min(m.position[2] for m in heard) > 0.12 - 51 * per_count  # the damaged ones are none
            driver.until(lambda: 'lines damaged' in driver.errors, 'what it says of damaged lines')
            driver.signal(signal.SIGINT)
            assert driver.ended() == 0
            assert 'Traceback' not in driver.errors
    finally:
        os.close(device)
        os.close(port)


def test_lengths_of_motors_that_nobody_has_are_heard_too(graph, tmp_path):
    with Program([EXAMPLES / 'length_driver.py', 'b1', 'b2', 'b3'], tmp_path) as driver:
        heard = graph.listen(JointState, 'backbone_lengths', ANY_BURSTS)
        graph.until(lambda: len(heard) > 50, 'fifty lengths')
        driver.signal(signal.SIGINT)
        assert driver.ended() == 0
        assert 'Traceback' not in driver.errors
    lengths = np.array([m.position for m in heard])
    assert (np.abs(lengths - 0.12) < 0.08).all()
    assert 0.0 < np.abs(np.diff(lengths, axis=0)).max() < 1e-3


def test_fields_of_made_up_chips_become_a_shape(graph, tmp_path):
    with (
        Program([EXAMPLES / 'magnetometer_driver.py', 1, 2, 3], tmp_path) as driver,
        command(tmp_path, 'run', '--config', 'magnetic_1', '--source', 'external') as system,
    ):
        tips = graph.listen(PoseStamped, 'magnetic/tip', STREAM)
        fields = graph.listen(MagneticField, 'magnetometer_2/field', ANY_BURSTS)
        graph.until(lambda: len(tips) > 20, 'twenty results')
        graph.until(lambda: any(math.isnan(m.magnetic_field.x) for m in fields), 'an axis that overflows')
        for program in (driver, system):
            program.signal(signal.SIGINT)
            assert program.ended() == 0
            assert 'Traceback' not in program.errors
    assert fields[0].header.frame_id == 'magnetometer_2'
    assert fields[0].header.stamp.sec > 1_700_000_000
    z = np.array([m.magnetic_field.z for m in fields])
    assert (np.abs(z + 6.2e-4) < 2.1e-5).all()
    np.testing.assert_allclose(z / 150e-9, np.round(z / 150e-9), atol=1e-6)
    for tip in tips:
        assert tip.pose.position.z > 0.08
        assert abs(tip.pose.position.x) < 0.05


def test_a_chip_that_does_not_answer_is_silent_and_one_that_overflows_is_nan_there(graph):
    example = imported('magnetometer_driver')
    # Little-endian with a sign; 150 nT a count.
    np.testing.assert_allclose(
        example.field_of(b'\x01\x00\xfe\xff\x00\x10'), [150e-9, -300e-9, 4096 * 150e-9]
    )
    answers = {0: b'\x00\x80\x02\x7d\x00\x7d', 1: OSError(121, 'Remote I/O error')}

    def read(place):
        if isinstance(answers[place], OSError):
            raise answers[place]
        return answers[place]

    lines = graph.listen_to_logs()
    graph.add(example.MagnetometerDriver([4, 7], read))
    of_4 = graph.listen(MagneticField, 'magnetometer_4/field', ANY_BURSTS)
    of_7 = graph.listen(MagneticField, 'magnetometer_7/field', ANY_BURSTS)
    graph.until(lambda: len(of_4) > 5, 'fields')
    field = of_4[-1].magnetic_field
    assert math.isnan(field.x)  # has overflowed
    assert math.isnan(field.y)  # beyond what is linear
    assert field.z == pytest.approx(32000 * 150e-9)
    assert not of_7
    assert any('the last of magnetometer 7' in line.msg for line in lines)
    answers[1] = b'\x00\x00\x00\x00\x0a\x00'
    graph.until(lambda: of_7, 'the chip that answers again')
    assert of_7[0].magnetic_field.z == pytest.approx(1.5e-6)


def test_motors_go_where_they_are_commanded_and_say_where_they_are(graph, tmp_path):
    per_count = math.pi * 0.012 / 2048
    with Program([EXAMPLES / 'motor_driver.py', 'b1', 'b2', 'b3'], tmp_path) as driver:
        heard = graph.listen(JointState, 'backbone_lengths', ANY_BURSTS)
        commands = graph.probe.create_publisher(JointTrajectory, 'command', STREAM)
        graph.matched('command')
        graph.until(lambda: heard, 'lengths')
        assert heard[0].name == ['b1', 'b2', 'b3']
        np.testing.assert_allclose(heard[0].position, 0.12)

        def command_them(names, *lengths, points=1):
            point = JointTrajectoryPoint(positions=lengths)
            commands.publish(JointTrajectory(joint_names=names, points=[point] * points))

        command_them(['b3', 'b1', 'b2'], 0.16, 0.10, 0.15)  # by name
        wanted = np.array([0.10, 0.15, 0.16])
        graph.until(
            lambda: np.abs(heard[-1].position - wanted).max() <= 0.5 * per_count + 1e-12, 'the motors'
        )
        counts = (np.array([m.position for m in heard]) - 0.12) / per_count
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
        # On the way, not at once; those that fell out between two that were heard are as many steps.
        assert len({tuple(m.position) for m in heard}) > 10
        for names, lengths, points in (
            (['b1', 'b2'], (0.12, 0.12), 1),
            (['b1', 'b2', 'x'], (0.12, 0.12, 0.12), 1),
            (['b1', 'b2', 'b3'], (0.12, math.nan, 0.12), 1),
            (['b1', 'b2', 'b3'], (0.12, 0.12, 0.4), 1),
            (['b1', 'b2', 'b3'], (0.12, 0.12, 0.12), 2),
        ):
            command_them(names, *lengths, points=points)
        driver.until(lambda: 'commands refused' in driver.errors, 'what it says of wrong commands')
        n = len(heard)
        graph.until(lambda: len(heard) > n + 20, 'more lengths')
        np.testing.assert_allclose(heard[-1].position, wanted, atol=0.5 * per_count + 1e-12)
        driver.signal(signal.SIGINT)
        assert driver.ended() == 0
        assert 'Traceback' not in driver.errors


def test_replay_and_evaluate_from_python(tmp_path):
    with command(
        tmp_path, 'twin', '--config', 'prototype3_8', '--out', 'trial', '--seconds', 20, '--error', 'white=0'
    ) as twin:
        assert twin.ended() == 0
    with Program([EXAMPLES / 'replay_and_evaluate.py', 'trial', 'estimate'], tmp_path) as example:
        assert example.ended() == 0, example.errors
        lines = example.output.splitlines()
        assert 'sweeps of' in lines[0]
        assert [' '.join(line.split()[:2]) for line in lines if ': median' in line] == [
            'pcc M1:',
            'pcc M2:',
            'spline M1:',
            'spline M2:',
        ]
    with Program([EXAMPLES / 'replay_and_evaluate.py', 'nowhere', 'other'], tmp_path) as example:
        assert example.ended() == 1
        assert example.errors.startswith('error: nowhere: no such file')


def test_a_model_of_ones_own_is_a_model_like_ours(own_model, tmp_path):
    c = sesa2.load_configuration('prototype3_8')
    write_bag(tmp_path / 'recording', range(1, 9), stamps_of(1.0))
    summary = sesa2.replay(tmp_path / 'recording', c, tmp_path / 'out', models=['one_arc'])
    assert summary.messages['/one_arc/tip'] == summary.sweeps > 90
    # A quarter of a circle of length 0.64 m, about x.
    q = np.tile([0.0, 0.0, 0.0, 1.0], (8, 1))
    q[-1] = [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
    [end] = c.create_model('one_arc').fit(sesa2.Measured(q)).positions([0.64])
    r = 0.64 / (0.5 * math.pi)
    np.testing.assert_allclose(end, [0.0, -r, r], atol=1e-12)
    own_model.main()
