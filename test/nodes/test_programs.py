"""Each node as a program of its own, as `ros2 run` starts it: it starts, ends cleanly, and fails clearly."""

import os
import select
import signal
import tty
from contextlib import ExitStack

import pytest
from made_bags import stamps_of, write_bag
from processes import REPOSITORY, command, failed_clearly, node
from virtual_arms import arm_of

from sesa2.bags.recording import open_recording
from sesa2.configuration import files, validate
from sesa2.link.serial_port import SerialPort

PROTOTYPE = REPOSITORY / 'config/prototype3_8.yaml'
NODES = ('serial_bridge', 'estimator', 'calibration', 'recorder', 'player')
SIGNALS = [signal.SIGINT, signal.SIGTERM]


@pytest.fixture
def board(boards):
    return boards(arm_of(files.load(PROTOTYPE)))


def arguments(name, folder, board):
    """What a node needs beside the shipped configuration."""
    given = {
        'serial_bridge': ('serial.port', board.path),
        'calibration': ('calibration.file', folder / 'offsets.yaml'),
        'recorder': ('record.file', folder / 'bag'),
        'player': ('run.bag', folder / 'played'),
    }
    own = ('-p', '{}:={}'.format(*given[name])) if name in given else ()
    if name == 'player':  # its IMUs are not to be mixed with the board's
        own += ('-r', '__ns:=/played')
    return ('--ros-args', '--params-file', PROTOTYPE, *own)


@pytest.mark.parametrize('number', SIGNALS)
def test_each_node_ends_cleanly(graph, board, tmp_path, number):
    write_bag(tmp_path / 'played', range(1, 9), stamps_of(60.0))
    with ExitStack() as stack:
        programs = {
            name: stack.enter_context(node(name, tmp_path, *arguments(name, tmp_path, board)))
            for name in NODES
        }
        graph.until(lambda: set(NODES) <= set(graph.probe.get_node_names()), 'all nodes')
        # All is under way: the link's thread and the player's run, and the recorder writes.
        diagnosis = graph.diagnosis()

        def under_way():
            parts = {
                name: diagnosis.latest(name)
                for name in ('serial_bridge: link', 'played/player: bag', 'recorder: bag')
            }
            return (
                all(parts.values())
                and int(parts['serial_bridge: link'][2]['sweeps']) > 10
                and int(parts['played/player: bag'][2]['samples']) > 10
                and int(parts['recorder: bag'][2]['messages']) > 100
            )

        graph.until(under_way, 'that all is under way')
        for program in programs.values():
            program.signal(number)
        for name, program in programs.items():
            assert program.ended() == 0, f'{name}: {program.errors}'
            assert 'Traceback' not in program.errors, f'{name}: {program.errors}'
            assert 'error' not in program.errors.lower(), f'{name}: {program.errors}'
    with open_recording(tmp_path / 'bag') as recording:
        assert not recording.problems
        assert recording.topics['/rigid/tip'].count > 10
    SerialPort(board.path, 500_000).close()  # it was given free


@pytest.mark.parametrize('number', SIGNALS)
def test_a_bridge_that_waits_for_its_board_ends_cleanly(tmp_path, number):
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    port = ('-p', f'serial.port:={os.ttyname(theirs)}')
    with node('serial_bridge', tmp_path, '--ros-args', '--params-file', PROTOTYPE, *port) as program:
        # It says HELLO, for three seconds, and nobody answers.
        program.until(lambda: select.select([ours], [], [], 0)[0], 'HELLO')
        program.signal(number)
        assert program.ended() == 0, program.errors
        assert program.errors == ''
    os.close(theirs)
    os.close(ours)


@pytest.mark.parametrize('number', SIGNALS)
def test_run_ends_cleanly(tmp_path, number):
    with command(
        tmp_path, 'run', '--config', PROTOTYPE, '--source', 'sim', '--record', tmp_path / 'bag'
    ) as program:
        program.until(lambda: 'rigid tip' in program.output, 'the first line')
        program.signal(number)
        assert program.ended() == 0, program.errors
        assert 'Traceback' not in program.errors
        assert 'sweeps estimated' in program.output.splitlines()[-1]
    with open_recording(tmp_path / 'bag') as recording:
        assert not recording.problems
        assert recording.topics['/rigid/tip'].count > 10


# Wrong configurations

WRONG = {
    'syntax': ('/**:\n  ros__parameters:\n    arm: {length: 0.3\n', 'wrong.yaml: 1 mistake\n  line '),
    'misspelt': (
        '/**:\n  ros__parameters:\n    arm: {lenght: 0.3}\n    imus: {ids: [1], positions: [0.1]}\n',
        'arm.lenght: is not known; did you mean arm.length?',
    ),
    'integer': (
        '/**:\n  ros__parameters:\n    arm: {length: 0.3}\n    imus: {ids: [1, 2], positions: [0.1, 1]}\n',
        'imus.positions[1]: got the integer 1 among numbers, which ROS cannot read; write 1.0',
    ),
    'range': (
        '/**:\n  ros__parameters:\n    arm: {length: 0.3}\n    imus: {ids: [1, 9], positions: [0.1, 0.2]}\n',
        'imus.ids[1]: got 9, expected 1 to 8',
    ),
    'missing': (None, 'wrong.yaml: 1 mistake\n  cannot be read: No such file'),
}


@pytest.mark.parametrize('wrong', WRONG)
def test_a_wrong_file_ends_each_node_with_1_and_why(tmp_path, wrong):
    text, expected = WRONG[wrong]
    file = tmp_path / 'wrong.yaml'
    if text is not None:
        file.write_text(text)
    with ExitStack() as stack:
        for program in [
            stack.enter_context(node(name, tmp_path, '--ros-args', '--params-file', file)) for name in NODES
        ]:
            assert failed_clearly(program, expected)


def test_an_integer_for_a_number_is_taken_where_ros_can_read_it(graph, tmp_path):
    file = tmp_path / 'arm.yaml'
    file.write_text('/**:\n  ros__parameters:\n    arm: {length: 1}\n    imus: {ids: [1], positions: [1]}\n')
    here = ('-r', '__ns:=/integer')
    with node('estimator', tmp_path, '--ros-args', *here, '--params-file', file) as program:
        own = ('estimator', '/integer')
        graph.until(
            lambda: own in graph.probe.get_node_names_and_namespaces() or not program.running, 'the node'
        )
        program.signal(signal.SIGTERM)
        assert program.ended() == 0, program.errors


def test_what_a_node_cannot_do_without_is_named(tmp_path):
    expected = {
        'calibration': 'calibration.file: is empty, expected the file to keep offsets in',
        'recorder': 'record.file: is empty, expected a bag to write',
        'player': 'run.bag: is empty, expected a recording to play',
    }
    config = tmp_path / 'arm.yaml'
    config.write_text(
        files.dump(validate({'arm': {'length': 0.3}, 'imus': {'ids': [1], 'positions': [0.1]}}))
    )
    with ExitStack() as stack:
        programs = {
            name: stack.enter_context(node(name, tmp_path, '--ros-args', '--params-file', config))
            for name in expected
        }
        for name, program in programs.items():
            assert failed_clearly(program, expected[name])
