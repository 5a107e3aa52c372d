"""The virtual firmware step by step: time is handed in, so that every figure here is exact."""

from random import Random

import numpy as np
import pytest

from sesa2.link.framing import FrameDecoder, encode_frame
from sesa2.link.packets import Acceleration, Data, State, decode_stream
from sesa2.link.requests import (
    BoardConfiguration,
    Command,
    FusionMode,
    Hello,
    Request,
    Result,
    Stats,
    Stream,
    decode_reply,
    is_reply,
)
from sesa2.link.virtual.chip import BOOT_US, Chip
from sesa2.link.virtual.firmware import Firmware
from sesa2.link.virtual.motion import ArmMotion
from sesa2.link.virtual.virtual_arm import VirtualArm
from sesa2.sensing.imu.addresses import mask_of

MS = 1000
OFFSETS = bytes(range(22))
NDOF = FusionMode.NDOF


class Bench:
    """A virtual firmware with time in hand."""

    def __init__(self, ids=(1, 2, 3), version=2):
        self.arm = VirtualArm(ids, ArmMotion(np.arange(1, len(ids) + 1) * 0.08))
        self.chips = {imu_id: Chip(Random(imu_id), 12_000_000) for imu_id in ids}
        self.now_us = 0
        self.packets = []
        self.replies = []
        self.decoder = FrameDecoder()
        self.firmware = Firmware(
            self.chips,
            lambda ids, t, headings: self.arm.orientations(ids, t * 1e-6, headings),
            version=version,
        )

    def run(self, duration_us):
        end_us = self.now_us + duration_us
        while True:
            for body in self.decoder.feed(b''.join(self.firmware.advance(self.now_us))):
                if is_reply(body):
                    self.replies.append((self.now_us, decode_reply(body)))
                else:
                    self.packets.append((self.now_us, decode_stream(body)))
            if self.now_us == end_us:
                return
            self.now_us = min(end_us, max(self.now_us + 1, self.firmware.next_us()))

    def ask(self, command, arguments=b'', patience_us=200 * MS, version=2):
        """Give a command; the reply and how long it took."""
        start_us = self.now_us
        self.replies.clear()
        self.firmware.receive(encode_frame(Request(command, 42, arguments, version).encode()), start_us)
        while not self.replies and self.now_us < start_us + patience_us:
            self.run(MS)
        ((answered_us, reply),) = self.replies
        assert (reply.command, reply.token) == (command, 42)
        return reply, answered_us - start_us

    def stream(self, ids=(1, 2, 3), rate_hz=100, mode=NDOF, i2c_100khz=0, flags=Stream.QUATERNIONS):
        configuration = BoardConfiguration(mask_of(ids), rate_hz, mode, i2c_100khz)
        assert self.ask(Command.CONFIGURE, configuration.pack())[0].result is Result.OK
        assert self.ask(Command.STREAM, bytes((flags,)))[0].result is Result.OK

    def states(self):
        return self.packets[-1][1].states


def test_hello():
    bench = Bench(ids=(1, 8))
    bench.run(1234 * MS)
    reply, _ = bench.ask(Command.HELLO)
    assert Hello.unpack(reply.fields)[2:] == (0b1000_0001, 1234)


def test_nothing_is_said_unasked():
    bench = Bench()
    bench.run(10**6)
    assert not bench.packets


def test_sweeps_of_eight_imus_at_their_time():
    ids = tuple(range(1, 9))
    bench = Bench(ids)
    bench.stream(ids)
    bench.run(10**6)
    assert len(bench.packets) == 100
    sent_us = np.array([sent for sent, _ in bench.packets])
    sweeps = [data.sweep for _, data in bench.packets]
    starts_us = np.array([sweep.t_us for sweep in sweeps])
    np.testing.assert_array_equal(np.diff(starts_us), 10 * MS)
    assert [sweep.seq for sweep in sweeps] == list(range(100))
    assert {sweep.scan_us for sweep in sweeps} == {3600}
    # 95 bytes of 10 bits at 500000 baud.
    np.testing.assert_array_equal(sent_us - starts_us, 3600 + 1900)


