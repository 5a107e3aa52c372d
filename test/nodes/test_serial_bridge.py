"""The serial bridge on a real graph, with a virtual board behind a real pseudo-terminal."""

import itertools
import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from processes import failed_clearly, node
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Imu, MagneticField
from sesa2_msgs.msg import ImuCalibration
from std_srvs.srv import Trigger
from virtual_arms import arm_of, halted, plausible

from sesa2.configuration import files, validate
from sesa2.link.clock import steady_ns
from sesa2.link.serial_port import SerialPort
from sesa2.nodes.serial_bridge import SerialBridge
from sesa2.ros.qos import EVERY_LATCHED, LATCHED, STREAM
from sesa2.sensing.imu.bno055.offsets import Offsets, OffsetsError, save_offsets

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
IDS = (2, 3, 5)
SAVED = Offsets((1, -2, 3), (400, -500, 600), (-7, 8, -9), 1001, 777)
GRAVITY = 9.80665
WARNING = 30  # of rcl_interfaces/Log, whose constants are bytes or integers


def values(port, **sections):
    """A configuration of three IMUs, with some sections added to."""
    nested = {
        'arm': {'length': 0.3},
        'imus': {
            'ids': list(IDS),
            'positions': [0.1, 0.2, 0.3],
            'headings': [0.1, -0.2, 0.3],
            'mount_orientations': [0.6, 0.0, 0.0, 0.8] + 2 * [0.0, 0.0, 0.0, 1.0],
        },
        'models': ['pcc'],
        'serial': {'port': port},
    }
    for name, section in sections.items():
        nested[name] = {**nested.get(name, {}), **section}
    return nested


STILL = plausible(validate(values('')), 17.0)


@pytest.fixture
def bridge_on(graph, configured):
    """Starts the bridge on a board's port."""
    return lambda port, **sections: graph.add(
        SerialBridge(parameter_overrides=configured(values(str(port), **sections)))
    )


@pytest.fixture
def still_board(boards):
    """A board with an arm that holds still, calibrated within a second."""
    return boards(arm_of(validate(values('')), halted(STILL)), boot_s=0.2, calibration_s=1.0)


