"""A bench's faults with the serial bridge on top: what it harms, what it does not, and what /diagnostics says of it."""

import random

import pytest
from bridge_bench import IDS, QUATERNIONS, SAVED, raw
from diagnostic_msgs.msg import DiagnosticStatus
from sesa2_msgs.msg import ImuCalibration
from std_srvs.srv import Trigger

from sesa2.link.packets import State
from sesa2.link.requests import Command
from sesa2.ros.qos import LATCHED
from sesa2.sensing.imu.bno055.offsets import Offsets

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


def others(imu_id):
    return [i for i in IDS if i != imu_id]


def state_of(bench, imu_id):
    return bench.bridge.links[0].session.imus()[imu_id].state


def assert_unharmed(bench, imu_ids, since_s):
    """Each measured in every sweep, what its chip showed; no sweep was left out."""
    data = [packet for _, packet in bench.data(since_s)]
    assert [packet.sweep.seq for packet in data] == list(range(data[0].sweep.seq, data[-1].sweep.seq + 1))
    for packet in data:
        for i in imu_ids:
            x, y, z, w = (int(value * 16384) for value in packet.orientations[i - 1])
            assert (w, x, y, z) == QUATERNIONS[i], f'IMU {i}, sweep {packet.sweep.seq}'
    bench.assert_all_published()
    assert bench.bridge.links[0].session.counters().lost_sweeps == 0


def offsets_read(bench, since_s):
    """What chips have answered to READ_OFFSETS, in the order of the ids."""
    read = [
        Offsets.from_registers(r.fields) for _, r in bench.replies(Command.READ_OFFSETS, since_s) if r.fields
    ]
    return sorted(read, key=lambda offsets: offsets.mag_radius)


def test_an_imu_is_unplugged_and_replugged(bridge_bench):
    bridge_bench.start()
    calibrations = bridge_bench.graph.listen(ImuCalibration, 'imu_4/calibration', LATCHED)
    out_s = bridge_bench.timeline.now_s
    bridge_bench.simulated.command('unplug', 3)
    bridge_bench.run(1.0)
    report = bridge_bench.report()
    assert report['imu_4'][:2] == (ERROR, 'does not answer: cable, power, multiplexer channel')
    assert report['imu_4'][2]['state'] == 'ABSENT'
    assert int(report['imu_4'][2]['errors']) > 0
    assert {report[f'imu_{i}'][2]['state'] for i in others(4)} == {'RUN'}
    assert {report[f'imu_{i}'][2]['errors'] for i in others(4)} == {'0'}
    assert report['link'][0] == OK
    seen = len(bridge_bench.imus[4])
    bridge_bench.run(0.5)
    assert len(bridge_bench.imus[4]) == seen

    back_s = bridge_bench.timeline.now_s
    bridge_bench.simulated.command('plug', 3)
    assert bridge_bench.simulated.registers(3, 0x55, 22) == bytes(22)
    bridge_bench.until(lambda: bridge_bench.bridge.links[0].session.counters().comebacks, 'a comeback')
    bridge_bench.run(0.2)
    assert offsets_read(bridge_bench, back_s) == [SAVED[4]]
    bridge_bench.assert_offsets_on_chips()
    assert_unharmed(bridge_bench, others(4), out_s)
    report = bridge_bench.report()
    assert (report['imu_4'][2]['state'], report['imu_4'][2]['offsets']) == ('RUN', 'as saved')
    assert report['imu_4'][2]['errors'] == '0'
    link = report['link'][2]
    assert (link['comebacks'], link['board_comebacks']) == ('1', '(0, 0, 0, 1, 0, 0, 0, 0)')
    assert link['offset_differences'] == link['lost_sweeps'] == link['reconnects'] == '0'
    bridge_bench.graph.until(
        lambda: calibrations[-1].offsets_valid and calibrations[-1].mag_radius == SAVED[4].mag_radius,
        'its calibration',
    )


