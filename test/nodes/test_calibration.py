"""The calibration node on a real graph: alone with made-up scores, and with a bridge and a virtual board."""

import os
import time

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from held_poses import recording
from sensor_msgs.msg import Imu
from sesa2_msgs.msg import ImuCalibration
from std_srvs.srv import Trigger
from virtual_arms import arm_of, halted, plausible

from sesa2.configuration import ConfigurationError, validate
from sesa2.link.packets import register_of
from sesa2.link.virtual import chip
from sesa2.messages.imu_messages import ImuMessages
from sesa2.nodes.calibration import CalibrationNode
from sesa2.nodes.serial_bridge import SerialBridge
from sesa2.ros.qos import LATCHED, STREAM
from sesa2.sensing.imu.bno055.offsets import (
    Offsets,
    OffsetsError,
    load_accelerometers,
    load_offsets,
    save_offsets,
)
from sesa2.sensing.imu.bno055.scores import Scores

OLD = Offsets((9, 9, 9), (9, 9, 9), (9, 9, 9), 999, 999)
NEW = Offsets((1, -2, 3), (400, -500, 600), (-7, 8, -9), 1001, 777)


def values(file, port='', mode='stream'):
    return {
        'run': {'mode': mode},
        'arm': {'length': 0.3},
        'imus': {'ids': [2, 5], 'positions': [0.1, 0.3]},
        'models': ['pcc'],
        'serial': {'port': port},
        'calibration': {'file': str(file)},
    }


@pytest.fixture
def file(tmp_path):
    return tmp_path / 'offsets.yaml'


@pytest.fixture
def node(graph, configured, file, request):
    mode = getattr(request, 'param', 'stream')
    return graph.add(CalibrationNode(parameter_overrides=configured(values(file, mode=mode))))


@pytest.fixture
def say(graph, node):
    """Publishes scores, with offsets where they are given."""
    publishers = {
        i: graph.probe.create_publisher(ImuCalibration, f'imu_{i}/calibration', LATCHED) for i in (2, 5)
    }
    graph.matched('imu_2/calibration', 'imu_5/calibration')

    def publish(imu, scores, offsets=None):
        message = ImuCalibration(id=imu)
        message.sys, message.gyro, message.accel, message.mag = scores
        if offsets:
            message.offsets_valid = True
            message.accel_offset, message.mag_offset, message.gyro_offset = (
                np.array(v, np.int16) for v in (offsets.accel_offset, offsets.mag_offset, offsets.gyro_offset)
            )
            message.accel_radius, message.mag_radius = offsets.accel_radius, offsets.mag_radius
        publishers[imu].publish(message)

    return publish


def test_one_imu_is_saved_the_moment_its_scores_are_complete(graph, node, say, file):
    save_offsets(file, 2, OLD)
    save_offsets(file, 7, OLD)
    before = yaml.safe_load(file.read_text())['imus']
    say(5, (3, 3, 2, 3), OLD)
    say(2, (2, 3, 3, 3), NEW)
    graph.until(lambda: len(node.steps) == 2, 'both heard')
    assert yaml.safe_load(file.read_text())['imus'] == before, 'nothing while scores are missing'
    say(5, (3, 3, 3, 3), NEW)
    graph.until(lambda: node.saved, 'saved')
    assert load_offsets(file, (5,)).offsets == {5: NEW}
    after = yaml.safe_load(file.read_text())['imus']
    assert {i: after[i] for i in (2, 7)} == before


def test_complete_scores_without_offsets_save_nothing(graph, node, say, file):
    say(5, (3, 3, 3, 3))
    graph.until(lambda: node.steps.get(5) == 'calibrated', 'heard')
    assert not file.exists()


def test_save_takes_what_was_read_last_complete_or_not(graph, node, say, file):
    nothing = graph.call(Trigger, 'calibration/save', Trigger.Request())
    assert not nothing.success
    assert 'no offsets have been read yet' in nothing.message
    say(5, (0, 3, 0, 0), NEW)
    say(5, (1, 3, 0, 0))
    graph.until(lambda: 5 in node.steps, 'heard')
    response = graph.call(Trigger, 'calibration/save', Trigger.Request())
    assert response.success
    assert response.message == f'saved IMUs 5 in {file}; not calibrated to the end: 5; not read yet: 2'
    assert load_offsets(file, (2, 5)) == ({5: NEW}, (2,))


def test_what_was_said_before_it_started_is_not_saved(graph, configured, file):
    publisher = graph.probe.create_publisher(ImuCalibration, 'imu_2/calibration', LATCHED)
    publisher.publish(ImuCalibration(id=2, sys=3, gyro=3, accel=3, mag=3, offsets_valid=True))
    node = graph.add(CalibrationNode(parameter_overrides=configured(values(file))))
    graph.matched('imu_2/calibration')
    publisher.publish(ImuCalibration(id=2))
    graph.until(lambda: 2 in node.steps, 'heard')
    assert 'still' in node.steps[2]
    assert not node.saved
    assert not file.exists()


