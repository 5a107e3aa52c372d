"""One serial bridge on two virtual boards, sixteen IMUs on one arm: each at its own id, and each board for itself."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import Imu, JointState
from sesa2_msgs.msg import ImuCalibration
from std_srvs.srv import Trigger
from virtual_arms import arm_of, halted, plausible

from sesa2.configuration import files
from sesa2.link.clock import steady_ns
from sesa2.link.virtual.virtual_board import VirtualBoard
from sesa2.nodes.estimator import EstimatorNode
from sesa2.nodes.serial_bridge import SerialBridge
from sesa2.ros.parameters import overrides
from sesa2.ros.qos import LATCHED, STREAM
from sesa2.sensing.imu.bno055.offsets import Offsets, save_offsets

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
IDS = range(1, 17)
FIRST, SECOND = range(1, 9), range(9, 17)
SAVED = {i: Offsets((i, -2, 3), (400, -500, 600), (-7, 8, -9), 1001, 700 + i) for i in IDS}

SHIPPED = files.load(files.find('two_boards'))
# Headings and mountings are in what is published, so that no two IMUs show alike.
CONFIGURATION = replace(
    SHIPPED, imus=replace(SHIPPED.imus, headings=tuple(np.linspace(-0.8, 0.8, 16).tolist()))
)
POSE = plausible(CONFIGURATION, 17.0)


@pytest.fixture
def two(boards, tmp_path):
    """Two boards on an arm that holds still, under the links `board0` and `board1`."""

    def make(moving=False, **options):
        arm = arm_of(CONFIGURATION, None if moving else halted(POSE))
        epoch_ns = steady_ns()
        options = {'boot_s': 0.2, 'calibration_s': 1.0} | options
        return [
            boards(arm, number=k, epoch_ns=epoch_ns, link=tmp_path / f'board{k}', **options) for k in (0, 1)
        ]

    return make


@pytest.fixture
def configuration_on(tmp_path):
    """The configuration on the two links, with saved offsets of all chips where asked for."""

    def make(saved=False, **serial):
        c = CONFIGURATION
        ports = (str(tmp_path / 'board0'), str(tmp_path / 'board1'))
        c = replace(c, serial=replace(c.serial, ports=ports, **serial))
        if saved:
            for i in IDS:
                save_offsets(tmp_path / 'offsets.yaml', i, SAVED[i])
            c = replace(c, calibration=replace(c.calibration, file=str(tmp_path / 'offsets.yaml')))
        return c

    return make


@pytest.fixture
def bridge_on(graph, configuration_on):
    """Starts the bridge on the two boards."""
    return lambda **options: graph.add(
        SerialBridge(parameter_overrides=overrides(configuration_on(**options)))
    )


def listen_to_all(graph):
    return {i: graph.listen(Imu, f'imu_{i}/data', STREAM) for i in IDS}


def all_more(messages, ids, count=20):
    """Whether all of some IMUs have been heard so often from now on, as a condition to wait for."""
    before = {i: len(messages[i]) for i in ids}
    return lambda: all(len(messages[i]) >= before[i] + count for i in ids)


def orientation(message):
    q = message.orientation
    return np.array([q.x, q.y, q.z, q.w])


def stamp_ns(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def assert_right_at_their_ids(board, messages):
    given = board.arm.orientations(IDS, np.zeros(16), np.zeros(16))
    for k, i in enumerate(IDS):
        for message in messages[i]:
            np.testing.assert_allclose(orientation(message), given[k], rtol=0, atol=2**-15 + 1e-12)
            assert message.header.frame_id == f'imu_{i}'
        assert (np.diff([stamp_ns(m) for m in messages[i]]) > 0).all()


def test_sixteen_imus_are_heard_each_at_its_own_id(graph, bridge_on, two):
    first, _ = two()
    bridge = bridge_on()
    messages = listen_to_all(graph)
    graph.until(all_more(messages, IDS, 50), 'all sixteen')
    assert_right_at_their_ids(first, messages)
    assert list(bridge.imus()) == list(IDS)
    assert bridge.connected


def test_each_board_has_diagnostics_of_its_own(graph, bridge_on, two, tmp_path):
    _, second = two()
    diagnosis = graph.diagnosis()
    bridge_on()
    graph.until(
        lambda: all((d := diagnosis.latest(f'serial_bridge: link {k}')) and d[0] == OK for k in (0, 1)),
        'both well',
    )
    second.unplug(11)
    graph.until(
        lambda: (d := diagnosis.latest('serial_bridge: imu_11')) and 'does not answer' in d[1], 'IMU 11 gone'
    )
    assert 'does not answer' not in diagnosis.latest('serial_bridge: imu_3')[1]
    ports = {
        status.hardware_id
        for array in diagnosis._messages
        for status in array.status
        if status.name == 'serial_bridge: imu_11'
    }
    assert ports == {str(tmp_path / 'board1')}
    assert diagnosis.latest('serial_bridge: link') is None


def test_offsets_go_to_the_chips_that_they_belong_to(graph, bridge_on, two):
    boards = two()
    bridge_on(saved=True)
    heard = {i: graph.listen(ImuCalibration, f'imu_{i}/calibration', LATCHED) for i in IDS}
    graph.until(lambda: all(any(m.offsets_valid for m in heard[i]) for i in IDS), 'offsets of each')
    for ids, board in zip((FIRST, SECOND), boards, strict=True):
        assert {i: Offsets.from_registers(board._chips[i].read_offsets()) for i in ids} == {
            i: SAVED[i] for i in ids
        }
    for i in IDS:
        assert {m.mag_radius for m in heard[i] if m.offsets_valid} == {SAVED[i].mag_radius}


def test_offsets_are_read_from_both_boards_on_demand(graph, bridge_on, two):
    boards = two(calibration_s=3600.0)
    bridge_on()
    messages = listen_to_all(graph)
    graph.until(all_more(messages, IDS), 'all sixteen')
    heard = {i: graph.listen(ImuCalibration, f'imu_{i}/calibration', LATCHED) for i in (2, 10)}
    response = graph.call(Trigger, 'serial_bridge/read_offsets', Trigger.Request())
    assert (response.success, response.message) == (True, 'read the offsets of 16 IMUs')
    graph.until(lambda: all(any(m.offsets_valid for m in heard[i]) for i in heard), 'offsets')
    for i, board in zip(heard, boards, strict=True):
        said = next(m for m in heard[i] if m.offsets_valid).mag_radius
        assert said == Offsets.from_registers(board._chips[i].read_offsets()).mag_radius


def test_losing_a_board_costs_the_other_nothing(graph, bridge_on, two, tmp_path):
    first, second = two()
    diagnosis = graph.diagnosis()
    logs = graph.listen_to_logs()
    bridge = bridge_on(saved=True)
    messages = listen_to_all(graph)
    graph.until(all_more(messages, IDS), 'all sixteen')
    for _ in range(2):
        second.unplug_cable()
        graph.until(
            lambda: (d := diagnosis.latest('serial_bridge: link 1')) and d[0] == ERROR, 'an error of its link'
        )
        graph.until(
            lambda: (
                (d := diagnosis.latest('serial_bridge: imu_9'))
                and d[0] == ERROR
                and diagnosis.latest('serial_bridge: link 0')
            ),
            'an error of an IMU on that board',
        )
        assert diagnosis.latest('serial_bridge: link 0')[0] != ERROR
        graph.until(
            all_more(messages, FIRST), 'the other board'
        )  # what the lost one said last has come by then
        silent = {i: len(messages[i]) for i in SECOND}
        graph.until(all_more(messages, FIRST, 100), 'the other board')
        assert {i: len(messages[i]) for i in SECOND} == silent
        assert bridge.failure is None
        assert not bridge.finished
        second.plug_cable()
        graph.until(all_more(messages, IDS), 'all sixteen again')
    assert [m for m in logs if f'serial port {tmp_path / "board1"} was lost' in m.msg]
    counted = [link.session.counters() for link in bridge.links]
    assert [c.reconnects for c in counted] == [0, 2]
    assert [c.lost_sweeps for c in counted] == [0, 0]
    assert_right_at_their_ids(first, messages)
    graph.until(
        lambda: diagnosis.latest('serial_bridge: imu_9')[2].get('offsets') == 'as saved',
        'its offsets checked',
    )


def test_a_board_of_another_version_that_is_plugged_in_later_ends_its_own_link(
    graph, bridge_on, two, tmp_path
):
    _, second = two()
    diagnosis = graph.diagnosis()
    bridge = bridge_on()
    messages = listen_to_all(graph)
    graph.until(all_more(messages, IDS), 'all sixteen')
    second.close()
    with VirtualBoard(second.arm, number=1, link=tmp_path / 'board1', version=9):
        graph.until(
            lambda: (d := diagnosis.latest('serial_bridge: link 1')) and 'make -C firmware upload' in d[1],
            'what to do',
        )
        graph.until(all_more(messages, FIRST, 100), 'the other board')
        assert bridge.failure is None
        assert not bridge.finished


@pytest.mark.parametrize('missing', [0, 1])
def test_a_start_without_one_of_the_boards_fails_and_names_it(graph, bridge_on, two, tmp_path, missing):
    two()[missing].close()
    bridge = bridge_on()
    graph.until(lambda: bridge.finished, 'the end')
    assert f'serial port {tmp_path / f"board{missing}"} is not there' in str(bridge.failure)


def test_boards_in_the_other_order_are_other_ids(graph, configuration_on, two, tmp_path):
    """What the ports' order says is all there is to tell the boards apart: the ids are its, not the chips'."""
    first, _ = two()
    c = configuration_on()
    c = replace(c, serial=c.serial.on(c.serial.ports[::-1]))
    graph.add(SerialBridge(parameter_overrides=overrides(c)))
    messages = listen_to_all(graph)
    graph.until(all_more(messages, IDS), 'all sixteen')
    given = first.arm.orientations(IDS, np.zeros(16), np.zeros(16))
    for i in FIRST:
        np.testing.assert_allclose(orientation(messages[i][-1]), given[i + 7], rtol=0, atol=2**-14)
        np.testing.assert_allclose(orientation(messages[i + 8][-1]), given[i - 1], rtol=0, atol=2**-14)


def test_sweeps_hold_the_imus_of_both_boards(graph, configuration_on, two):
    """The boards sweep at times of their own: all the same each result has all sixteen, one a sweep."""
    two(moving=True)
    c = configuration_on()
    estimator = graph.add(EstimatorNode(parameter_overrides=overrides(c)))
    sweeps = []
    publish = estimator._publish
    estimator._publish = lambda sweep: (sweeps.append(sweep), publish(sweep))
    bridge = graph.add(SerialBridge(parameter_overrides=overrides(c)))
    results = graph.listen(JointState, 'pcc/joint_states', STREAM)
    graph.until(lambda: bridge.connected and len(bridge.imus()) == 16, 'both boards')
    graph.until(lambda: sweeps and sweeps[-1].measured.all(), 'a whole sweep')
    sweeps.clear()
    results.clear()
    graph.until(lambda: len(sweeps) >= 300, 'sweeps')
    assert all(sweep.measured.all() for sweep in sweeps)
    steps_ms = np.diff([sweep.stamp_ns for sweep in sweeps]) * 1e-6
    assert np.median(steps_ms) == pytest.approx(10.0, abs=1.0)
    assert (steps_ms > 0).all()
    assert threading.active_count() < 30


def test_an_older_firmware_on_one_board_is_a_warning_about_that_board(graph, bridge_on, two, tmp_path):
    _, second = two()
    second.close()
    diagnosis = graph.diagnosis()
    with VirtualBoard(second.arm, number=1, link=tmp_path / 'board1', release=(0, 9)):
        bridge_on()
        messages = listen_to_all(graph)
        graph.until(all_more(messages, IDS), 'all sixteen')
        graph.until(
            lambda: (d := diagnosis.latest('serial_bridge: link 1')) and 'firmware 0.9' in d[1], 'a warning'
        )
        level, text, values = diagnosis.latest('serial_bridge: link 1')
        assert level == WARN
        assert 'make -C firmware upload' in text
        assert values['firmware'] == '0.9'
        graph.until(
            lambda: (d := diagnosis.latest('serial_bridge: link 0')) and d[0] == OK, 'the other is well'
        )