def stamp_ns(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def orientation(message):
    q = message.orientation
    return np.array([q.x, q.y, q.z, q.w])


def offsets_of(message):
    """What a calibration message carries."""
    vectors = (message.accel_offset, message.mag_offset, message.gyro_offset)
    return Offsets(*(tuple(map(int, v)) for v in vectors), message.accel_radius, message.mag_radius)


def chip_offsets(board, imu):
    """What is in the registers of the virtual chip."""
    return Offsets.from_registers(board._chips[imu].read_offsets())


# What is published


def test_orientations_are_those_of_the_chips_as_rep_145_wants_them(graph, bridge_on, still_board):
    bridge_on(still_board.path)
    messages = {i: graph.listen(Imu, f'imu_{i}/data', STREAM) for i in IDS}
    graph.until(lambda: all(len(m) >= 50 for m in messages.values()), '50 messages of each')
    # The raw measurement: mounting and heading are in it, rounded to the wire's step.
    given = still_board.arm.orientations(IDS, np.zeros(3), np.zeros(3))
    for k, i in enumerate(IDS):
        for message in messages[i]:
            np.testing.assert_allclose(orientation(message), given[k], rtol=0, atol=2**-15 + 1e-12)
            np.testing.assert_array_equal(orientation(message) * 2**14 % 1, 0.0)
            assert message.header.frame_id == f'imu_{i}'
            assert not message.orientation_covariance.any()
            assert message.angular_velocity_covariance[0] == message.linear_acceleration_covariance[0] == -1.0


def test_stamps_are_of_the_measurement(graph, bridge_on, boards):
    board = boards(arm_of(validate(values(''))))
    bridge_on(board.path)
    messages = {i: graph.listen(Imu, f'imu_{i}/data', STREAM) for i in IDS}
    before = time.time_ns()
    graph.until(lambda: all(len(m) >= 100 for m in messages.values()), '100 messages of each')
    stamps = {i: np.array([stamp_ns(m) for m in messages[i]]) for i in IDS}
    for i in IDS:
        assert (np.diff(stamps[i]) > 0).all()
        assert before - 10**9 < stamps[i][0]
        assert stamps[i][-1] < time.time_ns()
    # One after another in a sweep, as the board read them: the virtual board takes 450 µs for each.
    common = sorted(set(stamps[2] // 1000) & set((stamps[3] - 450_000) // 1000))
    assert len(common) > 50
    np.testing.assert_array_equal(np.isin(np.array(common), (stamps[5] - 900_000) // 1000)[1:-1], True)
    # The arm moves: at its stamp, a sample is the truth, as near as the stamps are.
    to_steady_ns = time.time_ns() - steady_ns()
    for k, i in enumerate(IDS):
        t = np.array([board.motion_time(int(s) - to_steady_ns) for s in stamps[i]])
        true = board.arm.orientations(IDS, np.repeat(t[:, None], 3, 1), np.zeros(3))[:, k]
        cosine = np.abs((np.array([orientation(m) for m in messages[i]]) * true).sum(-1))
        # It turns by less than 2 rad/s, and stamps are better than 20 ms even on a busy machine.
        assert 2.0 * np.arccos(np.minimum(np.median(cosine), 1.0)) < 0.04


def test_acceleration_on_demand(graph, bridge_on, still_board):
    bridge_on(still_board.path, serial={'acceleration': True})
    messages = graph.listen(Imu, 'imu_3/data', STREAM)
    graph.until(lambda: len(messages) >= 20, 'messages')
    for message in messages:
        a = message.linear_acceleration
        assert message.linear_acceleration_covariance[0] == 0.0
        assert np.linalg.norm([a.x, a.y, a.z]) == pytest.approx(GRAVITY, abs=0.02)


def test_raw_measurements_as_rep_145_wants_them(graph, bridge_on, still_board):
    bridge_on(still_board.path, serial={'fusion': 'RAW'}, imus={'fusion': '9d'})
    diagnosis = graph.diagnosis()
    messages = {i: graph.listen(Imu, f'imu_{i}/data', STREAM) for i in IDS}
    fields = {i: graph.listen(MagneticField, f'imu_{i}/mag', STREAM) for i in IDS}
    graph.until(
        lambda: all(len(m) >= 20 for m in (*messages.values(), *fields.values())), '20 messages of each'
    )
    given = still_board.arm.orientations(IDS, np.zeros(3), np.zeros(3))
    for q, i in zip(given, IDS, strict=True):
        into_sensor = Rotation.from_quat(q).inv()
        for message in messages[i]:
            assert message.header.frame_id == f'imu_{i}'
            assert message.orientation_covariance[0] == -1.0
            assert orientation(message).tolist() == [0.0, 0.0, 0.0, 1.0]  # which says nothing
            assert message.angular_velocity_covariance[0] == message.linear_acceleration_covariance[0] == 0.0
            w, a = message.angular_velocity, message.linear_acceleration
            assert (w.x, w.y, w.z) == (0.0, 0.0, 0.0)  # it holds still
            np.testing.assert_allclose([a.x, a.y, a.z], into_sensor.apply([0, 0, GRAVITY]), atol=0.006)
        for message in fields[i]:
            b = message.magnetic_field
            assert message.header.frame_id == f'imu_{i}'
            np.testing.assert_allclose([b.x, b.y, b.z], into_sensor.apply([0, 20e-6, -45e-6]), atol=4e-8)
    assert {stamp_ns(m) for m in fields[3]} & {stamp_ns(m) for m in messages[3]}
    told = graph.until(lambda: diagnosis.latest('serial_bridge: imu_3'), 'a diagnosis')
    assert told[:2] == (OK, 'measures without fusion')


def test_raw_angular_velocity_is_that_of_the_motion(graph, bridge_on, boards):
    """Summed up, the turns that the gyroscope tells are those that the arm makes."""
    board = boards(arm_of(validate(values(''))))
    bridge_on(board.path, serial={'fusion': 'RAW'}, imus={'fusion': '6d'})
    messages = graph.listen(Imu, 'imu_5/data', STREAM)
    graph.until(lambda: len(messages) >= 800, '8 s of messages')  # it holds still for the first 3
    stamps = np.array([stamp_ns(m) for m in messages])
    w = np.array([[m.angular_velocity.x, m.angular_velocity.y, m.angular_velocity.z] for m in messages])
    assert np.abs(w).max() > 0.3
    t = np.array([board.motion_time(int(s) - (time.time_ns() - steady_ns())) for s in stamps])
    truth = Rotation.from_quat(board.arm.orientations((5,), t[:, np.newaxis], np.zeros(1))[:, 0])
    turned = truth[0]
    for before, after, dt in zip(w, w[1:], np.diff(stamps) * 1e-9, strict=False):
        turned = turned * Rotation.from_rotvec((before + after) / 2 * dt)
    assert (truth[-1].inv() * turned).magnitude() < 0.05


# Calibration


def test_calibration_is_latched_and_repeated(graph, bridge_on, still_board):
    bridge_on(still_board.path)
    first = graph.listen(ImuCalibration, 'imu_3/calibration', LATCHED)
    graph.until(lambda: first and first[-1].sys == 3, 'full scores')
    changes = [(m.sys, m.gyro, m.accel, m.mag) for m in first]
    assert len(set(changes)) > 3, 'on change: scores rise one by one'
    # Of the virtual chips the gyroscope is the first to be calibrated, then the magnetometer, then the accelerometer.
    assert all(gyro >= mag >= accel == sys for sys, gyro, accel, mag in changes)
    assert any(mag > accel for _, _, accel, mag in changes)
    n = len(first)
    graph.until(lambda: len(first) >= n + 2, 'repetitions once a second')
    assert first[-1].id == 3
    assert first[-1].header.frame_id == 'imu_3'
    assert not first[-1].offsets_valid
    late = []
    graph.probe.create_subscription(ImuCalibration, 'imu_3/calibration', late.append, LATCHED)
    [message] = graph.until(lambda: late[:1], 'the latched message')
    assert stamp_ns(message) <= stamp_ns(graph.until(lambda: late[1:], 'the next')[0])


def test_saved_offsets_are_written_at_connect_and_read_back(graph, bridge_on, still_board, tmp_path):
    file = tmp_path / 'offsets.yaml'
    for i in IDS:
        save_offsets(file, i, SAVED)
    diagnosis = graph.diagnosis()
    bridge_on(still_board.path, calibration={'file': str(file)})
    heard = {i: graph.listen(ImuCalibration, f'imu_{i}/calibration', LATCHED) for i in IDS}
    graph.until(lambda: all(any(m.offsets_valid for m in heard[i]) for i in IDS), 'offsets of each')
    for i in IDS:
        assert chip_offsets(still_board, i) == SAVED
        assert {offsets_of(m) for m in heard[i] if m.offsets_valid} == {SAVED}
    graph.until(
        lambda: (d := diagnosis.latest('serial_bridge: imu_2')) and d[2].get('offsets') == 'as saved',
        'the state of the offsets',
    )


def test_a_chip_that_works_with_other_offsets_is_an_error(graph, bridge_on, still_board, tmp_path):
    file = tmp_path / 'offsets.yaml'
    for i in IDS:
        save_offsets(file, i, SAVED)
    still_board._chips[3].write_offsets = lambda registers: None  # what was restored does not stick
    logs = graph.listen_to_logs()
    diagnosis = graph.diagnosis()
    bridge_on(still_board.path, calibration={'file': str(file)})
    graph.until(
        lambda: (d := diagnosis.latest('serial_bridge: imu_3')) and d[0] == ERROR and 'offsets' in d[1],
        'an error about IMU 3',
    )
    assert diagnosis.latest('serial_bridge: imu_2')[2]['offsets'] == 'as saved'
    assert diagnosis.latest('serial_bridge: link')[2]['offset_differences'] == '1'
    graph.until(
        lambda: [m for m in logs if 'IMU 3 works with other offsets than saved' in m.msg], 'a line in the log'
    )


def test_an_imu_that_the_file_lacks_is_warned_about(graph, bridge_on, still_board, tmp_path):
    file = tmp_path / 'offsets.yaml'
    save_offsets(file, 2, SAVED)
    logs = graph.listen_to_logs()
    bridge_on(still_board.path, calibration={'file': str(file)})
    [line] = graph.until(
        lambda: [m for m in logs if 'no offsets' in m.msg and m.level == WARNING], 'a warning'
    )
    assert f'{file} has no offsets of IMU 3, 5' in line.msg
    messages = graph.listen(Imu, 'imu_5/data', STREAM)
    graph.until(lambda: messages, 'its orientations all the same')


def test_a_value_beyond_int16_is_refused_with_its_place(graph, bridge_on, still_board, tmp_path):
    file = tmp_path / 'offsets.yaml'
    save_offsets(file, 2, SAVED)
    file.write_text(file.read_text().replace('777', '77777'))
    with pytest.raises(OffsetsError, match=r'imus\.2\.mag_radius: expected .* -32768 to 32767, .* got 77777'):
        bridge_on(still_board.path, calibration={'file': str(file)})


def test_offsets_are_read_on_demand(graph, bridge_on, boards):
    # Scores that rise would take what was read back at once, and a latched topic keeps one message.
    still_board = boards(arm_of(validate(values('')), halted(STILL)), boot_s=0.2, calibration_s=3600.0)
    bridge_on(still_board.path)
    heard = {i: graph.listen(ImuCalibration, f'imu_{i}/calibration', LATCHED) for i in IDS}
    graph.until(lambda: all(heard.values()), 'scores of each')
    assert not any(m.offsets_valid for m in heard[2])
    response = graph.call(Trigger, 'serial_bridge/read_offsets', Trigger.Request())
    assert response.success, response.message
    assert response.message == 'read the offsets of 3 IMUs'
    graph.until(lambda: all(any(m.offsets_valid for m in heard[i]) for i in IDS), 'offsets of each')
    for i in IDS:
        last = next(m for m in heard[i] if m.offsets_valid)
        assert offsets_of(last) == chip_offsets(still_board, i)


def test_offsets_of_an_absent_imu_are_missed_by_name(graph, bridge_on, still_board):
    still_board.unplug(3)
    bridge_on(still_board.path)
    messages = graph.listen(Imu, 'imu_2/data', STREAM)
    graph.until(lambda: messages, 'the stream')
    response = graph.call(Trigger, 'serial_bridge/read_offsets', Trigger.Request())
    assert not response.success
    assert response.message == 'IMU 3: READ_OFFSETS of IMU 3: the chip is absent'


def test_offsets_are_never_said_to_be_those_of_scores_that_came_later(graph, bridge_on, boards):
    """A fusion that has learnt more has other offsets: those read before would overwrite better ones in the file."""
    # Slow enough that the offsets are read before the scores are full, on a slow machine too.
    board = boards(arm_of(validate(values('')), halted(STILL)), calibration_s=10.0)
    bridge_on(board.path)
    heard = graph.listen(ImuCalibration, 'imu_3/calibration', EVERY_LATCHED)
    graph.until(lambda: heard and heard[-1].gyro, 'the first scores')
    assert heard[-1].sys < 3
    assert graph.call(Trigger, 'serial_bridge/read_offsets', Trigger.Request()).success
    graph.until(lambda: heard[-1].sys == 3, 'full scores')
    assert any(m.offsets_valid for m in heard)
    assert not any(m.offsets_valid for m in heard if m.sys == 3)


def test_calibrating_reads_the_offsets_when_the_scores_are_complete(graph, bridge_on, boards, tmp_path):
    board = boards(arm_of(validate(values('')), halted(STILL)), calibration_s=1.0)
    learned = {i: Offsets.from_registers(board._chips[i]._learned) for i in IDS}
    bridge_on(board.path, run={'mode': 'calibrate'}, calibration={'file': str(tmp_path / 'new.yaml')})
    heard = {i: graph.listen(ImuCalibration, f'imu_{i}/calibration', LATCHED) for i in IDS}
    graph.until(lambda: all(any(m.offsets_valid for m in heard[i]) for i in IDS), 'offsets of each')
    for i in IDS:
        [first, *_] = [m for m in heard[i] if m.offsets_valid]
        assert (first.sys, first.gyro, first.accel, first.mag) == (3, 3, 3, 3)
        assert offsets_of(first) == learned[i]


def test_mode_imu_needs_no_magnetometer(graph, bridge_on, boards, tmp_path):
    board = boards(arm_of(validate(values('')), halted(STILL)), calibration_s=1.0)
    bridge_on(
        board.path,
        run={'mode': 'calibrate'},
        calibration={'file': str(tmp_path / 'new.yaml')},
        serial={'fusion': 'IMU'},
    )
    heard = graph.listen(ImuCalibration, 'imu_2/calibration', LATCHED)
    [first, *_] = graph.until(lambda: [m for m in heard if m.offsets_valid], 'offsets')
    assert (first.gyro, first.accel, first.mag) == (3, 3, 0)


# Faults


class Streaming:
    """Whether an IMU's messages come."""

    def __init__(self, graph, imu):
        self._graph = graph
        self._imu = imu
        self.messages = graph.listen(Imu, f'imu_{imu}/data', STREAM)

    def again(self, n=10):
        """Wait until it streams from now on."""
        before = len(self.messages)
        self._graph.until(lambda: len(self.messages) >= before + n, f'IMU {self._imu} streams')
        assert (np.diff([stamp_ns(m) for m in self.messages]) > 0).all()


def test_an_imu_is_pulled_and_put_back(graph, bridge_on, still_board, tmp_path):
    file = tmp_path / 'offsets.yaml'
    for i in IDS:
        save_offsets(file, i, SAVED)
    diagnosis = graph.diagnosis()
    bridge_on(still_board.path, calibration={'file': str(file)})
    pulled, other = Streaming(graph, 3), Streaming(graph, 5)
    pulled.again()
    still_board.unplug(3)
    graph.until(
        lambda: (d := diagnosis.latest('serial_bridge: imu_3')) and d[0] == ERROR, 'an error about IMU 3'
    )
    assert diagnosis.latest('serial_bridge: imu_3')[1] == 'does not answer: cable, power, multiplexer channel'
    assert diagnosis.latest('serial_bridge: imu_5')[0] != ERROR
    silent = len(pulled.messages)
    other.again(50)
    assert len(pulled.messages) == silent
    still_board.plug(3)
    pulled.again()
    graph.until(
        lambda: (d := diagnosis.latest('serial_bridge: link')) and d[2]['comebacks'] == '1', 'the comeback'
    )
    graph.until(
        lambda: diagnosis.latest('serial_bridge: imu_3')[2].get('offsets') == 'as saved', 'its offsets'
    )
    assert chip_offsets(still_board, 3) == SAVED


def test_a_heading_of_mode_imu_is_new_after_a_comeback(graph, bridge_on, still_board):
    logs = graph.listen_to_logs()
    bridge_on(still_board.path, serial={'fusion': 'IMU'})
    streaming = Streaming(graph, 3)
    streaming.again()
    still_board.unplug(3)
    graph.until(lambda: [m for m in logs if 'IMU 3 does not answer' in m.msg], 'that it is gone')
    still_board.plug(3)
    graph.until(lambda: [m for m in logs if 'IMU 3' in m.msg and 'align again' in m.msg], 'a warning')
    streaming.again()


def test_the_board_is_reset(graph, bridge_on, still_board):
    diagnosis = graph.diagnosis()
    bridge_on(still_board.path)
    streaming = Streaming(graph, 3)
    streaming.again(100)  # a reset shows by an uptime that is more than half a second short
    still_board.reset()
    streaming.again()
    link = graph.until(
        lambda: (d := diagnosis.latest('serial_bridge: link')) and d[2]['board_resets'] == '1' and d,
        'a count',
    )
    assert float(link[2]['silent_s']) > 0.2


def test_the_cable_is_pulled_and_put_back(graph, bridge_on, boards, tmp_path):
    link = tmp_path / 'board'
    board = boards(arm_of(validate(values('')), halted(STILL)), link=link, boot_s=0.2)
    diagnosis = graph.diagnosis()
    logs = graph.listen_to_logs()
    bridge = bridge_on(link)
    streaming = Streaming(graph, 3)
    streaming.again()
    board.unplug_cable()
    graph.until(
        lambda: (d := diagnosis.latest('serial_bridge: link')) and d[0] == ERROR, 'an error of the link'
    )
    graph.until(lambda: [m for m in logs if 'trying again' in m.msg], 'what happened')
    board.plug_cable()
    streaming.again()
    assert bridge.failure is None
    graph.until(lambda: diagnosis.latest('serial_bridge: link')[2]['reconnects'] == '1', 'a count')
    graph.until(lambda: diagnosis.latest('serial_bridge: link')[0] == OK, 'all well')


def test_the_board_hangs_and_goes_on(graph, bridge_on, still_board):
    diagnosis = graph.diagnosis()
    bridge_on(still_board.path)
    streaming = Streaming(graph, 3)
    streaming.again()
    still_board.mute()
    graph.until(
        lambda: (d := diagnosis.latest('serial_bridge: link')) and d[0] == ERROR, 'an error of the link'
    )
    still_board.unmute()
    streaming.again()
    graph.until(lambda: float(diagnosis.latest('serial_bridge: link')[2]['silent_s']) > 0.25, 'the silence')


def test_damage_on_the_line_is_counted(graph, bridge_on, still_board):
    diagnosis = graph.diagnosis()
    bridge_on(still_board.path)
    streaming = Streaming(graph, 3)
    streaming.again()
    still_board.corrupt_frames(3)
    still_board.lose_bytes(5)
    streaming.again(20)

    def counted():
        link = diagnosis.latest('serial_bridge: link')
        damaged = sum(int(v) for k, v in link[2].items() if k.startswith('frame_errors_')) if link else 0
        return damaged >= 3 and int(link[2]['lost_sweeps']) >= 3

    graph.until(counted, 'counts of damage')
    assert any(level == WARN and 'damaged' in text for level, text, _ in diagnosis.of('serial_bridge: link'))


def test_what_the_link_reports_is_of_the_last_second(graph, bridge_on, still_board):
    """Sweeps, losses and damage of a report are what its counts have grown by since the report before."""
    diagnosis = graph.diagnosis()
    bridge_on(still_board.path)
    streaming = Streaming(graph, 3)
    streaming.again()
    still_board.corrupt_frames(3)
    streaming.again()

    def reports():
        return [r for r in diagnosis.of('serial_bridge: link') if r[0] in (OK, WARN)]

    graph.until(lambda: any(level == WARN for level, _, _ in reports()), 'a warning about damage')
    warned = len(reports())
    graph.until(lambda: len(reports()) >= warned + 3, 'three reports more')
    for (_, _, before), (level, text, now) in itertools.pairwise(reports()):
        grown = {
            key: int(now[key]) - int(before[key]) for key in now if now[key].isdecimal() and key in before
        }
        damaged = sum(n for key, n in grown.items() if key.startswith('frame_errors_'))
        expected = f'{grown["sweeps"]} sweeps in the last second'
        if grown['lost_sweeps'] or damaged:
            assert level == WARN
            assert text == f'{expected}, {grown["lost_sweeps"]} lost, {damaged} frames damaged'
        else:
            assert (level, text) == (OK, expected)
    assert int(reports()[-1][2]['sweeps']) > 300


# What makes a start impossible


def fails(graph, bridge):
    graph.until(lambda: bridge.finished, 'the end')
    return str(bridge.failure)


def test_the_port_is_not_there(graph, bridge_on, tmp_path):
    message = fails(graph, bridge_on(tmp_path / 'nothing'))
    assert f'serial port {tmp_path}/nothing is not there; present:' in message


def test_the_port_is_held_by_another_program(graph, bridge_on, still_board):
    other = SerialPort(still_board.path, 500_000)
    try:
        message = fails(graph, bridge_on(still_board.path))
    finally:
        other.close()
    assert f'serial port {still_board.path} is held by another program' in message


def test_the_board_speaks_another_version(graph, bridge_on, boards):
    board = boards(arm_of(validate(values('')), halted(STILL)), version=9)
    message = fails(graph, bridge_on(board.path))
    assert 'the board speaks protocol version 9, this package version 2' in message


def test_nobody_answers(graph, bridge_on, still_board):
    still_board.mute()
    assert 'no board answered HELLO within 3 s; nothing came' in fails(graph, bridge_on(still_board.path))


@pytest.mark.parametrize('fault', ['absent', 'busy', 'version'])
def test_as_a_program_a_start_that_is_impossible_ends_with_1_and_why(boards, tmp_path, fault):
    board = boards(arm_of(validate(values('')), halted(STILL)), version=9 if fault == 'version' else 2)
    other = SerialPort(board.path, 500_000) if fault == 'busy' else None
    port = str(tmp_path / 'nothing') if fault == 'absent' else board.path
    config = tmp_path / 'arm.yaml'
    config.write_text(files.dump(validate(values(port))))
    expected = {'absent': 'is not there', 'busy': 'held by another program', 'version': 'version 9'}[fault]
    with node('serial_bridge', tmp_path, '--ros-args', '--params-file', config) as program:
        assert failed_clearly(program, port, expected)
    if other:
        other.close()