def test_the_next_step_is_told(graph, node, say):
    logs = graph.listen_to_logs()
    diagnosis = graph.diagnosis()
    steps = {
        (0, 0, 0, 0): 'keep it still',
        (0, 3, 0, 1): 'figures of eight',
        (1, 3, 1, 3): 'six poses',
        (3, 3, 3, 3): 'calibrated',
    }
    for scores, step in steps.items():
        say(2, scores)
        graph.until(
            lambda text=step: [m for m in logs if m.msg.startswith('IMU 2: ') and text in m.msg], step
        )
    graph.until(
        lambda: (d := diagnosis.latest('calibration: imu_2')) and d[1] == 'calibrated; not saved', 'a status'
    )
    assert diagnosis.latest('calibration: imu_5')[1] == 'nothing heard; not saved'


def test_a_file_that_cannot_be_written_is_told_and_what_was_saved_stays(graph, node, say, file, monkeypatch):
    save_offsets(file, 2, OLD)
    before = file.read_bytes()
    logs = graph.listen_to_logs()
    diagnosis = graph.diagnosis()

    def full(descriptor):
        raise OSError(28, 'No space left on device')

    with monkeypatch.context() as patch:  # tests run as root too, whom no permission stops
        patch.setattr(os, 'fsync', full)
        say(5, (3, 3, 3, 3), NEW)
        failure = f'{file}: offsets of IMU 5 not saved: No space left on device'
        graph.until(lambda: [m for m in logs if m.msg == failure], 'a line in the log')
        graph.until(
            lambda: [
                d for d in diagnosis.of(f'calibration: {file}') if d[:2] == (DiagnosticStatus.ERROR, failure)
            ],
            'an error in the diagnostics',
        )
        response = graph.call(Trigger, 'calibration/save', Trigger.Request())
        assert (response.success, response.message) == (False, failure)
    assert file.read_bytes() == before
    assert list(file.parent.glob('.offsets*')) == []
    # When there is room again, the next message saves.
    say(5, (3, 3, 3, 3), NEW)
    graph.until(lambda: 5 in node.saved, 'saved')
    assert load_offsets(file, (2, 5)).offsets == {2: OLD, 5: NEW}


def test_a_file_that_is_something_else_is_refused_at_the_start(graph, configured, file):
    file.write_text('markers: [1, 2]\n')
    with pytest.raises(OffsetsError, match='no calibration file'):
        CalibrationNode(parameter_overrides=configured(values(file)))
    assert file.read_text() == 'markers: [1, 2]\n'


def test_a_folder_that_is_not_there_is_refused_at_the_start(graph, configured, tmp_path):
    with pytest.raises(OffsetsError, match=f'{tmp_path}/none/offsets.yaml'):
        CalibrationNode(parameter_overrides=configured(values(tmp_path / 'none/offsets.yaml')))


def test_without_a_file_there_is_nothing_to_do(graph, configured):
    with pytest.raises(ConfigurationError, match=r'calibration\.file: is empty'):
        CalibrationNode(parameter_overrides=configured(values('')))


def test_a_calibration_from_first_to_last(graph, configured, boards, file):
    """Bridge, board and node: a new file holds what the chips learnt, and the next start restores it."""
    c = validate(values(file, mode='calibrate'))
    board = boards(arm_of(c, halted(plausible(c, 0.0))), calibration_s=1.0)
    learned = {i: Offsets.from_registers(board._chips[i]._learned) for i in (2, 5)}
    calibrate = configured(values(file, board.path, 'calibrate'))
    calibration = graph.add(CalibrationNode(parameter_overrides=calibrate))
    bridge = graph.add(SerialBridge(parameter_overrides=calibrate))
    graph.until(lambda: len(calibration.saved) == 2, 'both saved')
    assert load_offsets(file, (2, 5)) == (learned, ())
    graph.remove(bridge)
    for i in (2, 5):  # the power goes, and with it what the chips know
        board.unplug(i)
        board.plug(i)
    assert Offsets.from_registers(board._chips[2].read_offsets()) != learned[2]
    graph.add(SerialBridge(parameter_overrides=configured(values(file, board.path))))
    restored = graph.listen(ImuCalibration, 'imu_2/calibration', LATCHED)
    graph.until(lambda: [m for m in restored if m.offsets_valid], 'offsets read back')
    for i in (2, 5):
        graph.until(
            lambda i=i: Offsets.from_registers(board._chips[i].read_offsets()) == learned[i],
            f'IMU {i} restored',
        )


CALIBRATING = pytest.mark.parametrize('node', ['calibrate'], indirect=True)


