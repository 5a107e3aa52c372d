"""What goes wrong in one part of `sesa2 run` ends that part: it is told, counted, and the rest goes on."""

import os
import re
import resource
import signal
import sys
import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from processes import REPOSITORY, command, failed_clearly
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from sensor_msgs.msg import Imu
from std_msgs.msg import String
from std_srvs.srv import Trigger

from sesa2.bags.recording import open_recording
from sesa2.cli import main
from sesa2.configuration import files
from sesa2.errors import Sesa2Error
from sesa2.messages.imu_messages import ImuMessages
from sesa2.ros.qos import LATCHED, STREAM
from sesa2.sensing.imu.bno055.offsets import Offsets, save_offsets
from sesa2.system.run import _Viewer

PROTOTYPE = REPOSITORY / 'config/prototype3_8.yaml'
RUN = ('run', '--config', PROTOTYPE, '--source', 'sim')
SMALL = 1 << 20  # bytes


def small_files():
    """A disk that is full soon, for all that the process writes."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (SMALL, SMALL))


@pytest.fixture
def small_disk(tmp_path):
    """A real disk that is full soon."""
    disk = tmp_path / 'disk'
    disk.mkdir()
    if os.geteuid() != 0 or os.system(f'mount -t tmpfs -o size={SMALL} tmpfs {disk} 2>/dev/null') != 0:
        pytest.skip('a small disk needs the right to mount one')
    yield disk
    os.system(f'umount -l {disk}')


def shapes(program):
    return program.output.count('pcc tip')


def goes_on(program):
    """Whether more shapes come."""
    told = shapes(program)
    program.until(lambda: shapes(program) > told + 1, 'more shapes')
    return True


def ended_after_loss(program, *expected):
    program.signal(signal.SIGINT)
    assert failed_clearly(program, *expected)
    assert 'sweeps estimated' in program.output.splitlines()[-1]
    return True


# The recording


@pytest.mark.parametrize('page', [False, True])
def test_a_recording_that_cannot_be_written_on_ends_alone(tmp_path, page):
    with command(
        tmp_path, *RUN, '--record', 'bag', *(('--viewer', 0) if page else ()), preexec_fn=small_files
    ) as program:
        program.until(lambda: 'the others go on' in program.errors, 'that it is told')
        assert 'bag_0.mcap: cannot be written: File too large' in program.errors
        assert goes_on(program)
        assert ended_after_loss(program, 'bag_0.mcap: cannot be written: File too large')
    with open_recording(tmp_path / 'bag') as recording:
        assert recording.topics['/rigid/tip'].count > 100


def test_a_full_disk_ends_the_recording_alone(tmp_path, small_disk):
    with command(tmp_path, *RUN, '--record', small_disk / 'bag') as program:
        program.until(lambda: 'the others go on' in program.errors, 'that it is told')
        assert goes_on(program)
        assert ended_after_loss(program, 'cannot be written: No space left on device')
    with open_recording(small_disk / 'bag') as recording:
        assert recording.topics['/rigid/tip'].count > 100


@pytest.mark.parametrize(('size', 'unreadable'), [(8, 1), (20, 1), (100, 0)])
def test_a_message_that_is_cut_short_is_recorded_as_it_came(graph, tmp_path, size, unreadable):
    """Of a hundred bytes the orientation can be read, and the acceleration not taken out."""
    diagnosis = graph.diagnosis()
    maker = ImuMessages('imu_1')

    def message():
        return maker.make(time.time_ns(), np.array([0.0, 0.0, 0.0, 1.0]))

    with command(tmp_path, *RUN[:-1], 'external', '--record', 'bag') as program:
        publisher = graph.probe.create_publisher(Imu, 'imu_1/data', STREAM)

        def heard(part, key):
            # What is sent to a subscription that does not know the publisher yet is lost.
            publisher.publish(message())
            latest = diagnosis.latest(part)
            return latest and int(latest[2][key])

        graph.until(lambda: heard('estimator: sweeps', 'sweeps'), 'the estimator hears')
        graph.until(lambda: (heard('recorder: bag', 'messages') or 0) > 1, 'the recorder hears')
        whole = message()
        publisher.publish(whole[:size])
        publisher.publish(whole)

        def counted(part, **expected):
            latest = diagnosis.latest(part)
            return latest and all(latest[2][key] == str(n) for key, n in expected.items())

        graph.until(lambda: counted('recorder: bag', damaged=1), 'the recorder has counted')
        graph.until(lambda: counted('estimator: sweeps', unreadable=unreadable), 'the estimator has')
        assert 'cut short' in diagnosis.latest('recorder: bag')[1]
        program.signal(signal.SIGINT)
        assert program.ended() == 0, program.errors
        assert 'Traceback' not in program.errors
    with open_recording(tmp_path / 'bag') as recording:
        assert [m.data for m in recording.messages(['/imu_1/data'])][-2:] == [whole[:size], whole]


# What nobody foresaw


def fault(*_):
    raise KeyError('nobody foresaw this')


@pytest.mark.parametrize(
    ('where', 'node', 'needed'),
    [
        ('sesa2.nodes.estimator.EstimatorNode._publish', 'estimator', True),
        ('sesa2.nodes.serial_bridge.SerialBridge.on_sweep', 'board on /dev/pts', True),
        ('sesa2.nodes.serial_bridge.SerialBridge._publish_calibrations', 'serial_bridge', True),
        ('sesa2.nodes.recorder.without_acceleration', 'recorder', False),
        ('sesa2.nodes.calibration.CalibrationNode._report', 'calibration', False),
        ('sesa2.nodes.recorder.Recorder.close', 'recorder', False),
    ],
)
def test_a_fault_ends_its_node_and_the_run_only_where_the_others_need_it(
    tmp_path, monkeypatch, capfd, where, node, needed
):
    monkeypatch.setattr(where, fault)
    monkeypatch.chdir(tmp_path)
    c = files.load(PROTOTYPE)
    text = files.dump(replace(c, calibration=replace(c.calibration, file='offsets.yaml')))
    save_offsets('offsets.yaml', 1, Offsets((0, 0, 0), (0, 0, 0), (0, 0, 0), 0, 0))
    Path('arm.yaml').write_text(text)
    duration = 60.0 if needed else 4.0
    began = time.monotonic()
    code = main(
        ['run', '--config', 'arm.yaml', '--source', 'sim', '--record', 'bag', '--duration', str(duration)]
    )
    out, err = capfd.readouterr()
    assert code == 1
    last = err.splitlines()[-1]
    assert last.startswith(f'error: {node}'), err
    assert "KeyError: 'nobody foresaw this' (" in last
    assert (time.monotonic() - began < duration) == needed
    if not needed:
        sweeps = int(re.search(r'(\d+) sweeps estimated', out)[1])
        assert sweeps > 100


# The page

IMPOSSIBLE = [
    '/**: {ros__parameters: {arm: {length: 2024-02-31}}}',
    '/**: {ros__parameters: {arm: {{ ARM }}}}',
    '/**: {ros__parameters: {arm: !!int x}}',
    '[' * 10_000,
    'a: "\\ud800"',
    '&a [*a]',
    '',
]


def test_the_page_survives_configurations_that_mean_nothing(graph, tmp_path):
    pytest.importorskip('viser', reason='viser is not installed: pip install sesa2[viewer]')
    publisher = graph.probe.create_publisher(String, 'configuration', LATCHED)
    logs = graph.listen_to_rosout()
    with command(tmp_path, *RUN, '--viewer', 0) as program:
        graph.until(lambda: shapes(program) and 'the arm is shown' in program.output, 'the page')
        for text in IMPOSSIBLE:
            n = len([log for log in logs if log.name == 'viewer'])
            graph.until(lambda: publisher.get_subscription_count(), 'the viewer')
            publisher.publish(String(data=text))
            graph.until(lambda n=n: len([log for log in logs if log.name == 'viewer']) > n, text[:40])
        assert goes_on(program)
        assert os.kill(child_of(program), 0) is None
        told = [log.msg for log in logs if log.name == 'viewer']
        assert any("'2024-02-31' is no date" in line for line in told), told
        program.signal(signal.SIGINT)
        assert program.ended() == 0, program.errors
        assert 'Traceback' not in program.errors


def test_the_system_refuses_a_configuration_that_means_nothing(graph, tmp_path):
    pytest.importorskip('viser', reason='viser is not installed: pip install sesa2[viewer]')
    with command(tmp_path, *RUN, '--viewer', 0) as program:
        graph.until(lambda: 'system' in graph.probe.get_node_names(), 'the system')
        for text in IMPOSSIBLE:
            value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=text)
            request = SetParameters.Request(parameters=[Parameter(name='configuration', value=value)])
            [result] = graph.call(SetParameters, 'system/set_parameters', request).results
            assert not result.successful
            assert result.reason.startswith('parameter configuration: 1 mistake'), result.reason
        assert graph.call(Trigger, 'system/start', Trigger.Request()).success
        assert goes_on(program)
        program.signal(signal.SIGINT)
        assert program.ended() == 0, program.errors
        assert 'Traceback' not in program.errors


def child_of(program):
    [child] = Path(f'/proc/{program.pid}/task/{program.pid}/children').read_text().split()
    return int(child)


def is_running(pid):
    """Whether it is there, and no zombie that waits for its parent."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except FileNotFoundError:
        return False


