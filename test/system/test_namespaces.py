"""Runs beside one another: each in a namespace of its own, or refused; as processes on a real graph."""

import signal
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from processes import Program, command, failed_clearly, node
from sensor_msgs.msg import Imu
from std_msgs.msg import Empty

from sesa2.bags.reading import read_poses
from sesa2.bags.recording import open_recording
from sesa2.configuration import files, validate
from sesa2.ros.qos import STREAM
from sesa2.system.claims import claimed_topics

RUN = ('run', '--config', 'prototype3_4', '--source', 'sim')
# Never known before it starts, as with a network that is slow.
LATE = """
import sys
import sesa2.system.claims as claims
claims._DISCOVERY_S = 0.0
claims.Claims.check = lambda self, configuration: None
from sesa2.cli import main
sys.exit(main(sys.argv[1:]))
"""
# As long as the graph has not made the two known to each other, which takes some seconds at times.
UNKNOWN = """
import sys
import sesa2.system.claims as claims
claims._DISCOVERY_S = 0.0
claims.Claims._rival = lambda *_, **__: None
from sesa2.cli import main
sys.exit(main(sys.argv[1:]))
"""


def end(program):
    program.signal(signal.SIGINT)
    assert program.ended() == 0, program.errors
    assert 'Traceback' not in program.errors


def running(program):
    program.until(lambda: 'pcc tip' in program.output, 'the shape')


def test_two_arms_in_two_namespaces_do_not_meet(tmp_path, graph):
    said = []
    graph.probe.create_subscription(DiagnosticArray, '/diagnostics', said.append, 100)
    with (
        command(tmp_path, *RUN, '--namespace', 'left', '--record', 'one') as left,
        command(tmp_path, *RUN, '--namespace', '/lab/right', '--record', 'two') as right,
    ):
        running(left)
        running(right)
        tips = {ns: graph.listen(PoseStamped, f'/{ns}/pcc/tip', STREAM) for ns in ('left', 'lab/right')}
        graph.until(lambda: all(len(m) > 20 for m in tips.values()), 'tips of both')

        def named():
            return {status.name for array in said for status in array.status}

        wanted = {'left/estimator: imu_2', 'lab/right/serial_bridge: link'}
        graph.until(lambda: wanted <= named(), 'what both say')
        names = named()
        assert all(name.startswith(('left/', 'lab/right/')) for name in names)
        services = {name for name, _ in graph.probe.get_service_names_and_types()}
        assert {'/left/estimator/align', '/lab/right/estimator/save'} <= services
        nodes = {n for n, ns in graph.probe.get_node_names_and_namespaces() if ns in ('/left', '/lab/right')}
        assert {'estimator', 'serial_bridge', 'recorder'} <= nodes
        strays = {
            name
            for name, _ in graph.probe.get_topic_names_and_types()
            if not name.startswith(('/left/', '/lab/right/'))
        }
        assert strays <= {'/diagnostics', '/rosout', '/parameter_events'}
        assert graph.probe.count_publishers('/left/pcc/tip') == 1
        for program in (left, right):
            end(program)
            assert 'lost 0 sweeps' in program.output
    for bag, namespace in (('one', '/left/'), ('two', '/lab/right/')):
        with open_recording(tmp_path / bag) as recording:
            assert all(name.startswith(namespace) for name in recording.topics)
            counts = {name: topic.count for name, topic in recording.topics.items()}
        assert counts[f'{namespace}configuration'] == 1
        assert counts[f'{namespace}imu_2/data'] > 20
        assert counts[f'{namespace}pcc/tip'] > 20


def test_a_second_run_of_the_same_topics_ends_and_the_first_goes_on(tmp_path):
    with command(tmp_path, *RUN) as first:
        running(first)
        with command(tmp_path, *RUN) as second:
            assert failed_clearly(
                second, 'another `sesa2 run` ', ' publishes /', '--namespace', 'ROS_DOMAIN_ID'
            )
        told = first.output.count('pcc tip')
        first.until(lambda: first.output.count('pcc tip') > told + 2, 'that it goes on')
        end(first)


def test_late_discovery_ends_the_younger(tmp_path):
    with Program(['-c', LATE, *RUN], tmp_path) as first:
        running(first)
        with Program(['-c', LATE, *RUN], tmp_path) as second:
            assert failed_clearly(second, ' of another `sesa2 run` publishes /')
        told = first.output.count('pcc tip')
        first.until(lambda: first.output.count('pcc tip') > told + 2, 'that it goes on')
        end(first)


def test_on_one_machine_a_second_run_is_refused_before_the_graph_knows_of_it(tmp_path):
    with Program(['-c', UNKNOWN, *RUN], tmp_path) as first:
        running(first)
        with Program(['-c', UNKNOWN, *RUN], tmp_path) as second:
            assert failed_clearly(second, 'another `sesa2 run` on this machine publishes /', '--namespace')
            assert 'pcc tip' not in second.output
        with Program(['-c', UNKNOWN, *RUN, '--namespace', 'left'], tmp_path) as beside:
            running(beside)
            end(beside)
        first.signal(signal.SIGKILL)
        assert first.ended() == -signal.SIGKILL
    with Program(['-c', UNKNOWN, *RUN, '--duration', '3'], tmp_path) as third:
        assert third.ended() == 0, third.errors


def test_of_two_that_start_at_once_one_is_left(tmp_path):
    with Program(['-c', LATE, *RUN], tmp_path) as one, Program(['-c', LATE, *RUN], tmp_path) as other:
        deadline = time.monotonic() + 60.0
        while one.running and other.running:
            assert time.monotonic() < deadline, 'both go on'
            time.sleep(0.05)
        ended, left = (other, one) if one.running else (one, other)
        assert failed_clearly(ended, 'publishes /')
        told = left.output.count('pcc tip')
        left.until(lambda: left.output.count('pcc tip') > told + 3, 'that it goes on')
        end(left)


