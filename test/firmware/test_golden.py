"""The golden packets against the page that defines them, with nothing but struct, binascii and cobs."""

import struct
from binascii import crc_hqx
from configparser import SectionProxy

import pytest
from cobs import cobs
from golden_packets import PACKETS, names, number, numbers

OK = 0


def sweep_body(packet: SectionProxy, kind: int, entry: str) -> bytes:
    mask = number(packet, 'mask')
    fields = (number(packet, key) for key in ('version', 'seq', 't_us', 'scan_us'))
    head = struct.pack('<BBHIHB', kind, *fields, mask)
    entries = (numbers(packet, f'imu{k}') for k in range(8) if mask >> k & 1)
    return head + b''.join(struct.pack(entry, *values) for values in entries)


def reply_body(packet: SectionProxy) -> bytes:
    cmd, version, token, result = (number(packet, key) for key in ('cmd', 'version', 'token', 'result'))
    body = bytes((0x80 | cmd, version, token, result))
    if result != OK:
        return body
    if 'uptime_ms' in packet:
        keys = ('firmware_major', 'firmware_minor', 'channels', 'uptime_ms')
        body += struct.pack('<BBBI', *(number(packet, key) for key in keys))
    if 'offsets' in packet:
        body += bytes.fromhex(packet['offsets'])
    if 'sweeps' in packet:
        keys = (
            'sweeps',
            'late',
            'max_scan_us',
            'bus_recoveries',
            'rx_bad',
            'rx_overflow',
            'tx_dropped',
            'reset_cause',
        )
        counters = (number(packet, key) for key in keys)
        body += struct.pack(
            '<2I5HB8B8H', *counters, *numbers(packet, 'comebacks'), *numbers(packet, 'errors')
        )
    return body


def request_body(packet: SectionProxy) -> bytes:
    head = bytes(number(packet, key) for key in ('cmd', 'version', 'token'))
    return head + bytes.fromhex(packet['arguments'])


BODIES = {
    'DATA': lambda packet: sweep_body(packet, 1, '<BB4h'),
    'ACCELERATION': lambda packet: sweep_body(packet, 2, '<3h'),
    'RAW': lambda packet: sweep_body(packet, 3, '<B6h'),
    'MAGNETOMETER': lambda packet: sweep_body(packet, 4, '<3h'),
    'REPLY': reply_body,
    'REQUEST': request_body,
}


def test_the_table_has_every_kind_of_packet():
    assert {PACKETS[name]['kind'] for name in PACKETS.sections()} == {*BODIES, 'BAD_REQUEST', 'BAD_FRAME'}
    assert {number(PACKETS[name], 'cmd') for name in names('REQUEST')} >= set(range(10, 17))


@pytest.mark.parametrize('name', names(*BODIES))
def test_a_frame_is_what_its_fields_say(name):
    packet = PACKETS[name]
    body = BODIES[packet['kind']](packet)
    crc = struct.pack('<H', crc_hqx(body, 0xFFFF))
    assert cobs.encode(body + crc) + b'\x00' == bytes.fromhex(packet['frame'])


@pytest.mark.parametrize('name', names('BAD_FRAME'))
def test_a_bad_frame_is_bad(name):
    frame = bytes.fromhex(PACKETS[name]['frame'])
    assert frame.index(0) == len(frame) - 1
    try:
        packet = cobs.decode(frame[:-1])
    except cobs.DecodeError:
        return
    too_long = len(packet) > 117
    assert len(packet) < 3 or too_long or crc_hqx(packet[:-2], 0xFFFF) != struct.unpack('<H', packet[-2:])[0]
