import pytest
from hypothesis import given
from hypothesis import strategies as st

from sesa2.link.link_errors import PacketError
from sesa2.link.requests import FusionMode, decode_reply, decode_request


@pytest.mark.parametrize(
    ('body', 'message'),
    [
        ('0a 01', 'at least 3 bytes'),
        ('0a 02 00 00', 'HELLO has 0 argument bytes, got 1'),
        ('0d 02 00 02 00', 'WRITE_OFFSETS has 23 argument bytes, got 2'),
    ],
)
def test_refused_requests(body, message):
    with pytest.raises(PacketError, match=message):
        decode_request(bytes.fromhex(body))


@pytest.mark.parametrize(
    ('body', 'message'),
    [
        ('8a 02 07', 'at least 4 bytes'),
        ('0a 02 07 00', '10 is no reply'),
        ('ff 01 07 00', '127'),
        ('8a 02 07 05', '5'),
        ('8a 02 07 00', 'HELLO is answered OK with 7 bytes, got 0'),
        ('8e 02 07 02 00', 'READ_OFFSETS is answered ABSENT with 0 bytes, got 1'),
    ],
)
def test_refused_replies(body, message):
    with pytest.raises(PacketError, match=message):
        decode_reply(bytes.fromhex(body))


def test_other_versions_come_through_whatever_their_length():
    assert decode_request(bytes.fromhex('0d 01 07 aa bb')).version == 1
    assert decode_reply(bytes.fromhex('8a 01 07 00 aa')).version == 1


def test_a_chip_in_imu_mode_has_no_north():
    assert [mode.name for mode in FusionMode if mode.loses_heading] == ['IMU']


@given(st.binary(max_size=115))
def test_any_bytes_are_a_packet_or_refused(body):
    for decode in (decode_request, decode_reply):
        try:
            packet = decode(body)
        except PacketError:
            continue
        assert packet.encode() == body