def test_a_power_blip_of_one_chip(bridge_bench):
    bridge_bench.start()
    blip_s = bridge_bench.timeline.now_s
    bridge_bench.simulated.command('blip', 5)
    bridge_bench.until(lambda: bridge_bench.bridge.links[0].session.counters().comebacks, 'a comeback')
    bridge_bench.run(0.2)
    assert offsets_read(bridge_bench, blip_s) == [SAVED[6]]
    bridge_bench.assert_offsets_on_chips()
    assert_unharmed(bridge_bench, others(6), blip_s)
    report = bridge_bench.report()
    assert (report['imu_6'][2]['state'], report['imu_6'][2]['offsets']) == ('RUN', 'as saved')
    assert report['link'][2]['comebacks'] == '1'


def test_the_multiplexer_is_unplugged_and_replugged(bridge_bench):
    bridge_bench.start()
    out_s = bridge_bench.timeline.now_s
    bridge_bench.simulated.command('unplug', 'multiplexer')
    bridge_bench.run(1.0)
    report = bridge_bench.report()
    assert {report[f'imu_{i}'][0] for i in IDS} == {ERROR}
    assert report['link'][0] == OK  # the board streams: that there is nothing
    bridge_bench.simulated.command('plug', 'multiplexer')
    bridge_bench.until(
        lambda: bridge_bench.bridge.links[0].session.counters().comebacks == 8, 'all comebacks'
    )
    bridge_bench.run(0.2)
    assert offsets_read(bridge_bench, out_s) == list(SAVED.values())
    bridge_bench.assert_offsets_on_chips()
    assert_unharmed(bridge_bench, [], out_s)
    report = bridge_bench.report()
    assert {report[f'imu_{i}'][2]['state'] for i in IDS} == {'RUN'}
    assert {report[f'imu_{i}'][2]['offsets'] for i in IDS} == {'as saved'}
    assert report['link'][2]['board_comebacks'] == '(1, 1, 1, 1, 1, 1, 1, 1)'


@pytest.mark.parametrize('line', ['sda', 'scl'])
def test_a_stuck_bus(bridge_bench, line):
    bridge_bench.start()
    stuck_s = bridge_bench.timeline.now_s
    bridge_bench.simulated.command('hold', 'trunk', line)
    bridge_bench.run(1.5)
    report = bridge_bench.report()
    assert {report[f'imu_{i}'][0] for i in IDS} == {ERROR}
    assert report['link'][0] == OK
    assert int(report['link'][2]['board_bus_recoveries']) > 0
    assert min(int(report[f'imu_{i}'][2]['errors']) for i in IDS) > 0
    bridge_bench.simulated.command('release', 'trunk')
    bridge_bench.until(
        lambda: bridge_bench.bridge.links[0].session.counters().comebacks == 8, 'all comebacks'
    )
    bridge_bench.run(0.2)
    assert offsets_read(bridge_bench, stuck_s) == list(SAVED.values())
    bridge_bench.assert_offsets_on_chips()
    assert_unharmed(bridge_bench, [], stuck_s)
    assert bridge_bench.settled()


def test_a_chip_that_holds_its_line(bridge_bench):
    """With RST of the multiplexer wired, it costs only itself but for a sample now and then."""
    bridge_bench.start()
    held_s = bridge_bench.timeline.now_s
    bridge_bench.simulated.command('hold', 2, 'sda')
    bridge_bench.run(2.0)
    report = bridge_bench.report()
    assert report['imu_3'][0] == ERROR
    assert {report[f'imu_{i}'][2]['state'] for i in others(3)} == {'RUN'}
    bridge_bench.simulated.command('release', 2)
    bridge_bench.until(lambda: bridge_bench.bridge.links[0].session.counters().comebacks, 'a comeback')
    bridge_bench.run(0.2)
    assert bridge_bench.settled()
    assert_unharmed(bridge_bench, [], held_s)
    for i in others(3):
        assert {raw(message) for message in bridge_bench.imus[i]} == {QUATERNIONS[i]}
        assert len(bridge_bench.imus[i]) >= 0.95 * len(bridge_bench.data())


def test_a_chip_that_does_not_take_its_offsets(bridge_bench):
    """It measures, but its heading may be wrong: the user is to know."""
    bridge_bench.simulated.command('refuse', 6, 1)
    bridge_bench.start(streaming=False)
    bridge_bench.until(
        lambda: bridge_bench.bridge.links[0].session.counters().offset_differences, 'a difference'
    )
    bridge_bench.run(1.5)
    report = bridge_bench.report()
    assert report['imu_7'][:2] == (ERROR, 'works with other offsets than those saved')
    assert {report[f'imu_{i}'][2]['offsets'] for i in others(7)} == {'as saved'}
    assert report['link'][2]['offset_differences'] == '1'
    assert raw(bridge_bench.imus[7][-1]) == QUATERNIONS[7]