def test_a_killed_run_leaves_no_viewer_behind(graph, tmp_path):
    pytest.importorskip('viser', reason='viser is not installed: pip install sesa2[viewer]')
    for shown in (True, False):
        with command(tmp_path, *RUN, '--viewer', 0) as program:
            if shown:
                program.until(lambda: 'the arm is shown' in program.output, 'the page')
            program.until(
                lambda: Path(f'/proc/{program.pid}/task/{program.pid}/children').read_text(), 'a child'
            )
            viewer = child_of(program)
            program.signal(signal.SIGKILL)
            program.ended()
            graph.until(lambda: not is_running(viewer), 'the end of the viewer')  # noqa: B023
            assert 'Traceback' not in program.errors


def test_a_stopped_viewer_does_not_hold_up_the_end(tmp_path):
    pytest.importorskip('viser', reason='viser is not installed: pip install sesa2[viewer]')
    with command(tmp_path, *RUN, '--viewer', 0) as program:
        program.until(lambda: 'the arm is shown' in program.output and shapes(program), 'the page')
        viewer = child_of(program)
        os.kill(viewer, signal.SIGSTOP)
        assert goes_on(program)
        program.signal(signal.SIGINT)
        assert program.ended() == 0, program.errors
        assert not is_running(viewer)


@pytest.mark.parametrize('starts', [True, False])
def test_a_failed_start_is_told_from_a_later_end(tmp_path, monkeypatch, capfd, starts):
    """A child that ends with exit code 3, once it has said that it shows the page, or before."""
    say = f"socket.socket(fileno=int(os.environ['SESA2_LIFELINE'])).send(b'.' * {starts:d})"
    child = tmp_path / 'child'
    child.write_text(f'#!{sys.executable}\nimport os, socket\n{say}\nos._exit(3)\n')
    child.chmod(0o755)
    monkeypatch.setattr('sesa2.system.run.sys.executable', str(child))
    with _Viewer(0, '/', tmp_path) as viewer:
        viewer._process.wait()
        with nullcontext() if starts else pytest.raises(Sesa2Error, match='could not be shown'):
            viewer.look_after()
        viewer.look_after()
    assert capfd.readouterr().err.count('the system goes on') == starts
