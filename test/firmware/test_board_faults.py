"""Everything that a bench does to a bus: plugs pulled, power lost, lines held low, a cable out."""

import pytest
from simulated_board import Reading, pattern

from bench import assert_no_gap, assert_quaternions_right
from sesa2.link.packets import State
from sesa2.link.requests import FusionMode
from sesa2.sensing.imu.bno055.offsets import Offsets

OFFSETS = 0x55
AXES = bytes((0x24, 0x00))


def offsets_of(channel):
    return Offsets((channel, -2, 3), (-400, 500 + channel, -600), (1, -1, channel), 1000, 480 + channel)


@pytest.fixture
def calibrated(streaming):
    """Streams, with offsets on every chip."""
    for channel in range(8):
        streaming.client.write_offsets(channel + 1, offsets_of(channel))
    streaming.until(lambda data: all(data.state_of(channel) is State.RUN for channel in range(8)))
    return streaming


def assert_brought_back(bench, channel, mode=FusionMode.NDOF):
    """A chip has all that it lost with its power."""
    assert bench.simulated.registers(channel, OFFSETS, 22) == offsets_of(channel).to_registers()
    assert bench.simulated.registers(channel, 0x41, 2) == AXES
    assert bench.simulated.mode(channel) == mode


def others(channel):
    return [other for other in range(8) if other != channel]


def test_unplugging_and_replugging_one_imu(calibrated):
    calibrated.simulated.command('calibration', 3, 0xFF)
    assert calibrated.watch(0.1)[-1].calibration_of(3) == 0xFF
    calibrated.simulated.command('unplug', 3)
    assert calibrated.until(lambda data: data.state_of(3) is State.ABSENT) < 0.03
    out = calibrated.watch(1.0)
    assert_no_gap(out)
    assert_quaternions_right(out, others(3))
    assert {packet.quaternion_of(3) for packet in out} == {(0, 0, 0, 0)}
    assert {packet.calibration_of(3) for packet in out} == {0}
    assert out[-1].errors_of(3) > 0

    calibrated.simulated.command('plug', 3)
    assert calibrated.until(lambda data: data.state_of(3) is State.RUN) < 0.85
    back = calibrated.watch(1.0)
    assert_no_gap(back)
    assert_quaternions_right(back)
    assert back[-1].errors_of(3) == 0
    assert_brought_back(calibrated, 3)
    stats = calibrated.client.stats()
    assert stats.comebacks == (0, 0, 0, 1, 0, 0, 0, 0)
    assert [channel for channel in range(8) if stats.errors[channel]] == [3]
    assert stats.late == 0
    assert calibrated.client.read_offsets(4) == offsets_of(3)


@pytest.mark.parametrize(('glitches', 'lost'), [(1, 0), (2, 1), (3, 1)])
def test_glitches_cost_no_more_than_a_sample(calibrated, glitches, lost):
    """A read that failed is tried again at once, and one sweep without an answer is no unplugging."""
    calibrated.watch(0.1)
    calibrated.simulated.command('glitch', 4, glitches)
    data = calibrated.watch(0.5)
    assert sum(packet.quaternion_of(4) == (0, 0, 0, 0) for packet in data) == lost
    assert {packet.state_of(4) for packet in data} == {State.RUN}
    assert_quaternions_right(data, others(4))
    stats = calibrated.client.stats()
    assert stats.errors[4] == glitches == data[-1].errors_of(4)
    assert stats.comebacks == (0,) * 8


def test_a_chip_that_is_plugged_in_late_is_no_comeback(bench):
    bench.simulated.command('unplug', 2)
    bench.boot()
    bench.start()
    assert bench.watch(0.1)[-1].state_of(2) is State.ABSENT
    bench.simulated.command('plug', 2)
    bench.until(lambda data: data.state_of(2) is State.RUN)
    stats = bench.client.stats()
    assert stats.comebacks == (0,) * 8
    assert stats.errors == (0,) * 8


