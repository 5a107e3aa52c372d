"""`sesa2 run --config tri_backbone --source sim`: the whole system on an arm that grows, bends and obeys."""

import re
import signal
from dataclasses import replace

import numpy as np
from geometry_msgs.msg import PoseStamped
from processes import command, failed_clearly
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from sesa2.cli import main
from sesa2.configuration import files
from sesa2.nodes.plant import PlantNode
from sesa2.ros.parameters import overrides
from sesa2.ros.qos import STREAM
from sesa2.system.claims import claimed_topics


def position(message):
    p = message.pose.position
    return np.array([p.x, p.y, p.z])


def test_it_grows_and_bends_by_itself_and_is_felt(graph, tmp_path):
    with command(
        tmp_path, 'run', '--config', 'tri_backbone', '--source', 'sim', '--record', 'bag'
    ) as program:
        felt = graph.listen(PoseStamped, 'pcc_delta/tip', STREAM)
        true = graph.listen(PoseStamped, 'truth/tip', STREAM)
        graph.until(lambda: true and np.hypot(*position(true[-1])[:2]) > 0.05, 'it bends')
        graph.until(lambda: np.ptp([position(m)[2] for m in true]) > 0.03, 'it grows')
        graph.until(lambda: len(felt) > 100, 'estimates')
        program.until(
            lambda: len(re.findall(r'\(\S+ mm off\)', program.output)) > 3, 'distances from the truth'
        )
        program.signal(signal.SIGINT)
        assert program.ended() == 0, program.errors
        assert 'Traceback' not in program.errors
    at = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in true])
    where = np.array([position(m) for m in true])
    for m in felt[::20]:
        t = m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec
        if at[0] < t < at[-1]:
            there = [np.interp(t, at, where[:, k]) for k in range(3)]
            assert np.linalg.norm(position(m) - there) < 0.06
    with AnyReader([tmp_path / 'bag']) as bag:
        counts = {c.topic: c.msgcount for c in bag.connections}
    for topic in ('/backbone_lengths', '/imu_1/data', '/imu_2/data', '/truth/tip', '/truth/coordinates'):
        assert counts[topic] > 50, topic
    assert main(['evaluate', str(tmp_path / 'bag'), '--truth', str(tmp_path / 'bag')]) == 0


def test_it_obeys_commands_and_the_estimate_follows(graph, tmp_path):
    c = files.load_configuration('tri_backbone')
    ideal = dict.fromkeys(('slip', 'affine', 'affine_spread', 'hollow', 'sag', 'imu_errors'), 0.0)
    (tmp_path / 'arm.yaml').write_text(files.dump(replace(c, plant=replace(c.plant, **ideal))))
    commands = graph.probe.create_publisher(JointTrajectory, 'command', STREAM)
    with command(tmp_path, 'run', '--config', 'arm.yaml', '--source', 'sim') as program:
        felt = graph.listen(PoseStamped, 'pcc_delta/tip', STREAM)
        said = graph.listen(JointState, 'backbone_lengths', STREAM)
        graph.matched('command')
        point = JointTrajectoryPoint(positions=[0.15, 0.18, 0.18])
        commands.publish(JointTrajectory(joint_names=['b1', 'b2', 'b3'], points=[point]))
        graph.until(lambda: said and np.allclose(said[-1].position, [0.15, 0.18, 0.18], atol=1e-4), 'lengths')
        del felt[:]
        graph.until(lambda: len(felt) > 100, 'estimates at rest')
        # Bend 2/(3·0.03) · 0.03 towards x, and 170 mm: p = L/θ (1 − cos θ, 0, sin θ).
        theta = 2.0 / 3.0
        expected = 0.17 / theta * np.array([1.0 - np.cos(theta), 0.0, np.sin(theta)])
        np.testing.assert_allclose(position(felt[-1]), expected, atol=1e-3)
        program.until(lambda: '(0.' in program.output, 'next to no distance from the truth')
        program.signal(signal.SIGINT)
        assert program.ended() == 0, program.errors


def test_a_second_publisher_of_its_lengths_is_found(graph, configured, tmp_path):
    shipped = files.load_configuration('tri_backbone')
    assert {'backbone_lengths', 'truth/tip', 'imu_2/data'} <= set(claimed_topics(shipped))
    assert 'command' not in claimed_topics(shipped)
    graph.add(PlantNode(parameter_overrides=overrides(shipped)))
    with command(tmp_path, 'run', '--config', 'tri_backbone', '--source', 'sim') as program:
        assert program.ended() == 1
        assert 'publishes /' in program.errors
        assert 'Traceback' not in program.errors


def test_a_trial_of_an_arm_that_grows_is_played_from_its_bag(tmp_path):
    with command(
        tmp_path, 'run', '--config', 'tri_backbone', '--source', 'sim', '--trial', 'somewhere'
    ) as program:
        assert failed_clearly(program, 'run.trial', 'expected its bag with the source bag')
