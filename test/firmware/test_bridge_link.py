"""The serial bridge on the firmware's ELF: what it publishes, and how it keeps the link up."""

import shutil

import numpy as np
import pytest
from bridge_bench import IDS, QUATERNIONS, SAVED, raw
from diagnostic_msgs.msg import DiagnosticStatus
from sesa2_msgs.msg import ImuCalibration
from simulated_board import FIRMWARE, SimulatedBoard
from std_srvs.srv import Trigger

from sesa2.link.link_errors import LinkError, ProtocolVersionError
from sesa2.link.packets import State
from sesa2.link.requests import Command
from sesa2.link.serial_port import SerialPort
from sesa2.ros.qos import LATCHED
from sesa2.sensing.imu.bno055.offsets import Offsets

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
RUN = [State.RUN] * len(IDS)


def assert_set_up_again(bench, since_s):
    """Streaming and checked within a second of the first answered HELLO, by what was on the line."""
    hello_s = bench.replies(Command.HELLO, since_s)[0][0]
    bench.until(bench.settled, 'a link that is set up')
    bench.run(0.1)
    running_s = next(at_s for at_s, data in bench.data(hello_s) if data.states == RUN)
    checked = bench.replies(Command.READ_OFFSETS, hello_s)
    read = [Offsets.from_registers(reply.fields) for _, reply in checked if reply.fields]
    assert sorted(map(str, read)) == sorted(map(str, SAVED.values()))
    again_s = next(at_s for at_s, data in bench.data(checked[-1][0]) if data.states == RUN)
    assert running_s - hello_s < 1.0
    assert again_s - hello_s < 1.0
    bench.assert_offsets_on_chips()


def assert_healthy(bench, **counts):
    """What /diagnostics says of a link that works, and what it has counted; all else is 0."""
    report = bench.report()
    level, text, values = report['link']
    assert level == OK, text
    # An IMU is worth a warning here: the simulated chips' scores are 0.
    assert {report[f'imu_{i}'][2]['state'] for i in IDS} == {'RUN'}
    assert {report[f'imu_{i}'][2]['offsets'] for i in IDS} == {'as saved'}
    counted = {
        name: float(values[name])
        for name in (
            'lost_sweeps',
            'malformed',
            'stray_frames',
            'frame_errors_cobs',
            'frame_errors_crc',
            'frame_errors_length',
            'retries',
            'reconnects',
            'board_resets',
            'stalls',
            'comebacks',
            'offset_differences',
            'clock_jumps',
        )
    }
    assert {name: count for name, count in counted.items() if count} == counts
    assert float(values['silent_s']) == pytest.approx(silence(bench), abs=0.005)


def silence(bench):
    """Time without sweeps, s."""
    gaps_s = np.diff([at_s for at_s, _ in bench.data()])
    return gaps_s[gaps_s > 0.25].sum()


def test_every_sweep_of_the_board_is_published(bridge_bench):
    bridge_bench.start()
    start_s = bridge_bench.timeline.now_s
    bridge_bench.run(2.0)
    assert len(bridge_bench.data(start_s)) == pytest.approx(200, abs=1)
    bridge_bench.assert_all_published()
    for i in IDS:
        assert raw(bridge_bench.imus[i][-1]) == QUATERNIONS[i]
    bridge_bench.assert_offsets_on_chips()
    assert_healthy(bridge_bench)


def test_offsets_are_read_from_the_chips_on_demand(bridge_bench):
    bridge_bench.start()
    learned = Offsets((7, 7, 7), (8, 8, 8), (9, 9, 9), 1001, 481)
    for k, value in enumerate(learned.to_registers()):
        bridge_bench.simulated.command('poke', 4, 0x55 + k, value)
    heard = bridge_bench.graph.listen(ImuCalibration, 'imu_5/calibration', LATCHED)
    bridge_bench.timeline.allow(2.0)
    response = bridge_bench.graph.call(Trigger, 'serial_bridge/read_offsets', Trigger.Request())
    assert (response.success, response.message) == (True, 'read the offsets of 8 IMUs')
    bridge_bench.graph.until(
        lambda: heard and heard[-1].offsets_valid and tuple(heard[-1].accel_offset) == learned.accel_offset,
        'the offsets of IMU 5',
    )
    assert (heard[-1].accel_radius, heard[-1].mag_radius) == (1001, 481)


def test_a_reset_of_the_board(bridge_bench):
    bridge_bench.start()
    for count in (1, 2):
        reset_s = bridge_bench.timeline.now_s
        bridge_bench.simulated.command('reset')
        bridge_bench.until(lambda: not bridge_bench.bridge.links[0].session.connected, 'a noticed reset')
        bridge_bench.until(lambda since=reset_s: bridge_bench.replies(Command.HELLO, since), 'HELLO')
        assert_set_up_again(bridge_bench, reset_s)
        assert_healthy(bridge_bench, board_resets=count)
    bridge_bench.assert_all_published()
    stamps = [message.header.stamp for message in bridge_bench.imus[1]]
    assert (np.diff([stamp.sec * 10**9 + stamp.nanosec for stamp in stamps]) > 0).all()


