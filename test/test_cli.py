"""The entry point: what people type, and what they are told when it cannot be done."""

import os
import resource
import signal
import subprocess
import sys

import numpy as np
import pytest
import yaml
from made_bags import T0, cut, stamps_of, write_bag
from processes import REPOSITORY, command, failed_clearly
from virtual_arms import arm_of

from sesa2.bags.recording import open_recording
from sesa2.bags.writing import new_bag
from sesa2.cli import main
from sesa2.configuration import files
from sesa2.link.serial_port import SerialPort
from sesa2.link.virtual.virtual_board import VirtualBoard
from sesa2.sensing.imu.bno055.offsets import Offsets, save_offsets

SHIPPED = sorted((REPOSITORY / 'config').glob('*.yaml'))
OFFSETS = Offsets((1, -2, 3), (400, -500, 600), (-7, 8, -9), 1001, 777)

GOOD = {
    'arm': {'length': 0.3},
    'imus': {'ids': [2, 5], 'positions': [0.1, 0.3]},
    'markers': {'names': ['A', 'B'], 'positions': [0.1, 0.3]},
    'models': ['pcc'],
}


def text_of(**sections):
    """A configuration's file, with some keys of its sections changed."""
    values = dict(GOOD)
    for name, section in sections.items():
        values[name] = {**GOOD.get(name, {}), **section} if isinstance(section, dict) else section
    return yaml.safe_dump({'/**': {'ros__parameters': values}})


@pytest.fixture
def config(tmp_path):
    """Writes a configuration; its path."""

    def write(text=None, **sections):
        file = tmp_path / 'arm.yaml'
        file.write_text(text_of(**sections) if text is None else text)
        return file

    return write


def fails(capfd, arguments, *expected):
    """Run a command that is to end with 1 and say all this."""
    assert main([str(a) for a in arguments]) == 1
    errors = capfd.readouterr().err
    assert errors.startswith('error: ')
    assert 'Traceback' not in errors
    for text in expected:
        assert text in errors, errors


# check


@pytest.mark.parametrize('file', SHIPPED, ids=lambda file: file.stem)
def test_shipped_configurations_are_explained_by_path_and_by_name(capfd, file):
    c = files.load(file)
    assert main(['check', str(file)]) == 0
    by_path = capfd.readouterr().out
    assert main(['check', file.stem]) == 0
    assert capfd.readouterr().out == by_path
    lines = by_path.splitlines()
    for i, s in zip(c.imus.ids, c.imus.positions, strict=True):
        board, channel = divmod(i - 1, 8)
        row = [str(i), *c.serial.ports[board : board + 1], str(channel), f'{s:.4f}']
        assert any(line.split()[: len(row)] == row for line in lines)
    for name, s in zip(c.markers.names, c.markers.positions, strict=True):
        assert any(line.split() == [name, f'{s:.4f}'] for line in lines)
    for model in c.models:
        assert f'{model}/joint_states' in by_path


WRONG = {
    'YAML syntax': ('/**:\n  ros__parameters: {arm: [}\n', 'line 2, column 27: YAML: '),
    'no parameters': ('arm: {length: 0.3}\n', "arm: is not read, expected '/**:'"),
    'misspelt key': ({'arm': {'lenght': 0.3}}, 'arm.lenght: is not known; did you mean arm.length?'),
    'integer among numbers': (
        {'imus': {'positions': [0.1, 1]}},
        'imus.positions[1]: got the integer 1 among numbers, which ROS cannot read; write 1.0',
    ),
    'number for an integer': ({'imus': {'ids': [2, 5.5]}}, 'imus.ids[1]: got 5.5, expected an integer'),
    'unknown id': ({'imus': {'ids': [2, 9]}}, 'imus.ids[1]: got 9, expected 1 to 8'),
    'duplicate ids': ({'imus': {'ids': [2, 2]}}, 'imus.ids[1]: got 2 a second time'),
    'duplicate markers': ({'markers': {'names': ['A', 'A']}}, "markers.names[1]: got 'A' a second time"),
    'marker beyond the tip': (
        {'markers': {'positions': [0.1, 0.4]}},
        'markers.positions[1]: 0.4 m is beyond the tip at 0.3 m',
    ),
    'unsorted positions': (
        {'imus': {'positions': [0.3, 0.1]}},
        'imus.positions[1]: 0.1 m is not after 0.3 m',
    ),
    'too few positions': ({'imus': {'positions': [0.1]}}, 'imus.positions: has 1 entries, expected 2'),
    'too many flags': ({'imus': {'enabled': [True] * 3}}, 'imus.enabled: has 3 entries, expected 2'),
    'no unit quaternion': (
        {'arm': {'base_orientation': [0.0, 0.0, 0.0, 0.5]}},
        'arm.base_orientation: has norm 0.5, expected a unit quaternion',
    ),
    'unknown model': ({'models': ['pc']}, "models[0]: got 'pc', expected one of "),
}


