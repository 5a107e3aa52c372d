"""What streams: every quaternion right, at every rate, on every subset, in every mode."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulated_board import CHANNELS, Reading, pattern, tick_at

from bench import CLOCK_SLACK_US, assert_no_gap, assert_quaternions_right
from sesa2.link.packets import State
from sesa2.link.requests import BoardConfiguration, FusionMode, Stream


def test_ten_seconds_of_eight_imus_at_100_hz(streaming):
    data = streaming.watch(10.0)
    assert len(data) in (1000, 1001)
    assert_no_gap(data)
    assert_quaternions_right(data)
    periods = [after.sweep.t_us - before.sweep.t_us for before, after in pairwise(data)]
    assert max(abs(period - 10000) for period in periods) < 1000
    stats = streaming.client.stats()
    assert (stats.late, stats.tx_dropped, stats.bus_recoveries) == (0, 0, 0)
    assert stats.errors == (0,) * 8
    assert streaming.client.malformed == 0
    assert streaming.client.decoder.errors.total == 0


def test_a_sweep_takes_at_most_5_ms_with_one_imus_scores(streaming):
    streaming.watch(1.0)
    before = streaming.simulated.stats()
    data = streaming.watch(1.0)
    longest_us = max(packet.sweep.scan_us for packet in data)
    assert longest_us < 5000
    assert longest_us <= streaming.client.stats().max_scan_us < 5000
    # Eight selections of a channel, and nine reads of two transfers each: eight quaternions and one IMU's scores.
    transfers = streaming.simulated.stats()['transfers'] - before['transfers']
    assert transfers == pytest.approx(26 * len(data), abs=26)


def test_a_raw_sweep_takes_at_most_6_ms_with_the_magnetic_field(streaming):
    streaming.start(mode=FusionMode.RAW)
    streaming.client.stream(Stream.RAW | Stream.MAGNETOMETER)
    streaming.wait(0.1)
    streaming.packets.clear()
    streaming.wait(1.0)
    sweeps = [packet.sweep for packet in streaming.raw()]
    assert len(sweeps) == pytest.approx(100, abs=1)
    assert_no_gap(streaming.raw())
    assert max(sweep.scan_us for sweep in sweeps) <= 6000
    assert streaming.client.stats().tx_dropped == 0


def test_raw_sensors_measure_the_motion_that_is_played(bench):
    """Gravity and the earth's field as the chip lies at the time, and the rate at which it turns."""
    bench.boot()
    bench.simulated.set_pattern()
    bench.start(mode=FusionMode.RAW)
    bench.client.stream(Stream.RAW | Stream.MAGNETOMETER)
    bench.wait(0.1)
    bench.packets.clear()
    bench.wait(1.0)
    packets = bench.packets[not bench.packets[0].line_bytes > 100 :]
    assert len(packets) > 150
    for raw, fields in zip(packets[::2], packets[1::2], strict=False):
        assert raw.sweep == fields.sweep
        for channel, read_ns in zip(CHANNELS, raw.sweep.read_ns(), strict=True):
            read_us = raw.sweep.t_us + read_ns / 1000
            turn = 2 * np.pi / 9.97
            np.testing.assert_allclose(
                raw.angular_velocities[channel], turn * np.eye(3)[channel % 3], atol=0.0006
            )
            ticks = {tick_at(channel, read_us + slack) for slack in (-CLOCK_SLACK_US, 0, CLOCK_SLACK_US)}
            assert any(
                np.allclose(raw.accelerations[channel], into.apply([0, 0, 9.81]), rtol=0, atol=0.006)
                and np.allclose(fields.fields[channel], into.apply([0, 20e-6, -45e-6]), rtol=0, atol=4e-8)
                for into in map(into_sensor, [channel] * len(ticks), ticks)
            )


def into_sensor(channel, tick):
    w, x, y, z = pattern(Reading(channel, tick))
    return Rotation.from_quat([x, y, z, w]).inv()


@pytest.mark.parametrize('rate_hz', [1, 30, 50])
def test_slower_rates(bench, rate_hz):
    bench.boot()
    bench.simulated.set_pattern()
    bench.start(rate_hz=rate_hz)
    data = bench.watch(3.0)
    assert len(data) == pytest.approx(3 * rate_hz, abs=1)
    assert_no_gap(data)
    assert_quaternions_right(data)


@pytest.mark.parametrize('mask', [0b00000001, 0b10000000, 0b10101010, 0b01111111])
def test_any_subset_of_the_imus(bench, mask):
    bench.boot()
    bench.simulated.set_pattern()
    bench.start(mask=mask)
    data = bench.watch(0.5)
    channels = [channel for channel in range(8) if mask >> channel & 1]
    assert {packet.sweep.mask for packet in data} == {mask}
    assert_quaternions_right(data, channels)
    modes = [bench.simulated.mode(channel) for channel in range(8)]
    assert modes == [FusionMode.NDOF if channel in channels else 0 for channel in range(8)]


def test_at_100_khz_the_bus_sets_the_rate(bench):
    bench.boot()
    bench.simulated.set_pattern()
    bench.start(i2c_100khz=1)
    data = bench.watch(2.0)
    assert 130 < len(data) < 180
    assert_no_gap(data)
    assert_quaternions_right(data)
    assert bench.client.stats().late > 100
    bench.start(rate_hz=50, i2c_100khz=1)
    assert len(bench.watch(2.0)) == pytest.approx(100, abs=1)


@pytest.mark.parametrize('mode', FusionMode)
def test_modes(bench, mode):
    bench.boot()
    bench.start(mode=mode)
    assert [bench.simulated.mode(channel) for channel in range(8)] == [mode] * 8