def test_a_power_cut_of_everything(bridge_bench):
    """Unlike a reset it takes the offsets off the chips, which then boot for 0.65 s."""
    bridge_bench.start()
    cut_s = bridge_bench.timeline.now_s
    bridge_bench.simulated.command('power')
    assert bridge_bench.simulated.registers(0, 0x55, 22) == bytes(22)
    bridge_bench.until(lambda: bridge_bench.replies(Command.HELLO, cut_s), 'HELLO')
    assert_set_up_again(bridge_bench, cut_s)
    assert_healthy(bridge_bench, board_resets=1, comebacks=8)
    bridge_bench.assert_all_published()


@pytest.mark.parametrize(
    ('out_s', 'resets'),
    [(0.0, False), (0.1, True), (1.0, False)],
    ids=['and put back at once', 'and a reset', 'for some time'],
)
def test_a_pulled_cable(bridge_bench, out_s, resets):
    """Opening the port of a real Mega resets it; a cable that is pulled behind a hub's own power does not."""
    bridge_bench.start()
    for count in (1, 2):
        pulled_s = bridge_bench.timeline.now_s
        bridge_bench.simulated.command('cable', 0)
        bridge_bench.graph.until(lambda: not bridge_bench.bridge.links[0].session.connected, 'a noticed pull')
        if out_s:
            level, text, _ = bridge_bench.report()['link']
            assert (level, text) == (ERROR, 'no board streams on this port; trying again')
        bridge_bench.timeline.skip(out_s)
        if resets:
            bridge_bench.simulated.command('reset')
        bridge_bench.simulated.command('cable', 1)
        bridge_bench.until(lambda since=pulled_s: bridge_bench.replies(Command.HELLO, since), 'HELLO')
        assert_set_up_again(bridge_bench, pulled_s)
        assert bridge_bench.bridge.links[0].session.counters().reconnects == count
    counters = bridge_bench.bridge.links[0].session.counters()
    assert counters.board_resets == 2 * resets
    assert counters.lost_sweeps == counters.offset_differences == counters.comebacks == 0
    assert counters.silent_s == pytest.approx(silence(bridge_bench), abs=0.005)
    bridge_bench.assert_all_published()


def test_a_port_that_another_program_takes_while_the_cable_is_out(bridge_bench):
    bridge_bench.start()
    pulled_s = bridge_bench.timeline.now_s
    bridge_bench.simulated.command('cable', 0)
    bridge_bench.graph.until(lambda: not bridge_bench.bridge.links[0].session.connected, 'a noticed pull')
    # Under another name first, so that the other program is there before the bridge.
    bridge_bench.port.unlink()
    bridge_bench.simulated.command('cable', 1)
    other = SerialPort(bridge_bench.simulated.port_path, 500_000)
    bridge_bench.port.symlink_to(bridge_bench.simulated.port_path)
    logs = bridge_bench.logs
    bridge_bench.graph.until(
        lambda: any(f'{bridge_bench.port} is held by another program' in line.msg for line in logs),
        'the reason',
    )
    assert bridge_bench.report()['link'][0] == ERROR
    other.close()
    bridge_bench.until(lambda: bridge_bench.replies(Command.HELLO, pulled_s), 'HELLO')
    assert_set_up_again(bridge_bench, pulled_s)
    assert bridge_bench.bridge.links[0].session.counters().reconnects == 1
    assert (
        len([line for line in logs if 'is held by another program' in line.msg]) == 1
    )  # said once, tried often
    bridge_bench.assert_all_published()


def test_a_port_that_is_held_from_the_start(bridge_bench):
    other = SerialPort(bridge_bench.simulated.port_path, 500_000)
    bridge = bridge_bench.start(streaming=False)
    bridge_bench.graph.until(lambda: bridge.finished, 'its end')
    other.close()
    assert isinstance(bridge.failure, LinkError)
    assert f'{bridge_bench.port} is held by another program' in str(bridge.failure)


@pytest.fixture
def board_of_version_1(build_variant, tmp_path):
    """A board whose firmware speaks the first version of the protocol."""
    sketch = tmp_path / 'sesa2_firmware'
    shutil.copytree(FIRMWARE / 'sesa2_firmware', sketch)
    packets = sketch / 'packets.h'
    text = packets.read_text()
    assert 'PROTOCOL_VERSION = 2,' in text
    packets.write_text(text.replace('PROTOCOL_VERSION = 2,', 'PROTOCOL_VERSION = 1,'))
    with SimulatedBoard(elf=build_variant('version_1', f'SKETCH={sketch}').elf) as simulated:
        yield simulated


VERSIONS = 'the board speaks protocol version 1, this package version 2; flash the firmware'


def test_a_board_of_another_version(bridge_bench, board_of_version_1):
    bridge_bench.put_on_port(board_of_version_1)
    bridge = bridge_bench.start(streaming=False)
    bridge_bench.until(lambda: bridge.finished, 'its end')
    assert isinstance(bridge.failure, ProtocolVersionError)
    assert f'{bridge_bench.port}: {VERSIONS}' in str(bridge.failure)
    assert bridge_bench.report()['link'][0] == ERROR


def test_a_board_of_another_version_that_is_plugged_in_later(bridge_bench, board_of_version_1):
    bridge = bridge_bench.start()
    first = bridge_bench.simulated
    bridge_bench.port.unlink()
    first.command('cable', 0)
    bridge_bench.graph.until(lambda: not bridge.links[0].session.connected, 'a noticed pull')
    bridge_bench.put_on_port(board_of_version_1)
    bridge_bench.until(lambda: bridge.finished, 'its end')
    assert isinstance(bridge.failure, ProtocolVersionError)
    assert VERSIONS in str(bridge.failure)
