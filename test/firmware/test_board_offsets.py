"""The calibration offsets' way onto the chips and back."""

import pytest

from sesa2.link.framing import FrameDecoder, encode_frame
from sesa2.link.link_errors import CommandError
from sesa2.link.packets import State
from sesa2.link.requests import Command, Request, Result, decode_reply
from sesa2.sensing.imu.bno055.offsets import Offsets

OFFSETS = Offsets((-1, 2, -300), (400, -500, 600), (0, 1, -1), 1000, 480)
REGISTERS = 0x55


def replies(bench, sent):
    """Tokens and results of the replies within 0.1 s, in their order."""
    received = bench.simulated.run(0.1, sent)
    decoder = FrameDecoder()
    intact = [decode_reply(body) for body in decoder.feed(received) if body[0] & 0x80]
    return [(reply.token, reply.result) for reply in intact]


def on_chip(bench, channel):
    return bench.simulated.registers(channel, REGISTERS, 22)


def test_written_offsets_are_on_the_chip_and_read_back(streaming):
    assert streaming.client.write_offsets(3, OFFSETS)
    assert on_chip(streaming, 2) == OFFSETS.to_registers()
    assert streaming.client.read_offsets(3) == OFFSETS
    assert streaming.client.read_offsets(4) == Offsets((0,) * 3, (0,) * 3, (0,) * 3, 0, 0)
    assert streaming.client.retries == 0


def test_the_other_imus_stream_meanwhile(streaming):
    streaming.packets.clear()
    streaming.client.write_offsets(3, OFFSETS)
    streaming.client.read_offsets(3)
    data = streaming.data()
    assert len(data) >= 5
    others = (0, 1, 3, 4, 5, 6, 7)
    assert all(packet.state_of(channel) is State.RUN for packet in data for channel in others)
    assert {packet.state_of(2) for packet in data} >= {State.TO_CONFIG, State.RUN}
    assert State.ABSENT not in {packet.state_of(2) for packet in data}


def test_offsets_given_before_the_imus_are_configured_are_there_before_the_fusion(bench):
    bench.boot()
    for imu_id in range(1, 9):
        assert not bench.client.write_offsets(imu_id, OFFSETS)
    bench.start()
    assert [on_chip(bench, channel) for channel in range(8)] == [OFFSETS.to_registers()] * 8


def test_offsets_for_an_absent_chip_are_kept_for_it(bench):
    bench.simulated.command('unplug', 1)
    bench.boot()
    bench.start()
    assert not bench.client.write_offsets(2, OFFSETS)
    with pytest.raises(CommandError, match=r'READ_OFFSETS of IMU 2.*absent'):
        bench.client.read_offsets(2)
    bench.simulated.command('plug', 1)
    bench.until(lambda data: data.state_of(1) is State.RUN)
    assert bench.client.read_offsets(2) == OFFSETS


def test_reading_does_not_bring_older_offsets_back(streaming):
    """In calibrate mode the chip's own offsets get better than those that it was given."""
    streaming.client.write_offsets(1, OFFSETS)
    streaming.until(lambda data: data.state_of(0) is State.RUN)
    before = streaming.simulated.stats()['bytes']
    streaming.client.read_offsets(1)
    streaming.until(lambda data: data.state_of(0) is State.RUN)
    assert on_chip(streaming, 0) == OFFSETS.to_registers()
    assert streaming.simulated.stats()['bytes'] > before


def test_a_chip_on_its_way_is_busy(streaming):
    requests = [
        Request(Command.READ_OFFSETS, 1, b'\x00'),
        Request(Command.READ_OFFSETS, 2, b'\x01'),  # one at a time
        Request(Command.RESET_IMU, 3, b'\x00'),
    ]
    assert replies(streaming, b''.join(encode_frame(request.encode()) for request in requests)) == [
        (2, Result.BUSY),
        (3, Result.BUSY),
        (1, Result.OK),
    ]


def test_a_chip_pulled_in_the_middle_is_answered_for(streaming):
    streaming.client.port.write(encode_frame(Request(Command.READ_OFFSETS, 9, b'\x05').encode()))
    streaming.until(lambda data: data.state_of(5) is State.TO_CONFIG)
    streaming.simulated.command('unplug', 5)
    assert replies(streaming, b'\x00') == [(9, Result.ABSENT)]


def test_a_chip_that_does_not_take_its_offsets_is_told_of_and_streams(streaming):
    streaming.simulated.command('refuse', 7, 1)
    with pytest.raises(CommandError, match=r'WRITE_OFFSETS of IMU 8.*I2C'):
        streaming.client.write_offsets(8, OFFSETS)
    assert streaming.client.stats().errors[7] == 3
    streaming.until(lambda data: data.state_of(7) is State.RUN)


def test_an_imu_outside_the_mask_is_left_alone(bench):
    bench.boot()
    bench.start(mask=0x0F)
    assert not bench.client.write_offsets(8, OFFSETS)
    with pytest.raises(CommandError, match='absent'):
        bench.client.read_offsets(8)
    with pytest.raises(CommandError, match='absent'):
        bench.client.reset_imu(8)
    bench.wait(0.2)
    assert on_chip(bench, 7) == bytes(22)
    assert bench.simulated.mode(7) == 0