@pytest.mark.parametrize('wrong', WRONG)
def test_check_says_what_is_wrong_and_where(capfd, config, wrong):
    given, expected = WRONG[wrong]
    file = config(given) if isinstance(given, str) else config(**given)
    fails(capfd, ['check', file], f'{file}: 1 mistake', expected)


def test_check_says_every_mistake_at_once(capfd, config):
    file = config(imus={'ids': [2, 0], 'postions': [1.0]}, arm={'length': -1.0}, models=['pc'])
    fails(capfd, ['check', file], '4 mistakes', 'imus.ids[1]', 'imus.postions', 'arm.length', 'models[0]')


def test_check_lists_what_there_is_when_a_name_is_not_known(capfd, tmp_path):
    fails(capfd, ['check', 'prototyp'], 'no such file', 'prototype3_8', 'single_section')
    fails(capfd, ['check', tmp_path], 'is a folder')


@pytest.mark.parametrize(
    'arguments',
    [
        [],
        ['walk'],
        ['check'],
        ['run'],
        ['run', '--config', 'prototype3_8', '--source', 'usb'],
        ['run', '--config', 'prototype3_8', '--rate', '0'],
        ['run', '--config', 'prototype3_8', '--start', '-1'],
        ['run', '--config', 'prototype3_8', '--duration', 'long'],
        ['replay', 'bag', '--config', 'prototype3_8'],
    ],
    ids=' '.join,
)
def test_wrong_usage_ends_with_2(capfd, arguments):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert 'usage: sesa2' in capfd.readouterr().err


def test_a_reader_that_leaves_is_no_failure():
    reader, writer = os.pipe()
    os.close(reader)
    arguments = [sys.executable, '-m', 'sesa2.cli', 'check', 'prototype3_8']
    program = subprocess.run(
        arguments, stdout=writer, stderr=subprocess.PIPE, env={**os.environ, 'PYTHONPATH': str(REPOSITORY)}
    )
    os.close(writer)
    assert (program.returncode, program.stderr) == (0, b'')


@pytest.mark.parametrize('closed', [(1,), (2,), (0, 1, 2)])
@pytest.mark.parametrize(('file', 'code'), [('prototype3_8', 0), ('nothing', 1)])
def test_closed_streams_are_no_failure(closed, file, code):
    program = subprocess.run(
        [sys.executable, '-m', 'sesa2.cli', 'check', file],
        capture_output=True,
        preexec_fn=lambda: [os.close(stream) for stream in closed],
        env={**os.environ, 'PYTHONPATH': str(REPOSITORY)},
    )
    assert program.returncode == code
    assert b'Traceback' not in program.stderr


@pytest.mark.parametrize('option', ['--time-offset', '--marker'])
def test_a_huge_value_is_shortened_in_the_message(capfd, option):
    with pytest.raises(SystemExit):
        main(['evaluate', 'bag', '--truth', 'truth', option, 100_000 * 'x'])
    assert len(capfd.readouterr().err.splitlines()[-1]) < 300


