"""What firmware/PROTOCOL.md promises, asked of the real firmware in its simulator and of the package's virtual board.

The same client on both, in time that the test moves. A difference between the two is a bug in one of them.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from virtual_world import VirtualWorld

from bench import Bench, assert_no_gap
from sesa2.link import board_client as link_board
from sesa2.link.framing import FrameDecoder, encode_frame
from sesa2.link.link_errors import CommandError
from sesa2.link.packets import VERSION, Acceleration, Data, MagneticFields, RawData, State
from sesa2.link.requests import (
    FIRMWARE,
    BoardConfiguration,
    Command,
    FusionMode,
    Request,
    Result,
    Stream,
    decode_reply,
)
from sesa2.sensing.imu.bno055.offsets import Offsets

OFFSETS = [Offsets((k, -2, 300), (-400, 500, k), (0, 1, -1), 1000 + k, 480) for k in range(9)]
NDOF = FusionMode.NDOF
POWER_ON, EXTERNAL_RESET = 0x01, 0x02


@pytest.fixture(params=['virtual', 'firmware'])
def bench(request, monkeypatch):
    """A board whose eight chips have just been given power; each shows a quaternion of its own."""
    if request.param == 'firmware':
        bench = request.getfixturevalue('new_bench')()
    else:
        world = VirtualWorld()
        monkeypatch.setattr(link_board, 'time', world.clock())
        bench = Bench(world)
    for channel in range(8):
        bench.simulated.set_quaternion(channel, quaternion_of(channel))
        bench.simulated.set_acceleration(channel, (0, 0, 981))
    return bench


@pytest.fixture
def booted(bench):
    """The same, once its chips have booted."""
    bench.boot()
    return bench


@pytest.fixture
def streaming(booted):
    """The same, streaming all chips at 100 Hz."""
    booted.start()
    return booted


def quaternion_of(channel):
    return 8192, -8192 + channel, 8192 + channel, 8192 - channel


def bodies(bench, *frames, seconds=0.1):
    """What the board sends when it is sent frames, but for what it streams."""
    received = bench.simulated.run(seconds, b'\x00' + b''.join(frames))
    return [body for body in FrameDecoder().feed(received) if body[0] & 0x80]


def ask(bench, *requests):
    """Tokens and results of the replies to requests sent at once, in the order of the replies."""
    frames = (encode_frame(request.encode()) for request in requests)
    return [(reply.token, reply.result) for reply in map(decode_reply, bodies(bench, *frames))]


def states_of(bench, channel):
    """States that a channel went through in the packets so far."""
    states = [data.state_of(channel) for data in bench.data()]
    return [state for k, state in enumerate(states) if not k or state is not states[k - 1]]


# Handshake


def test_hello_before_and_after_the_chips_have_booted(bench):
    hello = bench.client.hello()
    assert (hello.firmware_major, hello.firmware_minor) == FIRMWARE
    assert hello.channels == 0
    bench.simulated.command('unplug', 3)
    bench.boot()
    hello = bench.client.hello()
    assert hello.channels == 0b11110111
    assert hello.uptime_ms == pytest.approx(bench.simulated.now_us / 1000, abs=5)


def test_nothing_is_said_unasked(bench):
    assert bench.simulated.run(1.5) == b''


def test_versions(booted):
    assert ask(booted, Request(Command.HELLO, 9, b'something', VERSION + 1)) == [(9, Result.OK)]
    others = [Request(c, c.value, b'', VERSION + 1) for c in Command if c is not Command.HELLO]
    refused = [(request.token, Result.BAD_ARGUMENT) for request in others]
    assert [reply for request in others for reply in ask(booted, request)] == refused


@pytest.mark.parametrize('arguments', [b'', b'\x01\x02'])
def test_an_unknown_command_is_refused(booted, arguments):
    assert bodies(booted, encode_frame(Request(99, 7, arguments).encode())) == [
        bytes((0x80 | 99, VERSION, 7, Result.BAD_ARGUMENT))
    ]
    assert booted.client.stats().rx_bad == 0


def test_what_is_no_command_is_dropped_and_counted(booted):
    damaged = bytearray(encode_frame(Request(Command.STATS, 1).encode()))
    damaged[2] ^= 4
    too_short = encode_frame(Request(Command.CONFIGURE, 2, b'\xff').encode())
    too_long = encode_frame(Request(Command.STATS, 3, b'\xff').encode())
    assert bodies(booted, bytes(damaged), too_short, too_long, encode_frame(b'\x0a\x01')) == []
    assert booted.client.stats().rx_bad == 4


@pytest.mark.parametrize(
    'request_',
    [
        Request(Command.CONFIGURE, 1, bytes((0xFF, 0, NDOF, 0))),
        Request(Command.CONFIGURE, 1, bytes((0xFF, 101, NDOF, 0))),
        Request(Command.CONFIGURE, 1, bytes((0xFF, 100, 0x00, 0))),
        Request(Command.CONFIGURE, 1, bytes((0xFF, 100, 0x05, 0))),
        Request(Command.CONFIGURE, 1, bytes((0xFF, 100, 0x09, 0))),
        Request(Command.CONFIGURE, 1, bytes((0xFF, 100, NDOF, 2))),
        Request(Command.STREAM, 1, b'\x10'),
        Request(Command.STREAM, 1, b'\xff'),
        Request(Command.READ_OFFSETS, 1, b'\x08'),
        Request(Command.WRITE_OFFSETS, 1, b'\xff' + bytes(22)),
        Request(Command.RESET_IMU, 1, b'\x08'),
    ],
    ids=lambda request: f'{request.command.name} {request.arguments[:4].hex()}',
)
def test_bad_arguments_are_refused_and_change_nothing(booted, request_):
    booted.start(mask=0x0F, rate_hz=50)
    assert ask(booted, request_) == [(1, Result.BAD_ARGUMENT)]
    data = booted.watch(0.5)
    assert {packet.sweep.mask for packet in data} == {0x0F}
    assert len(data) == pytest.approx(25, abs=1)
    assert all(packet.state_of(channel) is State.RUN for packet in data for channel in range(4))


# Configuration and stream


@pytest.mark.parametrize(
    ('mask', 'rate_hz', 'i2c_100khz'), [(0xFF, 100, 0), (0x01, 100, 0), (0xAA, 20, 0), (0x81, 50, 1)]
)
def test_sweeps_of_any_mask_and_rate(booted, mask, rate_hz, i2c_100khz):
    booted.start(mask, rate_hz, i2c_100khz=i2c_100khz)
    data = booted.watch(1.0)
    assert len(data) == pytest.approx(rate_hz, abs=1)
    assert_no_gap(data)
    assert {packet.sweep.mask for packet in data} == {mask}
    steps_us = np.diff([packet.sweep.t_us for packet in data])
    np.testing.assert_allclose(steps_us, 1e6 / rate_hz, atol=1000)
    for packet in data:
        assert 0 < packet.sweep.scan_us < 1e6 / rate_hz
        for imu_id in packet.sweep.ids:
            assert packet.quaternion_of(imu_id - 1) == quaternion_of(imu_id - 1)
    stats = booted.client.stats()
    assert stats.max_scan_us >= max(packet.sweep.scan_us for packet in data)
    assert (stats.late, stats.tx_dropped, stats.rx_bad, stats.bus_recoveries) == (0, 0, 0, 0)


def test_more_than_the_bus_can_do_is_late(booted):
    booted.start(i2c_100khz=1)
    before = booted.client.stats()
    data = booted.watch(1.0)
    assert 70 <= len(data) <= 90
    assert_no_gap(data)
    assert booted.client.stats().late - before.late > 50


def test_a_sweep_is_data_then_acceleration(booted):
    booted.simulated.command('unplug', 2)
    booted.start(flags=Stream.QUATERNIONS | Stream.ACCELERATION)
    for channel in range(8):  # gravity in the chip's own axes, as this orientation has it
        booted.simulated.set_quaternion(channel, (16384, 0, 0, 0))
    booted.wait(0.3)
    booted.packets.clear()
    booted.wait(0.5)
    packets = booted.packets if isinstance(booted.packets[0], Data) else booted.packets[1:]
    packets = packets[: len(packets) // 2 * 2]
    assert [type(packet) for packet in packets] == [Data, Acceleration] * (len(packets) // 2)
    for data, acceleration in zip(packets[::2], packets[1::2], strict=True):
        assert data.sweep == acceleration.sweep
        expected = np.tile([0.0, 0.0, 9.81], (8, 1))
        expected[2] = np.nan
        np.testing.assert_allclose(acceleration.accelerations, expected, atol=0.006)


def test_acceleration_alone(booted):
    booted.start(flags=Stream.ACCELERATION)
    booted.wait(0.5)
    assert {type(packet) for packet in booted.packets} == {Acceleration}
    seqs = [packet.sweep.seq for packet in booted.packets]
    assert seqs == list(range(seqs[0], seqs[0] + len(seqs)))


# The raw sensors

ALL = Stream.QUATERNIONS | Stream.ACCELERATION | Stream.RAW | Stream.MAGNETOMETER
RAW_STREAM = Stream.RAW | Stream.MAGNETOMETER


def in_sensor(channel, vector):
    """A vector of the earth frame in the axes of a chip that `lay_out` has turned, by another library's rotations."""
    return turned(channel).inv().apply(vector)