def test_unplugging_and_replugging_the_multiplexer(calibrated):
    calibrated.simulated.command('unplug', 'multiplexer')
    calibrated.until(lambda data: all(data.state_of(channel) is State.ABSENT for channel in range(8)))
    assert_no_gap(calibrated.watch(0.5))
    calibrated.simulated.command('plug', 'multiplexer')
    # The chips kept their power: they need not boot.
    assert (
        calibrated.until(lambda data: all(data.state_of(channel) is State.RUN for channel in range(8))) < 0.15
    )
    assert_quaternions_right(calibrated.watch(0.5))
    for channel in range(8):
        assert_brought_back(calibrated, channel)
    assert calibrated.client.stats().comebacks == (1,) * 8


def test_a_power_blip_of_one_chip(calibrated):
    calibrated.simulated.command('blip', 5)
    calibrated.until(lambda data: data.state_of(5) is State.ABSENT)
    calibrated.until(lambda data: data.state_of(5) is State.RUN)
    assert_brought_back(calibrated, 5)
    assert_quaternions_right(calibrated.watch(0.3))


def test_a_blip_between_two_sweeps_is_noticed_by_the_zero_quaternion(calibrated):
    """At one sweep a second a chip has booted again, into CONFIG, before anybody could miss it."""
    calibrated.start(rate_hz=1)
    calibrated.watch(1.5)
    calibrated.simulated.command('blip', 5)
    calibrated.until(lambda data: data.state_of(5) is not State.RUN, patience_s=2.5)
    calibrated.until(lambda data: data.state_of(5) is State.RUN, patience_s=2.5)
    assert_brought_back(calibrated, 5)
    assert calibrated.client.stats().comebacks[5] == 1


def test_a_power_blip_of_everything_is_a_reset(calibrated):
    calibrated.simulated.command('power')
    calibrated.packets.clear()
    calibrated.wait(0.7)
    assert calibrated.packets == []
    assert calibrated.client.hello().uptime_ms < 1000
    calibrated.start()
    assert calibrated.simulated.registers(0, OFFSETS, 22) == bytes(22)  # the PC's to write again


def test_a_held_line_is_freed_by_clock_pulses(calibrated):
    before = calibrated.watch(0.2)[-1]
    calibrated.simulated.command('hold', 'trunk', 'sda', 5)
    data = calibrated.watch(1.0)
    assert_no_gap(data)
    assert data[0].sweep.seq - before.sweep.seq == 1
    assert {packet.state_of(channel) for packet in data for channel in range(8)} == {State.RUN}
    assert calibrated.client.stats().bus_recoveries == 1
    assert calibrated.simulated.stats()['clock_pulses'] >= 5
    assert calibrated.simulated.stats()['boots'] == 8


@pytest.mark.parametrize('line', ['sda', 'scl'])
def test_a_bus_that_stays_stuck_stops_nothing_but_the_measurements(calibrated, line):
    calibrated.simulated.command('hold', 'trunk', line)
    # Seen on the lines, not by eight timeouts of 5 ms in each sweep.
    assert (
        calibrated.until(lambda data: all(data.state_of(channel) is State.ABSENT for channel in range(8)))
        < 0.05
    )
    stuck = calibrated.watch(1.0)
    assert len(stuck) == pytest.approx(100, abs=1)
    assert {packet.quaternion_of(channel) for packet in stuck for channel in range(8)} == {(0, 0, 0, 0)}
    assert stuck[-1].errors_of(0) > 2
    assert calibrated.client.hello().channels == 0
    assert calibrated.client.stats().bus_recoveries > 0

    calibrated.simulated.command('release', 'trunk')
    assert (
        calibrated.until(lambda data: all(data.state_of(channel) is State.RUN for channel in range(8))) < 0.5
    )
    assert_quaternions_right(calibrated.watch(0.5))
    for channel in range(8):
        assert_brought_back(calibrated, channel)


