"""The package's side of the link over the table that the board's C files run over too (firmware/test/golden_test.c)."""

import numpy as np
import pytest
from golden_packets import PACKETS, names, number, numbers

from sesa2.link.framing import FrameDecoder, encode_frame
from sesa2.link.link_errors import PacketError
from sesa2.link.packets import (
    Acceleration,
    Data,
    MagneticFields,
    RawData,
    SweepHeader,
    decode_stream,
    encode_acceleration,
    encode_data,
    encode_magnetometer,
    encode_raw,
)
from sesa2.link.requests import Hello, Reply, Request, Stats, decode_reply, decode_request, is_reply


def frame_of(name):
    return bytes.fromhex(PACKETS[name]['frame'])


def body_of(name):
    decoder = FrameDecoder()
    [body] = decoder.feed(frame_of(name))
    assert decoder.errors.total == 0
    return body


def sweep_of(packet):
    return SweepHeader(*(number(packet, key) for key in ('seq', 't_us', 'scan_us', 'mask')))


def rows_of(packet, columns):
    """What the table says of each IMU, those of the mask in ascending order."""
    rows = [numbers(packet, f'imu{channel}') for channel in range(8) if number(packet, 'mask') >> channel & 1]
    return np.array(rows, float).reshape(-1, columns)


@pytest.mark.parametrize('name', names('DATA'))
def test_data(name):
    packet, data = PACKETS[name], decode_stream(body_of(name))
    rows = rows_of(packet, 6)
    assert isinstance(data, Data)
    assert data.sweep == sweep_of(packet)
    assert data.sweep.ids == tuple(k + 1 for k in range(8) if f'imu{k}' in packet)
    np.testing.assert_array_equal(list(data.health), rows[:, 0])
    np.testing.assert_array_equal(list(data.calib), rows[:, 1])
    np.testing.assert_array_equal(data.orientations * 2**14, np.roll(rows[:, 2:], -1, axis=1))
    assert data.line_bytes == len(frame_of(name))
    again = encode_data(data.sweep, data.orientations, data.health, data.calib)
    assert encode_frame(again) == frame_of(name)


@pytest.mark.parametrize('name', names('ACCELERATION'))
def test_acceleration(name):
    packet, acceleration = PACKETS[name], decode_stream(body_of(name))
    rows = rows_of(packet, 3)
    assert isinstance(acceleration, Acceleration)
    assert acceleration.sweep == sweep_of(packet)
    not_measured = (rows == -32768).all(axis=1, keepdims=True)
    expected = np.where(not_measured, np.nan, rows / 100)
    np.testing.assert_allclose(acceleration.accelerations, expected, rtol=0, atol=1e-9)
    assert acceleration.line_bytes == len(frame_of(name))
    assert encode_frame(encode_acceleration(acceleration.sweep, acceleration.accelerations)) == frame_of(name)


def in_si(raw, lsb):
    """Raw vectors, one a row, in SI units; −32768 thrice is not measured."""
    return np.where((raw == -32768).all(axis=1, keepdims=True), np.nan, raw * lsb)


@pytest.mark.parametrize('name', names('RAW'))
def test_raw(name):
    packet, raw = PACKETS[name], decode_stream(body_of(name))
    rows = rows_of(packet, 7)
    assert isinstance(raw, RawData)
    assert raw.sweep == sweep_of(packet)
    np.testing.assert_array_equal(list(raw.health), rows[:, 0])
    velocities = in_si(rows[:, 1:4], np.pi / 180 / 16)
    np.testing.assert_allclose(raw.angular_velocities, velocities, rtol=0, atol=1e-12)
    np.testing.assert_allclose(raw.accelerations, in_si(rows[:, 4:], 0.01), rtol=0, atol=1e-12)
    assert raw.line_bytes == len(frame_of(name))
    again = encode_raw(raw.sweep, raw.angular_velocities, raw.accelerations, raw.health)
    assert encode_frame(again) == frame_of(name)


@pytest.mark.parametrize('name', names('MAGNETOMETER'))
def test_magnetometer(name):
    packet, fields = PACKETS[name], decode_stream(body_of(name))
    assert isinstance(fields, MagneticFields)
    assert fields.sweep == sweep_of(packet)
    np.testing.assert_allclose(fields.fields, in_si(rows_of(packet, 3), 1e-6 / 16), rtol=0, atol=1e-15)
    assert fields.line_bytes == len(frame_of(name))
    assert encode_frame(encode_magnetometer(fields.sweep, fields.fields)) == frame_of(name)


@pytest.mark.parametrize('name', names('REPLY'))
def test_reply(name):
    packet, reply = PACKETS[name], decode_reply(body_of(name))
    assert is_reply(body_of(name))
    header = [number(packet, key) for key in ('cmd', 'version', 'token', 'result')]
    assert [reply.command, reply.version, reply.token, reply.result] == header
    fields = b''
    if 'uptime_ms' in packet:
        fields = Hello(*(number(packet, key) for key in Hello._fields)).pack()
        assert Hello.unpack(reply.fields).pack() == fields
    elif 'sweeps' in packet:
        counted = [number(packet, key) for key in Stats._fields[:8]]
        stats = Stats(*counted, *(tuple(numbers(packet, key)) for key in Stats._fields[8:]))
        assert Stats.unpack(reply.fields) == stats
        fields = stats.pack()
    elif 'offsets' in packet:
        fields = bytes.fromhex(packet['offsets'])
    assert reply.fields == fields
    command, version, token, result = header
    assert encode_frame(Reply(command, token, result, fields, version).encode()) == frame_of(name)


@pytest.mark.parametrize('name', names('REQUEST'))
def test_request(name):
    packet = PACKETS[name]
    command, version, token = (number(packet, key) for key in ('cmd', 'version', 'token'))
    request = Request(command, token, bytes.fromhex(packet['arguments']), version)
    assert encode_frame(request.encode()) == frame_of(name)
    assert decode_request(body_of(name)) == request


@pytest.mark.parametrize('name', names('BAD_REQUEST'))
def test_a_request_of_the_wrong_length_is_refused(name):
    with pytest.raises(PacketError, match='bytes, got'):
        decode_request(body_of(name))


@pytest.mark.parametrize('name', names('BAD_FRAME'))
def test_a_bad_frame_is_dropped_and_counted_and_harms_no_other(name):
    decoder = FrameDecoder()
    assert decoder.feed(frame_of(name)) == []
    assert decoder.errors.total == 1
    assert decoder.feed(frame_of('data_eight')) == [body_of('data_eight')]