def test_a_slow_bus_takes_more_time_than_there_is():
    ids = tuple(range(1, 9))
    bench = Bench(ids)
    bench.stream(ids, i2c_100khz=1)
    bench.run(10**6)
    assert 84 <= len(bench.packets) <= 88
    stats = Stats.unpack(bench.ask(Command.STATS)[0].fields)
    assert stats.late >= 80
    assert stats.max_scan_us == 11_520


def test_quaternions_are_the_truth_at_each_imus_own_time():
    bench = Bench()
    bench.stream()
    bench.run(30 * 10**6)
    assert bench.states() == [State.RUN] * 3
    running = [data for _, data in bench.packets if data.states == [State.RUN] * 3]
    t = np.array(
        [[data.sweep.t_us * 1e-6 + read_ns * 1e-9 for read_ns in data.sweep.read_ns()] for data in running]
    )
    truth = bench.arm.motion(t)[:, np.arange(3), np.arange(3)]
    got = np.array([data.orientations for data in running])
    np.testing.assert_allclose(got, truth, rtol=0, atol=2**-15 + 1e-9)


def test_acceleration_goes_with_its_sweep():
    bench = Bench()
    bench.stream(flags=Stream.QUATERNIONS | Stream.ACCELERATION)
    bench.run(10**6)
    (_, data), (_, acceleration) = bench.packets[-2:]
    assert isinstance(data, Data)
    assert isinstance(acceleration, Acceleration)
    assert data.sweep == acceleration.sweep
    np.testing.assert_allclose(np.linalg.norm(acceleration.accelerations, axis=1), 9.80665, atol=0.02)


def test_only_the_configured_channels_and_empty_ones_are_absent():
    bench = Bench()
    bench.stream(ids=(2, 7))
    bench.run(10**6)
    data = bench.packets[-1][1]
    assert data.sweep.ids == (2, 7)
    assert data.states == [State.RUN, State.ABSENT]
    assert not data.orientations[1].any()


def test_stop():
    bench = Bench()
    bench.stream()
    bench.run(10**6)
    bench.ask(Command.STREAM, b'\x00')
    bench.packets.clear()
    bench.run(10**6)
    assert not bench.packets


def test_offsets_are_written_before_and_while_streaming():
    bench = Bench()
    bench.run(30 * MS)
    # No channel is in use before CONFIGURE: the board keeps the offsets, and calls the chip absent.
    reply, took_us = bench.ask(Command.WRITE_OFFSETS, b'\x01' + OFFSETS)
    assert reply.result is Result.ABSENT
    assert took_us < 50 * MS
    bench.stream()
    bench.run(100 * MS)
    reply, took_us = bench.ask(Command.READ_OFFSETS, b'\x01')
    assert (reply.result, reply.fields) == (Result.OK, OFFSETS)
    assert 15 * MS < took_us < 50 * MS
    assert bench.ask(Command.READ_OFFSETS, b'\x01')[0].result is Result.BUSY  # on its way back
    bench.run(100 * MS)
    assert bench.ask(Command.WRITE_OFFSETS, b'\x01' + OFFSETS[::-1])[0].result is Result.OK
    bench.run(100 * MS)
    assert bench.ask(Command.READ_OFFSETS, b'\x01')[0].fields == OFFSETS[::-1]


def test_an_unplugged_imu_leaves_the_others_and_comes_back_with_its_offsets():
    bench = Bench()
    bench.stream()
    bench.run(100 * MS)
    bench.ask(Command.WRITE_OFFSETS, b'\x01' + OFFSETS)
    bench.run(100 * MS)
    bench.chips[2].unplug()
    # Gone after two sweeps in a row, each with a read that was tried again; the first still says RUN, of zeros.
    bench.packets.clear()
    bench.run(25 * MS)
    assert [data.states[1] for _, data in bench.packets] == [State.RUN, State.ABSENT]
    assert not any(data.orientations[1].any() for _, data in bench.packets)
    assert [data.errors[1] for _, data in bench.packets] == [2, 4]
    assert bench.states() == [State.RUN, State.ABSENT, State.RUN]
    assert bench.ask(Command.READ_OFFSETS, b'\x01')[0].result is Result.ABSENT
    bench.chips[2].power_on(bench.now_us)
    assert bench.ask(Command.READ_OFFSETS, b'\x01')[0].result is Result.ABSENT
    bench.run(BOOT_US + 50 * MS)
    assert bench.states() == [State.RUN] * 3
    assert bench.packets[-1][1].errors[1] == 0
    assert bench.ask(Command.READ_OFFSETS, b'\x01')[0].fields == OFFSETS
    stats = Stats.unpack(bench.ask(Command.STATS)[0].fields)
    assert stats.comebacks[:3] == (0, 1, 0)
    assert stats.errors[1] > 0


