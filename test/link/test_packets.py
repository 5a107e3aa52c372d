import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sesa2.link.link_errors import PacketError
from sesa2.link.packets import (
    Acceleration,
    Data,
    MagneticFields,
    RawData,
    SweepHeader,
    decode_stream,
    encode_data,
    encode_raw,
    register_of,
    scores_of,
)
from sesa2.sensing.imu.bno055.scores import Scores

# Channels 0 and 2: the first runs, (w, x, y, z) = (1, 0, 0, 0), all scores 3; the second is absent, 15 errors.
DATA = bytes.fromhex(
    '01 02 34 12 78 56 34 12 68 10 05'
    '03 ff 00 40 00 00 00 00 00 00'
    'f0 00 00 00 00 00 00 00 00 00'
)  # fmt: skip
# The same sweep: (0.01, −0.02, 9.81) m/s², and not measured.
ACCELERATION = bytes.fromhex('02 02 34 12 78 56 34 12 68 10 05 01 00 fe ff d5 03 00 80 00 80 00 80')
SWEEP = SweepHeader(seq=0x1234, t_us=0x12345678, scan_us=4200, mask=0b101)


def test_scalar_comes_first_on_the_wire_and_last_here():
    body = bytearray(DATA)
    body[13:21] = bytes.fromhex('01 00 02 00 03 00 fc ff')
    np.testing.assert_array_equal(decode_stream(bytes(body)).orientations[0] * 2**14, [2, 3, -4, 1])


def test_register_0x35():
    assert scores_of(0b11_10_01_00) == Scores(sys=3, gyro=2, accel=1, mag=0)
    assert all(register_of(scores_of(value)) == value for value in range(256))


def test_ids_are_those_of_the_board_that_the_packet_came_from():
    assert decode_stream(DATA).sweep.ids == (1, 3)
    assert decode_stream(DATA, board=2).sweep.ids == (17, 19)
    moved = SWEEP._replace(board=2)
    assert encode_data(moved, np.zeros((2, 4)), bytes(2), bytes(2))[:11] == DATA[:11]


def test_imus_are_read_in_the_middle_of_their_share():
    assert SWEEP.read_ns() == [1_050_000, 3_150_000]


@given(
    st.integers(0, 255),
    st.integers(0, 65535),
    st.integers(0, 2**32 - 1),
    st.integers(0, 65535),
    st.integers(0, 2**32 - 1),
)
def test_data_comes_back(mask, seq, t_us, scan_us, seed):
    rng = np.random.default_rng(seed)
    sweep = SweepHeader(seq, t_us, scan_us, mask)
    n = len(sweep.ids)
    q = rng.normal(size=(n, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    health = bytes((rng.integers(0, 16, n) << 4 | rng.integers(0, 4, n)).tolist())
    data = decode_stream(encode_data(sweep, q, health, bytes(n)))
    assert data.sweep == sweep
    assert data.health == health
    np.testing.assert_allclose(data.orientations, q, rtol=0, atol=2**-15 + 1e-12)


def test_what_is_beyond_a_sensors_range_is_its_end_and_never_its_other_sign():
    body = encode_raw(
        SWEEP, [[40.0, -40.0, 0.0], [np.nan] * 3], [[400.0, -400.0, 9.81], [np.nan] * 3], bytes(2)
    )
    raw = decode_stream(body)
    np.testing.assert_allclose(raw.angular_velocities[0], np.deg2rad([2047.94, -2048, 0]), rtol=1e-5)
    np.testing.assert_allclose(raw.accelerations[0], [327.67, -327.68, 9.81])
    assert np.isnan(raw.accelerations[1]).all()
    assert np.isnan(raw.angular_velocities[1]).all()


@pytest.mark.parametrize(
    ('body', 'message'),
    [
        (b'', 'at least 11 bytes, got 0'),
        (DATA[:10], 'at least 11 bytes, got 10'),
        (b'\x05' + DATA[1:], 'unknown packet type 5'),
        (b'\x01\x01' + DATA[2:], 'version 1, expected 2'),
        (DATA[:-1], 'of 2 IMUs has 31 bytes, got 30'),
        (DATA + b'\x00', 'of 2 IMUs has 31 bytes, got 32'),
        (DATA[:10] + b'\x07' + DATA[11:], 'of 3 IMUs has 41 bytes, got 31'),
        (DATA[:11] + b'\x04' + DATA[12:], 'state beyond 3'),
        (ACCELERATION[:-2], 'of 2 IMUs has 23 bytes, got 21'),
        (b'\x03' + DATA[1:], 'RAW packet of 2 IMUs has 37 bytes, got 31'),
        (b'\x04' + DATA[1:], 'MAGNETOMETER packet of 2 IMUs has 23 bytes, got 31'),
        (b'\x03' + DATA[1:10] + b'\x01\x04' + bytes(12), 'RAW packet with a state beyond 3'),
    ],
)
def test_refused(body, message):
    with pytest.raises(PacketError, match=message):
        decode_stream(body)


@given(st.binary(max_size=115))
def test_any_bytes_are_a_packet_or_refused(body):
    try:
        packet = decode_stream(body)
    except PacketError:
        return
    assert body[0] == 1 + [Data, Acceleration, RawData, MagneticFields].index(type(packet))