# replay


@pytest.fixture
def bag(tmp_path):
    """1 s of both IMUs."""
    return write_bag(tmp_path / 'in', (2, 5), stamps_of(1.0))


def test_replay_says_what_it_did(capfd, config, bag, tmp_path):
    assert main(['replay', str(bag), '--config', str(config()), '--out', str(tmp_path / 'out')]) == 0
    out, errors = capfd.readouterr()
    assert 'out: 100 sweeps of 1.0 s in ' in out
    assert errors == ''
    with open_recording(tmp_path / 'out') as recording:
        assert recording.topics['/pcc/tip'].count == 100


def test_replay_by_other_models(config, bag, tmp_path):
    arguments = [
        'replay',
        bag,
        '--config',
        config(),
        '--out',
        tmp_path / 'out',
        '--models',
        'rigid,pcc_exact',
    ]
    assert main([str(a) for a in arguments]) == 0
    with open_recording(tmp_path / 'out') as recording:
        models = {topic.split('/')[1] for topic in recording.topics if topic.endswith('/tip')}
    assert models == {'rigid', 'pcc_exact'}


def test_what_replay_cannot_use_leaves_nothing(capfd, config, bag, tmp_path):
    file, out = config(), tmp_path / 'out'
    with new_bag(tmp_path / 'texts') as writer:
        writer.add_topic('/configuration', 'std_msgs/msg/String')
    (tmp_path / 'noise.mcap').write_bytes(bytes(range(256)))
    others = write_bag(tmp_path / 'others', (1, 3), stamps_of(0.1))
    unmeasured = write_bag(
        tmp_path / 'unmeasured', (), [], also=[(i, s, [0.0] * 4) for s in stamps_of(0.1) for i in (2, 5)]
    )
    for source, expected in {
        tmp_path / 'nothing': 'nothing',
        tmp_path / 'texts': 'imu_<id>/data',
        tmp_path / 'noise.mcap': 'noise.mcap',
        others: 'no message of the configured IMUs 2, 5; it has topics of 1, 3',
        unmeasured: '20 samples not used: all zero, not measured',
    }.items():
        fails(capfd, ['replay', source, '--config', file, '--out', out], expected)
        assert not out.exists()
    fails(capfd, ['replay', bag, '--config', file, '--out', out, '--models', 'pc'], 'models[0]')
    fails(capfd, ['replay', bag, '--config', 'nowhere', '--out', out], 'no such file')
    fails(capfd, ['replay', bag, '--config', file, '--out', bag], 'exists already')
    hidden = [p.name for p in tmp_path.iterdir() if 'out' in p.name]
    assert hidden == []


def test_replay_counts_what_it_cannot_use(capfd, config, tmp_path):
    still = [0.0, 0.0, 0.0, 1.0]
    bad = [
        (2, T0 + 3 * 10**9, [0.0] * 4),
        (2, T0 + 3 * 10**9, [np.nan, 0.0, 0.0, 1.0]),
        (2, T0 + 3 * 10**9, [0.0, 0.0, 0.0, 0.5]),
        (2, T0 + 5 * 10**8, still),  # back, but by less than a second
        (7, T0 + 3 * 10**9, still),
    ]
    bag = write_bag(tmp_path / 'in', (2, 5), np.concatenate([stamps_of(3.0), stamps_of(1.0)]), also=bad)
    assert main(['replay', str(bag), '--config', str(config()), '--out', str(tmp_path / 'out')]) == 0
    errors = capfd.readouterr().err
    for text in (
        '1 samples not used: all zero, not measured',
        '1 samples not used: not a number',
        '1 samples not used: norm is not 1',
        '1 samples not used: not newer than the last of its IMU',
        'IMU 7: 1 messages not used: not in imus.ids',
        'time jumped back 1 times; the estimate began anew there',
    ):
        assert f'warning: {text}' in errors, errors