def test_offsets_for_an_absent_imu_are_kept():
    bench = Bench()
    bench.chips[2].unplug()
    bench.stream()
    assert bench.ask(Command.WRITE_OFFSETS, b'\x01' + OFFSETS)[0].result is Result.ABSENT
    bench.chips[2].power_on(bench.now_us)
    bench.run(BOOT_US + 50 * MS)
    assert bench.ask(Command.READ_OFFSETS, b'\x01')[0].fields == OFFSETS


def test_an_imu_that_goes_while_it_is_read():
    bench = Bench()
    bench.stream()
    bench.run(100 * MS)
    bench.replies.clear()
    bench.firmware.receive(encode_frame(Request(Command.READ_OFFSETS, 1, b'\x01').encode()), bench.now_us)
    bench.run(5 * MS)
    bench.chips[2].unplug()
    bench.run(10 * MS)
    assert [reply.result for _, reply in bench.replies] == [Result.ABSENT]


def test_reset_imu():
    bench = Bench()
    bench.run(30 * MS)
    bench.ask(Command.WRITE_OFFSETS, b'\x01' + OFFSETS)
    bench.stream()
    bench.run(100 * MS)
    assert bench.ask(Command.RESET_IMU, b'\x01')[0].result is Result.OK
    bench.run(20 * MS)
    assert bench.states()[1] is State.ABSENT
    bench.run(BOOT_US + 50 * MS)
    assert bench.states()[1] is State.RUN
    assert bench.ask(Command.READ_OFFSETS, b'\x01')[0].fields == OFFSETS


@pytest.mark.parametrize(
    ('command', 'arguments'),
    [
        (Command.CONFIGURE, BoardConfiguration(7, 0, NDOF, 0).pack()),
        (Command.CONFIGURE, BoardConfiguration(7, 101, NDOF, 0).pack()),
        (Command.CONFIGURE, BoardConfiguration(7, 100, 5, 0).pack()),
        (Command.CONFIGURE, BoardConfiguration(7, 100, NDOF, 2).pack()),
        (Command.STREAM, b'\x10'),
        (Command.READ_OFFSETS, b'\x08'),
    ],
)
def test_bad_arguments(command, arguments):
    assert Bench().ask(command, arguments)[0].result is Result.BAD_ARGUMENT


def test_other_versions():
    bench = Bench(version=3)
    reply, _ = bench.ask(Command.HELLO)
    assert (reply.version, reply.result) == (3, Result.OK)
    assert bench.ask(Command.STATS)[0].result is Result.BAD_ARGUMENT


def test_garbage_is_counted_and_does_no_harm():
    bench = Bench()
    bench.firmware.receive(b'\x05\x01\x00' + encode_frame(b'\x0a\x02\x07\x00') + encode_frame(b'\x63\x01'), 0)
    bench.run(MS)
    assert not bench.replies
    assert Stats.unpack(bench.ask(Command.STATS)[0].fields).rx_bad == 3


def test_board_clock_wraps():
    bench = Bench()
    bench.run(2**32 - 500 * MS)
    bench.stream()
    bench.run(10**6)
    steps = np.diff([data.sweep.t_us for _, data in bench.packets]) % 2**32
    np.testing.assert_array_equal(steps, 10 * MS)
    assert bench.packets[-1][1].sweep.t_us < 10**6