def turned(channel):
    return Rotation.from_euler('xyz', [25.0 + 40.0 * channel, -35.0 + 9.0 * channel, 70.0], degrees=True)


def lay_out(bench, degrees_per_s=0.0):
    """Turn each chip its own way; show it gravity and the earth's field, and turn it about the vertical."""
    velocities = []
    for channel in range(8):
        x, y, z, w = np.rint(16384 * turned(channel).as_quat()).astype(int)
        bench.simulated.set_quaternion(channel, (w, x, y, z))
        up = in_sensor(channel, [0.0, 0.0, 1.0])
        bench.simulated.set_acceleration(channel, np.rint(980.665 * up).astype(int))
        field = in_sensor(channel, [0.0, 320.0, -720.0])
        bench.simulated.set_magnetometer(channel, np.rint(field).astype(int))
        velocities.append(np.deg2rad(degrees_per_s) * up)
        bench.simulated.set_gyroscope(channel, 16 * degrees_per_s * up)
    return np.array(velocities)


def packets_of(bench, seconds):
    bench.packets.clear()
    bench.wait(seconds)
    return bench.packets


def test_raw_sweeps(booted):
    """Each axis is that of the chip, in SI units; a turn about the vertical leaves gravity where it is."""
    booted.simulated.command('unplug', 2)
    booted.start(mode=FusionMode.RAW, flags=Stream.QUATERNIONS)
    velocities = lay_out(booted, degrees_per_s=50.0)
    booted.client.stream(Stream.RAW)
    booted.wait(0.3)
    packets = packets_of(booted, 1.0)
    assert {type(packet) for packet in packets} == {RawData}
    assert len(packets) == pytest.approx(100, abs=1)
    assert_no_gap(packets)
    expected = 9.80665 * np.array([in_sensor(channel, [0.0, 0.0, 1.0]) for channel in range(8)])
    velocities[2] = expected[2] = np.nan
    for packet in packets:
        np.testing.assert_allclose(packet.angular_velocities, velocities, rtol=0, atol=0.0007)
        np.testing.assert_allclose(packet.accelerations, expected, rtol=0, atol=0.006)
        assert packet.states == [State.RUN] * 2 + [State.ABSENT] + [State.RUN] * 5
        assert packet.errors == [0] * 8
        assert packet.sweep.scan_us <= 6000
    stats = booted.client.stats()
    assert (stats.late, stats.tx_dropped, stats.comebacks) == (0, 0, (0,) * 8)