def test_an_imu_that_is_not_there_at_the_start(bridge_bench):
    bridge_bench.simulated.command('unplug', 0)
    bridge_bench.start(streaming=False)
    bridge_bench.until(lambda: state_of_all(bridge_bench) == [State.ABSENT] + [State.RUN] * 7, 'all others')
    bridge_bench.run(0.5)
    assert [line.msg for line in bridge_bench.logs if 'absent' in line.msg] == [
        'IMU 1 is absent; the board keeps its offsets until it comes back'
    ]
    assert bridge_bench.report()['imu_1'][0] == ERROR
    bridge_bench.simulated.command('plug', 0)
    bridge_bench.until(bridge_bench.settled, 'all of them')
    bridge_bench.assert_offsets_on_chips()


def state_of_all(bench):
    return [imu.state for imu in bench.bridge.links[0].session.imus().values()]


class Damage:
    """Flips a bit, drops or adds a byte, in some portions; seeded."""

    def __init__(self, seed, share):
        self._random = random.Random(seed)
        self._share = share

    def __call__(self, portion):
        if self._random.random() > self._share:
            return portion
        at = self._random.randrange(len(portion))
        kind = self._random.randrange(3)
        if kind == 0:
            flipped = portion[at] ^ 1 << self._random.randrange(8)
            return portion[:at] + bytes((flipped,)) + portion[at + 1 :]
        if kind == 1:
            return portion[:at] + portion[at + 1 :]
        return portion[:at] + self._random.randbytes(1 + self._random.randrange(40)) + portion[at:]


def test_garbage_from_the_board(bridge_bench):
    """What is damaged is dropped, counted and shown; what is published is right."""
    bridge_bench.start()
    start_s = bridge_bench.timeline.now_s
    counted = bridge_bench.bridge.links[0].session.counters().sweeps
    bridge_bench.timeline.damage = Damage(1, 0.05)
    bridge_bench.run(5.0)
    bridge_bench.timeline.damage = lambda portion: portion
    bridge_bench.run(0.1)
    values = bridge_bench.report()['link'].values
    link = [report.parts['link'] for report in bridge_bench.reports]
    assert any(part.level == WARN and 'lost' in part.text and 'damaged' in part.text for part in link)
    sent = len(bridge_bench.data(start_s))
    received = int(values['sweeps']) - counted
    assert int(values['lost_sweeps']) == sent - received > 10
    errors = sum(int(values[f'frame_errors_{cause}']) for cause in ('cobs', 'crc', 'length'))
    assert errors >= int(values['lost_sweeps'])
    for i in IDS:
        assert {raw(message) for message in bridge_bench.imus[i]} == {QUATERNIONS[i]}
    assert bridge_bench.settled()
    assert (values['reconnects'], values['board_resets'], values['stalls']) == ('0', '0', '0')


def test_garbage_to_the_board(bridge_bench):
    """Commands that do not get through are given again; the board counts what it drops, and streams on."""
    bridge_bench.start()
    start_s = bridge_bench.timeline.now_s
    noise, damage = random.Random(2), Damage(3, 0.3)
    bridge_bench.timeline.noise = lambda frame: noise.randbytes(noise.randrange(200)) + damage(frame)
    bridge_bench.timeline.allow(5.0)
    response = bridge_bench.graph.call(Trigger, 'serial_bridge/read_offsets', Trigger.Request())
    assert response.success, response.message
    bridge_bench.graph.until(bridge_bench.timeline.rests, 'the rest of the time')
    bridge_bench.timeline.noise = lambda frame: frame
    bridge_bench.run(1.5)
    values = bridge_bench.report()['link'][2]
    assert int(values['retries']) > 0
    assert int(values['board_rx_bad']) > 10
    assert set(offsets_read(bridge_bench, start_s)) == set(SAVED.values())
    bridge_bench.assert_offsets_on_chips()
    assert (values['lost_sweeps'], values['reconnects'], values['board_resets']) == ('0', '0', '0')