def test_a_change_of_mode_goes_through_config_and_loses_no_chip(streaming):
    data = []
    for mode in (FusionMode.IMU, FusionMode.NDOF_FMC_OFF, FusionMode.NDOF):
        streaming.start(mode=mode)
        assert [streaming.simulated.mode(channel) for channel in range(8)] == [mode] * 8
        data += streaming.watch(0.1)
    assert State.ABSENT not in {packet.state_of(channel) for packet in data for channel in range(8)}
    assert streaming.client.stats().comebacks == (0,) * 8


def test_a_configuration_amid_a_change_of_mode_waits_for_its_end(streaming):
    for pause_s in (0.0, 0.01, 0.02, 0.03):
        for mode in (FusionMode.IMU, FusionMode.NDOF_FMC_OFF):
            streaming.client.configure(BoardConfiguration(0xFF, 100, mode, 0))
            streaming.wait(pause_s)
    streaming.until(lambda data: all(data.state_of(channel) is State.RUN for channel in range(8)))
    assert [streaming.simulated.mode(channel) for channel in range(8)] == [FusionMode.NDOF_FMC_OFF] * 8


def test_a_configuration_without_imus_pauses_the_board(streaming):
    streaming.client.configure(BoardConfiguration(0, 100, FusionMode.NDOF, 0))
    assert streaming.watch(0.5) == []
    streaming.simulated.command('unplug', 0)
    streaming.client.configure(BoardConfiguration(0x81, 100, FusionMode.NDOF, 0))
    streaming.until(lambda data: data.state_of(0) is State.ABSENT and data.state_of(7) is State.RUN)


def test_configuring_the_same_again_disturbs_nothing(streaming):
    streaming.packets.clear()
    streaming.start()
    data = streaming.watch(0.3)
    assert {packet.state_of(channel) for packet in data for channel in range(8)} == {State.RUN}
    assert streaming.simulated.stats()['boots'] == 8


def test_a_chip_in_transition_sends_zero_quaternions(bench):
    bench.boot()
    for channel in range(8):
        bench.simulated.set_quaternion(channel, (0, 16384, 0, 0))
    bench.start()
    bench.watch(0.05)
    bench.client.read_offsets(4)
    seen = {(packet.state_of(3), packet.quaternion_of(3)) for packet in bench.data()}
    assert seen >= {(State.RUN, (0, 16384, 0, 0)), (State.TO_CONFIG, (0, 0, 0, 0))}
    assert all(quaternion == (0, 0, 0, 0) for state, quaternion in seen if state is not State.RUN)


def test_scores_come_from_one_imu_per_sweep_in_turn(streaming):
    for channel in range(8):
        streaming.simulated.command('calibration', channel, 0xC0 | channel)
    streaming.packets.clear()
    streaming.wait(0.1)
    last = streaming.data()[-1]
    assert [last.calibration_of(channel) for channel in range(8)] == [0xC0 | channel for channel in range(8)]
    changes = [
        sum(before.calibration_of(k) != after.calibration_of(k) for k in range(8))
        for before, after in pairwise(streaming.data())
    ]
    assert max(changes) == 1


def test_an_uncalibrated_chip_is_not_an_unplugged_one(streaming):
    for channel in range(8):
        streaming.simulated.command('calibration', channel, 0)
    data = streaming.watch(3.0)
    assert {packet.state_of(channel) for packet in data for channel in range(8)} == {State.RUN}
    assert streaming.simulated.stats()['boots'] == 8


def test_acceleration_beside_the_quaternions(bench):
    bench.simulated.command('unplug', 6)
    bench.boot()
    bench.simulated.set_pattern()
    for channel in range(8):
        bench.simulated.set_acceleration(channel, (channel, -981, 32767))
    bench.start(flags=Stream.QUATERNIONS | Stream.ACCELERATION)
    data = bench.watch(1.0)
    accelerations = [packet for packet in bench.accelerations() if packet.sweep.seq >= data[0].sweep.seq]
    assert_no_gap(data)
    assert_quaternions_right(data, [0, 1, 2, 3, 4, 5, 7])
    assert [packet.sweep for packet in accelerations] == [packet.sweep for packet in data][
        : len(accelerations)
    ]
    assert len(accelerations) == pytest.approx(100, abs=1)
    for packet in accelerations:
        for channel, measured in enumerate(packet.accelerations):
            assert measured == pytest.approx(
                [float('nan')] * 3 if channel == 6 else [channel * 0.01, -9.81, 327.67], nan_ok=True
            )
    stats = bench.client.stats()
    assert (stats.late, stats.tx_dropped) == (0, 0)


def test_acceleration_alone_and_silence(streaming):
    streaming.client.stream(Stream.ACCELERATION)
    streaming.packets.clear()
    streaming.wait(0.5)
    assert streaming.data() == []
    assert len(streaming.accelerations()) == pytest.approx(50, abs=1)
    streaming.client.stream(Stream.STOP)
    streaming.packets.clear()
    streaming.wait(0.5)
    assert streaming.packets == []


def test_115200_baud_carries_the_stream(new_bench, build_variant):
    bench = new_bench(elf=build_variant('baud_115200', 'BAUD=115200').elf)
    bench.boot()
    bench.simulated.set_pattern()
    bench.start()
    data = bench.watch(1.0)
    assert len(data) == pytest.approx(100, abs=1)
    assert_no_gap(data)
    assert_quaternions_right(data)
    assert bench.client.stats().tx_dropped == 0
    bench.client.stream(Stream.QUATERNIONS | Stream.ACCELERATION)
    bench.wait(1.0)
    assert bench.client.stats().tx_dropped > 0  # 158 bytes a sweep are more than that line carries