def test_magnetic_fields_beside_the_raw_sweeps(booted):
    booted.simulated.command('unplug', 5)
    booted.start(mode=FusionMode.RAW, flags=Stream.QUATERNIONS)
    lay_out(booted)
    booted.client.stream(RAW_STREAM)
    booted.wait(0.3)
    packets = packets_of(booted, 0.5)
    packets = packets[not isinstance(packets[0], RawData) :]
    packets = packets[: len(packets) // 2 * 2]
    assert [type(packet) for packet in packets] == [RawData, MagneticFields] * (len(packets) // 2)
    expected = np.array([in_sensor(channel, [0.0, 20e-6, -45e-6]) for channel in range(8)])
    expected[5] = np.nan
    for raw, fields in zip(packets[::2], packets[1::2], strict=True):
        assert raw.sweep == fields.sweep
        np.testing.assert_allclose(fields.fields, expected, rtol=0, atol=0.04e-6)


@pytest.mark.parametrize('mode', FusionMode)
def test_what_each_mode_measures(booted, mode):
    """The rest is sent as not measured."""
    booted.start(mask=0x03, mode=mode)
    for channel in range(8):
        booted.simulated.command('calibration', channel, 0xFF)
    booted.client.stream(ALL)
    booted.wait(0.1)
    latest = {type(packet): packet for packet in packets_of(booted, 0.2)}
    raw = mode is FusionMode.RAW
    assert np.isfinite(latest[RawData].angular_velocities).all() == raw
    assert np.isfinite(latest[RawData].accelerations).all()
    assert np.isfinite(latest[MagneticFields].fields).all() == raw
    assert np.isfinite(latest[Acceleration].accelerations).all()
    assert latest[Data].orientations.any() != raw
    assert list(latest[Data].calib) == [0 if raw else 0xFF] * 2
    assert latest[Data].states == latest[RawData].states == [State.RUN] * 2
    booted.client.stream(Stream.RAW)
    last = packets_of(booted, 0.2)[-1]
    assert np.isfinite(last.accelerations).all() == np.isfinite(last.accelerations).any() == raw


def test_from_fusion_to_raw_and_back(streaming):
    for mode in (FusionMode.RAW, NDOF):
        streaming.packets.clear()
        streaming.client.configure(BoardConfiguration(0xFF, 100, mode, 0))
        streaming.wait(0.2)
        assert states_of(streaming, 4)[-3:] == [State.TO_CONFIG, State.TO_NDOF, State.RUN]
        assert any(streaming.data()[-1].quaternion_of(4)) == (mode is NDOF)
    assert streaming.client.stats().comebacks == (0,) * 8


def test_a_raw_chip_goes_and_comes_back(booted):
    booted.start(mode=FusionMode.RAW)
    booted.client.stream(Stream.RAW | Stream.QUATERNIONS)
    come_and_go(booted, 3)
    last = [packet for packet in packets_of(booted, 0.1) if isinstance(packet, RawData)][-1]
    assert np.isfinite(last.accelerations).all()
    assert booted.client.stats().comebacks == (0, 0, 0, 1, 0, 0, 0, 0)


def test_stop_and_go_on(streaming):
    """Sweeps go on, and are counted, while nothing is streamed."""
    last = streaming.data()[-1].sweep.seq if streaming.data() else streaming.watch(0.05)[-1].sweep.seq
    streaming.client.stream(Stream.STOP)
    before = streaming.client.stats().sweeps
    streaming.packets.clear()
    streaming.wait(0.5)
    assert streaming.packets == []
    assert streaming.client.stats().sweeps - before == pytest.approx(50, abs=2)
    streaming.client.stream(Stream.QUATERNIONS)
    data = streaming.watch(0.1)
    assert data[0].sweep.seq - last == pytest.approx(51, abs=5)
    assert all(packet.state_of(0) is State.RUN for packet in data)


def test_a_stream_before_there_are_sweeps_begins_with_them(booted):
    booted.client.stream(Stream.QUATERNIONS)
    booted.wait(0.1)
    assert booted.packets == []
    assert booted.client.stats().sweeps == 0
    booted.client.configure(BoardConfiguration(0x03, 100, NDOF, 0))
    booted.until(lambda data: data.state_of(1) is State.RUN)


def test_no_channels_is_no_sweep(streaming):
    streaming.client.configure(BoardConfiguration(0, 100, NDOF, 0))
    streaming.packets.clear()
    streaming.wait(0.1)
    assert streaming.packets == []
    streaming.client.configure(BoardConfiguration(0x01, 100, NDOF, 0))
    streaming.until(lambda data: data.state_of(0) is State.RUN)


def test_another_mode_takes_the_chips_through_config(streaming):
    streaming.packets.clear()
    streaming.client.configure(BoardConfiguration(0xFF, 100, FusionMode.IMU, 0))
    streaming.wait(0.2)
    states = states_of(streaming, 4)
    assert states[-3:] == [State.TO_CONFIG, State.TO_NDOF, State.RUN]
    assert streaming.client.stats().comebacks == (0,) * 8


def test_the_same_configuration_again_disturbs_nothing(streaming):
    streaming.client.configure(BoardConfiguration(0xFF, 100, NDOF, 0))
    data = streaming.watch(0.2)
    assert {packet.state_of(channel) for packet in data for channel in range(8)} == {State.RUN}


def test_scores_are_refreshed_one_a_sweep(streaming):
    scores = [0b11_10_01_00, *range(1, 8)]
    for channel, register in enumerate(scores):
        streaming.simulated.command('calibration', channel, register)
    streaming.watch(0.02)
    data = streaming.watch(0.2)
    assert [data[-1].calibration_of(channel) for channel in range(8)] == scores
    for channel in range(8):
        streaming.simulated.command('calibration', channel, 0xFF)
    data = streaming.watch(0.2)
    refreshed = [sum(packet.calibration_of(channel) == 0xFF for channel in range(8)) for packet in data]
    first = refreshed.index(1)
    assert refreshed[first : first + 8] == list(range(1, 9))
    streaming.simulated.command('unplug', 5)
    assert streaming.watch(0.1)[-1].calibration_of(5) == 0


# Offsets


def test_offsets_given_before_the_chips_are_in_use_are_kept_for_them(booted):
    for imu_id in range(1, 9):
        assert not booted.client.write_offsets(imu_id, OFFSETS[imu_id])
    booted.start()
    assert [booted.client.read_offsets(imu_id) for imu_id in range(1, 9)] == OFFSETS[1:]


def test_offsets_are_written_and_read_back_while_the_others_stream(streaming):
    streaming.packets.clear()
    assert streaming.client.write_offsets(3, OFFSETS[3])
    assert streaming.client.read_offsets(3) == OFFSETS[3]
    streaming.wait(0.1)
    assert states_of(streaming, 2)[-3:] == [State.TO_CONFIG, State.TO_NDOF, State.RUN]
    data = streaming.data()
    assert_no_gap(data)
    for packet in data:
        assert all(packet.state_of(channel) is State.RUN for channel in (0, 1, 3, 4, 5, 6, 7))
        measured = packet.state_of(2) is State.RUN
        assert packet.quaternion_of(2) == (quaternion_of(2) if measured else (0, 0, 0, 0))
    stats = streaming.client.stats()
    assert stats.comebacks == stats.errors == (0,) * 8


def test_one_command_about_offsets_at_a_time(streaming):
    assert ask(
        streaming,
        Request(Command.READ_OFFSETS, 1, b'\x00'),
        Request(Command.READ_OFFSETS, 2, b'\x01'),
        Request(Command.RESET_IMU, 3, b'\x00'),
        Request(Command.WRITE_OFFSETS, 4, b'\x05' + OFFSETS[0].to_registers()),
        Request(Command.READ_OFFSETS, 5, b'\x09'),
    ) == [(2, Result.BUSY), (3, Result.BUSY), (4, Result.BUSY), (5, Result.BAD_ARGUMENT), (1, Result.OK)]


def test_busy_keeps_nothing(streaming):
    assert streaming.client.write_offsets(6, OFFSETS[6])
    request = Request(Command.WRITE_OFFSETS, 4, b'\x05' + OFFSETS[0].to_registers())
    assert ask(streaming, request) == [(4, Result.BUSY)]  # on its way back
    come_and_go(streaming, 5)
    assert streaming.client.read_offsets(6) == OFFSETS[6]


def test_reading_brings_no_older_offsets_back(streaming):
    """A chip that has refused what it was given goes on with its own, and these are what is read."""
    before = streaming.client.read_offsets(8)
    streaming.until(lambda data: data.state_of(7) is State.RUN)
    streaming.simulated.command('refuse', 7, 1)
    with pytest.raises(CommandError, match=r'WRITE_OFFSETS of IMU 8: error on the I2C bus'):
        streaming.client.write_offsets(8, OFFSETS[8])
    assert streaming.client.stats().errors == (0, 0, 0, 0, 0, 0, 0, 3)
    streaming.until(lambda data: data.state_of(7) is State.RUN)
    streaming.simulated.command('refuse', 7, 0)
    assert streaming.client.read_offsets(8) == before


# Chips that go and come


def come_and_go(bench, channel):
    """Unplug a chip, and plug it in again."""
    bench.simulated.command('unplug', channel)
    bench.until(lambda data: data.state_of(channel) is State.ABSENT)
    bench.simulated.command('plug', channel)
    took_s = bench.until(lambda data: data.state_of(channel) is State.RUN)
    assert 0.65 < took_s < 0.75


def test_a_chip_that_never_was_there_is_absent_without_errors(booted):
    booted.simulated.command('unplug', 2)
    booted.start()
    data = booted.watch(0.3)
    assert {(packet.state_of(2), packet.errors_of(2)) for packet in data} == {(State.ABSENT, 0)}
    assert not any(any(packet.quaternion_of(2)) for packet in data)
    stats = booted.client.stats()
    assert stats.errors == stats.comebacks == (0,) * 8


def test_an_unplugged_chip_goes_after_two_sweeps_and_harms_no_other(streaming):
    streaming.simulated.command('unplug', 2)
    data = streaming.watch(0.3)
    seen = [(packet.state_of(2), packet.errors_of(2), any(packet.quaternion_of(2))) for packet in data]
    gone = next(k for k, (_, errors, _) in enumerate(seen) if errors)
    # Every read is tried twice. The first sweep that fails still says RUN, of a quaternion of zeros.
    assert seen[gone] == (State.RUN, 2, False)
    assert set(seen[gone + 1 :]) == {(State.ABSENT, 4, False)}
    assert_no_gap(data)
    others = (0, 1, 3, 4, 5, 6, 7)
    assert all(packet.quaternion_of(k) == quaternion_of(k) for packet in data for k in others)
    stats = streaming.client.stats()
    assert (stats.errors[2], stats.comebacks[2]) == (4, 0)


def test_a_chip_that_comes_back_has_its_offsets_again(streaming):
    assert streaming.client.write_offsets(3, OFFSETS[3])
    streaming.until(lambda data: data.state_of(2) is State.RUN)
    come_and_go(streaming, 2)
    assert streaming.data()[-1].errors_of(2) == 0
    assert streaming.client.read_offsets(3) == OFFSETS[3]
    assert streaming.client.stats().comebacks == (0, 0, 1, 0, 0, 0, 0, 0)


def test_offsets_for_an_absent_chip_are_kept_for_its_coming(streaming):
    streaming.simulated.command('unplug', 2)
    streaming.until(lambda data: data.state_of(2) is State.ABSENT)
    for request in (
        Request(Command.READ_OFFSETS, 1, b'\x02'),
        Request(Command.RESET_IMU, 1, b'\x02'),
        Request(Command.WRITE_OFFSETS, 1, b'\x02' + OFFSETS[1].to_registers()),
    ):
        assert ask(streaming, request) == [(1, Result.ABSENT)]
    streaming.simulated.command('plug', 2)
    # While it boots it is absent too.
    request = Request(Command.WRITE_OFFSETS, 1, b'\x02' + OFFSETS[2].to_registers())
    assert ask(streaming, request) == [(1, Result.ABSENT)]
    streaming.until(lambda data: data.state_of(2) is State.RUN)
    assert streaming.client.read_offsets(3) == OFFSETS[2]


def test_a_chip_pulled_while_its_offsets_are_read_is_answered_for(streaming):
    streaming.client.port.write(encode_frame(Request(Command.READ_OFFSETS, 9, b'\x05').encode()))
    streaming.until(lambda data: data.state_of(5) is State.TO_CONFIG)
    streaming.simulated.command('unplug', 5)
    assert ask(streaming) == [(9, Result.ABSENT)]


def test_a_chip_taken_out_of_use_while_its_offsets_are_read_is_answered_for(streaming):
    read = Request(Command.READ_OFFSETS, 1, b'\x05')
    without = Request(Command.CONFIGURE, 2, bytes((0x0F, 100, NDOF, 0)))
    assert ask(streaming, read, without) == [(2, Result.OK), (1, Result.ABSENT)]


def test_reset_imu(streaming):
    assert streaming.client.write_offsets(4, OFFSETS[4])
    streaming.packets.clear()
    streaming.client.reset_imu(4)
    streaming.until(lambda data: data.state_of(3) is State.ABSENT)
    streaming.until(lambda data: data.state_of(3) is State.RUN)
    assert streaming.client.read_offsets(4) == OFFSETS[4]
    assert streaming.client.stats().comebacks == (0, 0, 0, 1, 0, 0, 0, 0)


def test_chips_outside_the_mask_are_left_alone(booted):
    booted.start(mask=0x0F)
    for request in (
        Request(Command.READ_OFFSETS, 1, b'\x07'),
        Request(Command.RESET_IMU, 1, b'\x07'),
        Request(Command.WRITE_OFFSETS, 1, b'\x07' + OFFSETS[8].to_registers()),
    ):
        assert ask(booted, request) == [(1, Result.ABSENT)]
    booted.simulated.command('unplug', 6)
    booted.wait(0.2)
    booted.simulated.command('plug', 6)
    booted.wait(0.8)
    stats = booted.client.stats()
    assert stats.errors == stats.comebacks == (0,) * 8
    booted.start(mask=0xF0)
    assert booted.client.read_offsets(8) == OFFSETS[8]


# Counters and resets


def test_a_reset_board_knows_nothing(streaming):
    assert streaming.client.stats().reset_cause == POWER_ON
    streaming.wait(1.0)
    streaming.simulated.command('reset')
    streaming.packets.clear()
    streaming.wait(0.3)
    assert streaming.packets == []
    hello = streaming.client.hello()
    assert hello.uptime_ms == pytest.approx(300, abs=20)
    assert hello.channels == 0xFF
    stats = streaming.client.stats()
    assert stats.reset_cause == EXTERNAL_RESET
    assert (stats.sweeps, stats.rx_bad, stats.comebacks, stats.errors) == (0, 0, (0,) * 8, (0,) * 8)
    assert not streaming.client.write_offsets(1, OFFSETS[0])  # it has no mask
    streaming.start()
    assert streaming.data() == [] or streaming.data()[0].sweep.t_us < 1e6


def test_uptime_and_the_boards_clock_are_one(streaming):
    data = streaming.watch(0.05)[-1]
    uptime_us = 1000 * streaming.client.hello().uptime_ms
    assert uptime_us == pytest.approx(data.sweep.t_us, abs=25_000)
    streaming.wait(2.0)
    assert 1000 * streaming.client.hello().uptime_ms - uptime_us == pytest.approx(2e6, abs=20_000)