def test_replay_uses_what_is_readable_of_a_bag_cut_short(capfd, config, tmp_path):
    bag = cut(write_bag(tmp_path / 'in', (2, 5), stamps_of(60.0)), 0.5)
    assert main(['replay', str(bag), '--config', str(config()), '--out', str(tmp_path / 'out')]) == 0
    errors = capfd.readouterr().err
    assert 'warning: ' in errors
    assert 'is cut short' in errors
    with open_recording(tmp_path / 'out') as recording:
        assert recording.topics['/pcc/tip'].count > 500


def test_replay_onto_a_full_disk_leaves_nothing(config, tmp_path):
    bag = write_bag(tmp_path / 'in', (2, 5), stamps_of(30.0))

    def small_disk():
        resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))

    arguments = ('replay', bag, '--config', config(), '--out', tmp_path / 'out')
    with command(tmp_path, *arguments, preexec_fn=small_disk) as program:
        assert failed_clearly(program, 'out', 'cannot be written: File too large')
    assert [p.name for p in tmp_path.iterdir() if 'out' in p.name and not p.name.endswith('.out')] == []


# run


@pytest.fixture
def board():
    """A board with the IMUs of the configuration."""
    with VirtualBoard(arm_of(files.parse(text_of(), 'test')), calibration_s=1.0) as one:
        yield one


def test_run_shows_a_line_a_second_and_a_summary(config, tmp_path):
    with command(tmp_path, 'run', '--config', config(), '--source', 'sim', '--duration', '4') as program:
        assert program.ended() == 0, program.errors
    lines = program.output.splitlines()
    assert [line for line in lines if 'pcc tip' in line and 'mm off' in line and 'calibration' in line]
    assert 'sweeps estimated' in lines[-1]


def test_run_plays_and_records(config, bag, tmp_path):
    (tmp_path / 'out').mkdir()
    arguments = ('--source', 'bag', '--bag', bag, '--record', tmp_path / 'out', '--rate', '2')
    with command(tmp_path, 'run', '--config', config(), *arguments) as program:
        assert program.ended() == 0, program.errors
    assert list((tmp_path / 'out').iterdir()) == [], 'what is there is left alone'
    with open_recording(tmp_path / 'out_2') as recording:
        assert recording.topics['/imu_2/data'].count == 100
        assert recording.topics['/pcc/tip'].count >= 90


def test_run_calibrates(config, board, tmp_path):
    file = tmp_path / 'offsets.yaml'
    arm = config(calibration={'file': str(file)})
    arguments = ('--source', 'serial', '--port', board.path, '--mode', 'calibrate')
    with command(tmp_path, 'run', '--config', arm, *arguments) as program:
        program.until(
            lambda: file.exists() and set(yaml.safe_load(file.read_text())['imus']) == {2, 5}, 'both'
        )
        program.signal(signal.SIGINT)
        assert program.ended() == 0, program.errors
    assert 'keep it still' in program.errors or 'figures of eight' in program.errors
    assert 'IMU 2: calibrated' in program.errors


BAD_RUNS = {
    'port absent': (('--source', 'serial', '--port', '{tmp}/tty'), 'serial port {tmp}/tty is not there'),
    'port busy': (
        ('--source', 'serial', '--port', '{port}'),
        'serial port {port} is held by another program',
    ),
    'bag missing': (('--source', 'bag', '--bag', '{tmp}/nothing'), '{tmp}/nothing: '),
    'bag not named': (('--source', 'bag'), "run.bag: is empty, and the source is 'bag'"),
    'bag without IMUs': (('--source', 'bag', '--bag', '{tmp}/texts'), 'imu_<id>/data'),
    'start beyond the end': (
        ('--source', 'bag', '--bag', '{tmp}/in', '--start', '9'),
        'nothing to play after 9 s',
    ),
    'record into a file': (('--source', 'sim', '--record', '{tmp}/arm.yaml/out'), 'cannot be written'),
    'calibrate a bag': (('--source', 'bag', '--bag', '{tmp}/in', '--mode', 'calibrate'), 'run.mode: got '),
    'calibrate without a file': (('--source', 'sim', '--mode', 'calibrate'), 'calibration.file: is empty'),
}