@CALIBRATING
def test_a_system_score_that_stays_low_keeps_nothing_from_being_saved(graph, node, say, file):
    logs = graph.listen_to_logs()
    say(5, (1, 3, 3, 3))
    graph.until(lambda: 'stay low' in node.steps.get(5, ''), 'heard')
    assert not file.exists()
    say(5, (1, 3, 3, 3), OLD)
    graph.until(lambda: 5 in node.saved, 'saved')
    assert load_offsets(file, (5,)).offsets == {5: OLD}
    graph.until(lambda: [m for m in logs if 'IMU 5: its system score is 1 of 3' in m.msg], 'the remark')
    assert node.result == 'offsets saved of: 5; not of: 2'
    said = len(logs)
    for scores in [(3, 3, 3, 3), (1, 3, 3, 3), (0, 3, 2, 3), (1, 3, 3, 3)]:  # quiet from then on
        say(5, scores)
    say(5, (3, 3, 3, 3), NEW)
    graph.until(lambda: node.saved[5] == NEW, 'saved anew')
    graph.until(lambda: len(logs) > said, 'told')
    assert [m.msg for m in logs[said:]] == [f'IMU 5: offsets saved in {file}']
    node.steps.clear()
    say(5, (0, 3, 2, 3))
    assert graph.until(lambda: node.steps.get(5), 'heard') == 'calibrated'


@CALIBRATING
def test_a_sensor_that_is_not_calibrated_is_not_saved(graph, node, say, file):
    say(2, (3, 3, 3, 2), OLD)
    say(5, (3, 3, 2, 3), OLD)
    graph.until(lambda: len(node.steps) == 2, 'heard')
    assert not file.exists()
    assert node.result == 'offsets saved of: none; not of: 2, 5'


def test_while_streaming_a_low_system_score_is_no_calibration(graph, node, say, file):
    say(5, (1, 3, 3, 3), OLD)
    graph.until(lambda: node.steps, 'heard')
    assert not file.exists()


@pytest.mark.parametrize('highest', [lambda: 1, lambda: 3 if int(time.monotonic() * 2) % 2 else 1])
def test_a_board_whose_system_score_is_low_or_comes_and_goes(
    graph, configured, boards, file, monkeypatch, highest
):
    """Saved once each, after some seconds at the latest, and no word more."""
    monkeypatch.setattr(
        chip, 'register_of', lambda s: register_of(Scores(min(s.sys, highest()), s.gyro, s.accel, s.mag))
    )
    c = validate(values(file, mode='calibrate'))
    board = boards(arm_of(c, halted(plausible(c, 0.0))), calibration_s=1.0)
    learned = {i: Offsets.from_registers(board._chips[i]._learned) for i in (2, 5)}
    calibrate = configured(values(file, board.path, 'calibrate'))
    calibration = graph.add(CalibrationNode(parameter_overrides=calibrate))
    logs = graph.listen_to_logs()
    graph.add(SerialBridge(parameter_overrides=calibrate))
    heard = graph.listen(ImuCalibration, 'imu_2/calibration', LATCHED)
    graph.until(lambda: len(calibration.saved) == 2, 'both saved')
    assert load_offsets(file, (2, 5)) == (learned, ())
    told, n = [m.msg for m in logs if 'IMU ' in m.msg], len(heard)
    graph.until(lambda: len(heard) >= n + 6, 'scores of some seconds more')
    later = [m.msg for m in logs if 'IMU ' in m.msg][len(told) :]
    # The first saving may have been with a low score, the second is with a full one.
    assert all('offsets saved' in line or 'its system score' in line for line in later), later
    assert sum('IMU 2: offsets saved' in line for line in told + later) <= 2
    assert len(calibration.saved) == 2


# Without fusion in the chips


def test_it_leads_through_the_six_poses_of_raw_imus(graph, configured, file):
    """Other offsets stay; the other IMU, of which nothing is heard, is not said to be saved."""
    save_offsets(file, 2, OLD)
    given = values(file, mode='calibrate')
    given['serial']['fusion'] = 'RAW'
    node = graph.add(CalibrationNode(parameter_overrides=configured(given)))
    publisher = graph.probe.create_publisher(Imu, 'imu_2/data', STREAM)
    graph.matched('imu_2/data')
    logs, diagnosis = graph.listen_to_logs(), graph.diagnosis()
    bias = np.array([0.2, -0.3, 0.1])
    t, a, w, _ = recording(np.random.default_rng(0), [2.0] * 6)
    stamps = 1_700_000_000_000_000_000 + np.round(t * 1e9).astype(np.int64)
    messages = [row.tobytes() for row in ImuMessages('imu_2').make_raw(stamps, w, a + bias)]

    def taken():
        samples = node._guides[2]._samples
        return samples[-1][0] if samples else 0.0

    for k, message in enumerate(messages):
        publisher.publish(message)
        if k % 50 == 49:  # as fast as they are taken
            graph.until(lambda s=stamps[k]: taken() >= s / 1e9, 'what was said')
    graph.until(lambda: node.calibrated == {2}, 'the calibration')
    np.testing.assert_allclose(load_accelerometers(file, (2,))[2].bias, bias, atol=0.02)
    assert load_offsets(file, (2,)).offsets == {2: OLD}
    assert graph.until(
        lambda: [m for m in logs if 'hold it still for 2 s with each of these sides up: -z' in m.msg],
        'a step',
    )
    graph.until(
        lambda: (
            (d := diagnosis.latest('calibration: imu_2'))
            and d[:2] == (DiagnosticStatus.OK, 'calibrated; saved')
        ),
        'a diagnosis',
    )
    assert diagnosis.latest('calibration: imu_2')[2]['poses'] == '6'
    assert diagnosis.latest('calibration: imu_5')[1] == 'nothing heard; not saved'
