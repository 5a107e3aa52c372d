import pytest
from hypothesis import given
from hypothesis import strategies as st

from sesa2.link.link_errors import PacketError
from sesa2.link.requests import (
    BoardConfiguration,
    Command,
    FusionMode,
    Hello,
    Reply,
    Request,
    Result,
    Stats,
    decode_reply,
    decode_request,
    is_reply,
)

OFFSETS = bytes(range(22))
STATS = Stats(1, 2, 3, 4, 5, 6, 7, 8, tuple(range(9, 17)), tuple(range(17, 25)))

# From the byte table of firmware/PROTOCOL.md.
REQUESTS = [
    (Request(Command.HELLO, 7), '0a 01 07'),
    (
        Request(Command.CONFIGURE, 8, BoardConfiguration(0x81, 100, FusionMode.NDOF, 1).pack()),
        '0b 01 08 81 64 0c 01',
    ),
    (Request(Command.STREAM, 9, b'\x03'), '0c 01 09 03'),
    (Request(Command.WRITE_OFFSETS, 10, b'\x02' + OFFSETS), '0d 01 0a 02' + OFFSETS.hex()),
    (Request(Command.READ_OFFSETS, 11, b'\x07'), '0e 01 0b 07'),
    (Request(Command.RESET_IMU, 12, b'\x00'), '0f 01 0c 00'),
    (Request(Command.STATS, 255), '10 01 ff'),
]
REPLIES = [
    (
        Reply(Command.HELLO, 7, Result.OK, Hello(1, 2, 0x85, 0x12345678).pack()),
        '8a 01 07 00 01 02 85 78 56 34 12',
    ),
    (Reply(Command.CONFIGURE, 8, Result.BAD_ARGUMENT), '8b 01 08 01'),
    (Reply(Command.STREAM, 9, Result.OK), '8c 01 09 00'),
    (Reply(Command.WRITE_OFFSETS, 10, Result.ABSENT), '8d 01 0a 02'),
    (Reply(Command.READ_OFFSETS, 11, Result.OK, OFFSETS), '8e 01 0b 00' + OFFSETS.hex()),
    (Reply(Command.RESET_IMU, 12, Result.BUSY), '8f 01 0c 03'),
    (
        Reply(Command.STATS, 255, Result.OK, STATS.pack()),
        '90 01 ff 00 0100000002000000 0300040005000600 0700 08 090a0b0c0d0e0f10 11001200130014001500160017001800',
    ),
]


@pytest.mark.parametrize(('request_', 'golden'), REQUESTS, ids=lambda value: getattr(value, 'command', ''))
def test_golden_requests(request_, golden):
    assert request_.encode() == bytes.fromhex(golden)
    assert decode_request(request_.encode()) == request_


@pytest.mark.parametrize(('reply', 'golden'), REPLIES, ids=lambda value: getattr(value, 'command', ''))
def test_golden_replies(reply, golden):
    assert reply.encode() == bytes.fromhex(golden)
    assert is_reply(reply.encode())
    assert decode_reply(reply.encode()) == reply


def test_fields_come_back():
    assert Hello.unpack(REPLIES[0][0].fields) == Hello(1, 2, 0x85, 0x12345678)
    assert Stats.unpack(STATS.pack()) == STATS


@pytest.mark.parametrize(
    ('body', 'message'),
    [
        ('0a 01', 'at least 3 bytes'),
        ('09 01 00', 'unknown command 9'),
        ('0a 01 00 00', 'HELLO has 0 argument bytes, got 1'),
        ('0d 01 00 02 00', 'WRITE_OFFSETS has 23 argument bytes, got 2'),
    ],
)
def test_refused_requests(body, message):
    with pytest.raises(PacketError, match=message):
        decode_request(bytes.fromhex(body))


@pytest.mark.parametrize(
    ('body', 'message'),
    [
        ('8a 01 07', 'at least 4 bytes'),
        ('0a 01 07 00', '10 is no reply'),
        ('ff 01 07 00', '127'),
        ('8a 01 07 05', '5'),
        ('8a 01 07 00', 'HELLO is answered OK with 7 bytes, got 0'),
        ('8e 01 07 02 00', 'READ_OFFSETS is answered ABSENT with 0 bytes, got 1'),
    ],
)
def test_refused_replies(body, message):
    with pytest.raises(PacketError, match=message):
        decode_reply(bytes.fromhex(body))


def test_other_versions_come_through_whatever_their_length():
    assert decode_request(bytes.fromhex('0a 02 07 aa bb')).version == 2
    assert decode_reply(bytes.fromhex('8a 02 07 00 aa')).version == 2


def test_imu_mode_has_no_magnetometer():
    assert [mode.name for mode in FusionMode if not mode.uses_magnetometer] == ['IMU']


@given(st.binary(max_size=91))
def test_any_bytes_are_a_packet_or_refused(body):
    for decode in (decode_request, decode_reply):
        try:
            packet = decode(body)
        except PacketError:
            continue
        assert packet.encode() == body