@pytest.mark.parametrize('bad', BAD_RUNS)
def test_run_says_what_it_cannot_do(config, board, bag, tmp_path, bad):
    arguments, expected = BAD_RUNS[bad]
    with new_bag(tmp_path / 'texts') as writer:
        writer.add_topic('/configuration', 'std_msgs/msg/String')
    names = {'tmp': tmp_path, 'port': board.path}
    other = SerialPort(board.path, 500_000)
    try:
        with command(
            tmp_path, 'run', '--config', config(), *(a.format(**names) for a in arguments)
        ) as program:
            assert failed_clearly(program, expected.format(**names))
    finally:
        other.close()


def test_run_that_cannot_start_records_nothing(config, tmp_path):
    arguments = ('--source', 'bag', '--bag', tmp_path / 'nothing', '--record', tmp_path / 'recorded')
    with command(tmp_path, 'run', '--config', config(), *arguments) as program:
        assert failed_clearly(program, f'{tmp_path}/nothing: ')
    assert not (tmp_path / 'recorded').exists()


def test_run_refuses_a_board_of_another_version(config, tmp_path):
    with VirtualBoard(arm_of(files.parse(text_of(), 'test')), version=9) as board:
        arguments = ('--source', 'serial', '--port', board.path)
        with command(tmp_path, 'run', '--config', config(), *arguments) as program:
            assert failed_clearly(program, 'protocol version 9')


def test_run_refuses_offsets_that_no_chip_can_have(config, tmp_path):
    file = tmp_path / 'offsets.yaml'
    save_offsets(file, 2, OFFSETS)
    file.write_text(file.read_text().replace('777', '77777'))
    before = file.read_bytes()
    arm = config(calibration={'file': str(file)})
    with command(tmp_path, 'run', '--config', arm, '--source', 'sim') as program:
        assert failed_clearly(program, f'{file}: imus.2.mag_radius: expected a whole number', 'got 77777')
    assert file.read_bytes() == before


def test_run_goes_on_without_offsets_of_an_imu_and_says_so(config, tmp_path):
    file = tmp_path / 'offsets.yaml'
    save_offsets(file, 2, OFFSETS)
    arm = config(calibration={'file': str(file)})
    with command(tmp_path, 'run', '--config', arm, '--source', 'sim', '--duration', '3') as program:
        assert program.ended() == 0, program.errors
    assert 'has no offsets of IMU 5: not calibrated' in program.errors


def test_a_full_disk_ends_the_recording_and_the_run_goes_on(config, tmp_path):
    def small_disk():
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))

    arguments = ('run', '--config', config(), '--source', 'sim', '--record', tmp_path / 'out')
    with command(tmp_path, *arguments, preexec_fn=small_disk) as program:
        full = 'out_0.mcap: cannot be written: File too large'
        program.until(lambda: f'{full}; the others go on' in program.errors, 'the end of the recording')
        lines = len(program.output.splitlines())
        program.until(lambda: len(program.output.splitlines()) > lines + 1, 'a line more each second')
        program.signal(signal.SIGINT)
        assert failed_clearly(program, full)
    with open_recording(tmp_path / 'out') as recording:
        assert sum(1 for _ in recording.messages()) > 100


# board


def test_board_serves_a_port_under_a_name(config, tmp_path):
    link = tmp_path / 'board'
    with command(tmp_path, 'board', '--config', config(), '--link', link) as board:
        board.until(lambda: str(link) in board.output, 'its name')
        arguments = ('--source', 'serial', '--port', link, '--duration', '3')
        with command(tmp_path, 'run', '--config', config(), *arguments) as program:
            assert program.ended() == 0, program.errors
        assert 'sweeps estimated' in program.output
        board.signal(signal.SIGTERM)
        assert board.ended() == 0, board.errors
    assert board.errors == ''
    assert not link.is_symlink()