def test_another_program_that_publishes_the_same_ends_a_run(tmp_path, graph):
    graph.probe.create_publisher(PoseStamped, '/pcc/tip', STREAM)
    with command(tmp_path, *RUN) as program:
        assert failed_clearly(program, 'of another program publishes /pcc/tip already')


def test_a_run_that_was_killed_is_no_hindrance(tmp_path):
    with command(tmp_path, *RUN) as first:
        running(first)
        first.signal(signal.SIGKILL)
        assert first.ended() == -signal.SIGKILL
    with command(tmp_path, *RUN, '--duration', '3') as second:
        assert second.ended() == 0, second.errors


def test_a_bridge_and_an_estimator_may_be_two_programs(tmp_path, graph):
    with command(tmp_path, 'board', '--config', 'prototype3_4', '--link', 'board') as board:
        board.until(lambda: (tmp_path / 'board').exists(), 'a port')
        arguments = ['--ros-args', '-p', f'serial.port:={tmp_path}/board']
        for key, value in (
            ('arm.length', '0.66'),
            ('imus.ids', '[2,4,6,8]'),
            ('imus.positions', '[0.1,0.2,0.3,0.6]'),
        ):
            arguments += ['-p', f'{key}:={value}']
        with node('serial_bridge', tmp_path, *arguments) as bridge:
            graph.listen(Imu, 'imu_2/data', STREAM)
            with command(tmp_path, 'run', '--config', 'prototype3_4', '--source', 'external') as run:
                running(run)
                end(run)
            end(bridge)
        end(board)


def test_two_pages_in_one_namespace_are_refused(tmp_path, graph):
    graph.probe.create_publisher(Empty, '/left/_run/page', 1)
    with command(tmp_path, *RUN, '--namespace', 'left', '--viewer', '0') as program:
        assert failed_clearly(program, 'is steered from a page here')


def claimed(**run):
    imus = {'ids': [1], 'positions': [0.3], 'topics': ['/drv/imu']}
    record = {'file': 'x'}
    return set(
        claimed_topics(
            validate(
                {'run': run, 'arm': {'length': 0.3}, 'imus': imus, 'models': ['pcc'], 'record': record}
                | {'calibration': {'file': 'f'}}
            )
        )
    )


@pytest.mark.parametrize(
    ('run', 'imus', 'results', 'clock'),
    [
        ({'source': 'external'}, False, True, False),
        ({'source': 'sim'}, True, True, False),
        ({'source': 'serial', 'mode': 'calibrate'}, True, False, False),
        ({'source': 'bag', 'bag': 'b'}, True, True, False),
        ({'source': 'bag', 'bag': 'b', 'clock': True}, True, True, True),
    ],
)
def test_what_a_run_publishes(run, imus, results, clock):
    topics = claimed(**run)
    assert ('/drv/imu' in topics) is imus
    assert ({'pcc/tip', 'pcc/joint_states', 'pcc/markers', 'pcc/shape'} <= topics) is results
    assert ('/clock' in topics) is clock


@pytest.mark.parametrize('bad', ['a b', 'left/', '3', 'a//b', '~', ''])
def test_namespaces_that_are_none(tmp_path, bad):
    with command(tmp_path, *RUN, '--namespace', bad) as program:
        assert program.ended() == 2
        assert 'expected a namespace' in program.errors


def test_topics_of_any_name_live_recorded_and_played(tmp_path):
    values = {
        'arm': {'length': 0.3, 'frame_prefix': 'left_'},
        'imus': {'ids': [1, 4], 'positions': [0.1, 0.3], 'topics': ['/drv/near', 'far/data']},
        'markers': {'names': ['A'], 'positions': [0.2]},
        'models': ['pcc'],
    }
    (tmp_path / 'arm.yaml').write_text(files.dump(validate(values)))
    run = ('run', '--config', 'arm.yaml', '--namespace', 'left')
    expected = {'/drv/near', '/left/far/data', '/left/pcc/tip', '/left/pcc/shape', '/left/configuration'}
    with command(tmp_path, *run, '--source', 'sim', '--record', 'one') as program:
        program.until(lambda: program.output.count('pcc tip') > 2, 'the shape')
        end(program)
    with command(tmp_path, *run, '--source', 'bag', '--bag', 'one', '--record', 'two') as program:
        assert program.ended() == 0, program.errors
        assert 'pcc tip' in program.output
    for bag in ('one', 'two'):
        with open_recording(tmp_path / bag) as recording:
            counts = {name: topic.count for name, topic in recording.topics.items() if topic.count}
            message = next(recording.messages(['/drv/near']))
        assert expected <= set(counts)
        assert not any('imu_1/data' in name or 'imu_4/data' in name for name in counts)
        assert b'left_imu_1\0' in message.data
        assert read_poses(tmp_path / bag, 'pcc/markers').frame == 'left_base_link'


def test_a_bag_of_an_arm_that_grows_is_played_with_its_lengths():
    values = {
        'arm': {'length': 0.3},
        'imus': {'ids': [1], 'positions': [0.3]},
        'segments': {'lengths': [0.3]},
        'lengths': {'names': ['b1']},
    }
    for source, played in (('bag', True), ('external', False)):
        topics = claimed_topics(validate({**values, 'run': {'source': source, 'bag': 'b'}}))
        assert ('backbone_lengths' in topics) is played
