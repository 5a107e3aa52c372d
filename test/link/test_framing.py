import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sesa2.link.framing import MAX_BODY, FrameDecoder, FrameErrors, encode_frame


def crc_bit_by_bit(data):
    """CRC-16/CCITT-FALSE from its definition: the oracle."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return crc


def stuff(packet):
    """COBS from its definition, for less than 254 bytes."""
    return b''.join(bytes((len(part) + 1,)) + part for part in packet.split(b'\x00'))


def test_golden_frames():
    # The check value that catalogues of CRCs give for CRC-16/CCITT-FALSE is 0x29B1.
    assert encode_frame(b'123456789') == b'\x0c123456789\xb1\x29\x00'
    # HELLO with token 7; STREAM 0 with token 0, whose zeros are stuffed.
    assert encode_frame(bytes.fromhex('0a 01 07')).hex(' ') == '06 0a 01 07 8b 48 00'
    assert encode_frame(bytes.fromhex('0c 01 00 00')).hex(' ') == '03 0c 01 01 03 c2 fc 00'


@given(st.binary(min_size=1, max_size=MAX_BODY))
def test_frames_follow_the_definition_and_come_back(body):
    frame = encode_frame(body)
    assert frame == stuff(body + crc_bit_by_bit(body).to_bytes(2, 'little')) + b'\x00'
    assert FrameDecoder().feed(frame) == [body]


def test_longest_frame_is_119_bytes():
    assert len(encode_frame(bytes(MAX_BODY))) == len(encode_frame(b'\xff' * MAX_BODY)) == 119


@given(st.lists(st.binary(min_size=1, max_size=MAX_BODY), max_size=8), st.data())
def test_any_portions_give_the_same(bodies, data):
    stream = b''.join(map(encode_frame, bodies))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=20)))
    decoder = FrameDecoder()
    got = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        got += decoder.feed(stream[start:end])
    assert got == bodies
    assert decoder.errors == FrameErrors()


@pytest.mark.parametrize(
    ('frame', 'errors'),
    [
        (b'\x00', FrameErrors()),
        (b'\x05\x01\x00', FrameErrors(cobs=1)),  # the code byte points beyond the end
        (b'\x02\x41\x00', FrameErrors(length=1)),  # no room for a CRC
        (b'\x03\x41\x42\x00', FrameErrors(length=1)),
        (encode_frame(b'abc').replace(b'b', b'c'), FrameErrors(crc=1)),
        (encode_frame(b'abc')[1:], FrameErrors(cobs=1)),
        (b'\x01' * 119 + b'\x00', FrameErrors(length=1)),
        (b'\xff' * 1_000_000 + b'\x00', FrameErrors(length=1)),
    ],
    ids=['empty', 'code byte', 'one byte', 'two bytes', 'crc', 'cut', 'one too many', 'a million'],
)
def test_malformed_frame_is_counted_and_the_next_is_read(frame, errors):
    decoder = FrameDecoder()
    assert decoder.feed(frame + encode_frame(b'next')) == [b'next']
    assert decoder.errors == errors


def test_endless_stream_without_delimiter_needs_no_memory():
    decoder = FrameDecoder()
    for _ in range(1000):
        decoder.feed(b'\x55' * 4096)
    assert len(decoder._rest) <= 119
    assert decoder.feed(b'\x00' + encode_frame(b'next')) == [b'next']
    assert decoder.errors == FrameErrors(length=1)


def test_no_single_bit_error_passes():
    body = np.random.default_rng(1).bytes(MAX_BODY)
    frame = encode_frame(body)
    for k in range(len(frame) - 1):
        for bit in range(8):
            damaged = bytearray(frame)
            damaged[k] ^= 1 << bit
            assert FrameDecoder().feed(bytes(damaged)) == []


def in_portions(stream, rng):
    cuts = np.sort(rng.integers(0, len(stream), len(stream) // 200))
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        yield stream[start:end]


def most_wrong(dropped):
    """Wrong bodies that chance allows: a damaged frame passes its CRC with 2⁻¹⁶; more than this, once in 1e6 runs."""
    expected = dropped / 65536
    return expected + 5 * expected**0.5 + 5


def test_under_fire_no_frame_is_wrong_and_no_whole_one_is_missed():
    """Three million bytes with overwritten, lost and inserted ones.

    Bodies are random, hence all different: what comes out is right if and only if it is one of those sent, in order.
    """
    rng = np.random.default_rng(2)
    bodies = [rng.bytes(int(n)) for n in rng.integers(24, MAX_BODY + 1, 50_000)]
    frames = [encode_frame(body) for body in bodies]
    stream = np.frombuffer(b''.join(frames), np.uint8).copy()
    assert len(stream) > 3_000_000
    faults = rng.choice(4, len(stream), p=(0.99, 0.005, 0.0025, 0.0025))
    stream = np.where(faults == 1, rng.integers(0, 256, len(stream), dtype=np.uint8), stream)
    ends = np.cumsum([len(frame) for frame in frames])
    # A frame is whole if neither it nor the delimiter before it was touched.
    touched = np.concatenate([[0], np.cumsum(faults != 0)])
    starts = np.concatenate([[0], ends[:-1]])
    whole = touched[ends] == touched[np.maximum(starts - 1, 0)]
    copies = np.where(faults == 2, 0, np.where(faults == 3, 2, 1))  # lost; doubled
    damaged = np.repeat(stream, copies).tobytes()

    decoder = FrameDecoder()
    got = [body for portion in in_portions(damaged, rng) for body in decoder.feed(portion)]

    sent = set(bodies)
    right = [body for body in got if body in sent]
    wrong = len(got) - len(right)
    missed = {body for body, is_whole in zip(bodies, whole, strict=True) if is_whole} - set(right)
    assert decoder.errors.total > 10_000
    assert wrong <= most_wrong(decoder.errors.total)
    assert not missed
    order = {body: k for k, body in enumerate(bodies)}
    assert np.all(np.diff([order[body] for body in right]) > 0)


def test_noise_gives_nothing():
    rng = np.random.default_rng(3)
    noise = rng.integers(0, 256, 2_000_000, dtype=np.uint8)
    noise[rng.random(len(noise)) < 0.03] = 0  # frames of likely lengths
    decoder = FrameDecoder()
    got = [body for portion in in_portions(noise.tobytes(), rng) for body in decoder.feed(portion)]
    assert decoder.errors.total > 50_000
    assert len(got) <= most_wrong(decoder.errors.total)
