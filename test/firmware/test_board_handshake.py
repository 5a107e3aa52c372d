"""Boot, HELLO, commands that the board must refuse, and a line full of garbage."""

import random

import pytest

from sesa2.link.framing import FrameDecoder, encode_frame
from sesa2.link.link_errors import CommandError
from sesa2.link.requests import BoardConfiguration, Command, FusionMode, Reply, Request, Result, decode_reply

EXTERNAL_RESET, POWER_ON = 0x02, 0x01


def ask(bench, request):
    """The reply to a request that the client would not send."""
    received = bench.simulated.run(0.02, encode_frame(request.encode()))
    replies = [decode_reply(body) for body in FrameDecoder().feed(received) if body[0] & 0x80]
    assert [reply.token for reply in replies] == [request.token]
    return replies[0]


def test_a_board_says_nothing_before_it_is_asked(bench):
    assert bench.simulated.run(1.5) == b''


def test_hello_is_answered_while_the_chips_still_boot(bench):
    hello = bench.client.hello()
    assert (hello.firmware_major, hello.channels) == (1, 0)
    assert bench.simulated.now_us < 0.2e6


def test_hello_finds_the_chips_that_are_there(bench):
    for channel in (1, 4):
        bench.simulated.command('unplug', channel)
    hello = bench.boot()
    assert hello.channels == 0b11101101
    assert hello.uptime_ms == pytest.approx(bench.simulated.now_us / 1000, abs=5)


def test_hello_of_another_version_is_answered_with_the_boards_own(bench):
    bench.boot()
    reply = ask(bench, Request(Command.HELLO, 200, b'a later version', version=9))
    assert (reply.result, reply.version) == (Result.OK, 2)


@pytest.mark.parametrize('command', [command for command in Command if command is not Command.HELLO])
def test_other_commands_of_another_version_are_refused(bench, command):
    bench.boot()
    assert ask(bench, Request(command, 3, b'', version=1)) == Reply(command, 3, Result.BAD_ARGUMENT)


@pytest.mark.parametrize(
    'configuration',
    [
        BoardConfiguration(0xFF, 0, FusionMode.NDOF, 0),
        BoardConfiguration(0xFF, 101, FusionMode.NDOF, 0),
        BoardConfiguration(0xFF, 100, 0x00, 0),
        BoardConfiguration(0xFF, 100, 0x0D, 0),
        BoardConfiguration(0xFF, 100, FusionMode.NDOF, 2),
    ],
)
def test_a_bad_configuration_is_refused_and_changes_nothing(bench, configuration):
    bench.boot()
    with pytest.raises(CommandError, match='CONFIGURE'):
        bench.client.configure(configuration)
    bench.wait(0.2)
    assert [bench.simulated.mode(channel) for channel in range(8)] == [0] * 8


def test_other_bad_arguments_are_refused(bench):
    bench.boot()
    assert ask(bench, Request(Command.STREAM, 1, b'\x10')).result is Result.BAD_ARGUMENT
    assert ask(bench, Request(Command.READ_OFFSETS, 2, b'\x08')).result is Result.BAD_ARGUMENT
    received = bench.simulated.run(0.02, encode_frame(bytes((99, 2, 7))))
    assert FrameDecoder().feed(received) == [bytes((0x80 | 99, 2, 7, Result.BAD_ARGUMENT))]


def test_a_command_of_the_wrong_length_is_dropped_and_counted(bench):
    bench.boot()
    assert bench.simulated.run(0.1, encode_frame(Request(Command.STREAM, 1, b'').encode())) == b''
    assert bench.client.stats().rx_bad == 1


def test_garbage_neither_stops_the_stream_nor_changes_the_board(streaming):
    before = streaming.client.stats()
    noise = random.Random(3)
    start = len(streaming.data())
    for _ in range(50):
        streaming.client.port.write(noise.randbytes(noise.randrange(1, 200)))
        streaming.wait(0.02)
    data = streaming.data()[start:]
    assert len(data) == pytest.approx(100, abs=1)
    assert len({packet.sweep.mask for packet in data}) == 1
    stats = streaming.client.stats()
    assert stats.rx_bad > before.rx_bad
    assert (stats.rx_overflow, stats.tx_dropped, stats.late) == (0, 0, 0)


def test_bytes_that_the_board_could_not_take_are_counted(streaming):
    """A bus so slow that the board looks at its serial port every 36 ms."""
    for channel in range(8):
        streaming.simulated.command('stretch', channel, 4000)
    streaming.wait(0.1)
    streaming.client.port.write(bytes(range(1, 201)) * 10)
    streaming.wait(0.3)
    stats = streaming.client.stats()
    assert 1000 < stats.rx_overflow <= 2000
    assert streaming.simulated.stats()['overruns'] == 0


def test_a_reset_board_knows_nothing_and_is_streaming_again_at_once(streaming):
    assert streaming.client.stats().reset_cause == POWER_ON
    streaming.wait(1.0)
    streaming.simulated.command('reset')
    streaming.packets.clear()
    streaming.wait(0.5)
    assert streaming.packets == []
    hello = streaming.client.hello()
    assert hello.uptime_ms == pytest.approx(500, abs=20)
    assert hello.channels == 0xFF
    assert streaming.client.stats().reset_cause == EXTERNAL_RESET
    answered_us = streaming.simulated.now_us
    streaming.start()
    assert streaming.simulated.now_us - answered_us < 0.2e6