@pytest.mark.parametrize('line', ['sda', 'scl'])
def test_one_chip_that_holds_a_line_for_ever_costs_only_itself(calibrated, line):
    """RST of the multiplexer takes it off the bus."""
    calibrated.simulated.command('hold', 2, line)
    calibrated.until(lambda data: data.state_of(2) is State.ABSENT)
    data = calibrated.watch(2.0)
    assert len(data) == pytest.approx(200, abs=2)
    right = [packet for packet in data if all(packet.state_of(channel) is State.RUN for channel in others(2))]
    assert len(right) == len(data)
    measured = [packet for packet in data if all(any(packet.quaternion_of(channel)) for channel in others(2))]
    assert len(measured) >= 0.95 * len(data)
    assert_quaternions_right(measured, others(2))
    assert calibrated.simulated.stats()['multiplexer_resets'] > 0

    calibrated.simulated.command('release', 2)
    calibrated.until(lambda data: data.state_of(2) is State.RUN)
    assert_brought_back(calibrated, 2)


@pytest.mark.parametrize('stretch_us', [100, 300])
def test_chips_that_stretch_the_clock(streaming, stretch_us):
    for channel in range(8):
        streaming.simulated.command('stretch', channel, stretch_us)
    streaming.watch(0.1)
    data = streaming.watch(2.0)
    assert len(data) == pytest.approx(200, abs=1)
    assert_no_gap(data)
    assert_quaternions_right(data)
    assert streaming.client.stats().errors == (0,) * 8


def test_chips_that_stretch_so_long_that_the_rate_falls(streaming):
    for channel in range(8):
        streaming.simulated.command('stretch', channel, 4000)
    streaming.watch(0.5)
    data = streaming.watch(2.0)
    assert 40 < len(data) < 60
    assert_no_gap(data)
    assert {packet.state_of(channel) for packet in data for channel in range(8)} == {State.RUN}


def test_a_chip_that_stretches_beyond_the_timeout_costs_only_itself(calibrated):
    calibrated.simulated.command('stretch', 6, 50000)
    calibrated.until(lambda data: data.state_of(6) is State.ABSENT)
    recoveries = calibrated.client.stats().bus_recoveries
    data = calibrated.watch(2.0)
    assert len(data) == pytest.approx(200, abs=2)
    assert (
        calibrated.client.stats().bus_recoveries - recoveries <= 9
    )  # it is looked for less often than an absent one
    assert_quaternions_right(data, others(6))
    calibrated.simulated.command('stretch', 6, 0)
    calibrated.until(lambda data: data.state_of(6) is State.RUN)
    assert_brought_back(calibrated, 6)


def test_a_reset_chip_comes_back_with_all_it_had(calibrated):
    calibrated.start(mode=FusionMode.NDOF_FMC_OFF)
    calibrated.client.reset_imu(8)
    calibrated.until(lambda data: data.state_of(7) is State.ABSENT)
    assert calibrated.until(lambda data: data.state_of(7) is State.RUN) < 0.85
    assert_brought_back(calibrated, 7, FusionMode.NDOF_FMC_OFF)
    assert calibrated.simulated.stats()['boots'] == 9


def test_what_an_earlier_firmware_told_a_chip_is_overwritten(streaming):
    """A reset of the board leaves the chips as they are: here in fusion, with other axes and old offsets."""
    streaming.client.write_offsets(1, offsets_of(7))
    for register, value in ((0x41, 0x21), (0x42, 0x05)):
        streaming.simulated.command('poke', 0, register, value)
    streaming.simulated.command('reset')
    streaming.client.hello()
    streaming.client.write_offsets(1, offsets_of(0))
    streaming.start(mode=FusionMode.IMU)
    assert_brought_back(streaming, 0, FusionMode.IMU)


def test_all_chips_pulled_and_put_back_one_after_another(calibrated):
    for channel in range(8):
        calibrated.simulated.command('unplug', channel)
        calibrated.wait(0.05)
    for channel in range(8):
        calibrated.simulated.command('plug', channel)
        calibrated.wait(0.05)
    calibrated.until(lambda data: all(data.state_of(channel) is State.RUN for channel in range(8)))
    for channel in range(8):
        assert_brought_back(calibrated, channel)
    assert calibrated.client.stats().comebacks == (1,) * 8


def test_the_pattern_of_the_simulated_chips_is_one_that_shows_a_mix_up():
    """Else the tests above would prove nothing: eight chips at one moment, and one chip at two, never look alike."""
    shown = [pattern(Reading(channel, tick)) for channel in range(8) for tick in range(500)]
    assert len(set(shown)) == len(shown)
