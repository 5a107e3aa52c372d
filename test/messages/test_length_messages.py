"""Measured lengths out of messages that rosbags serialises, whole and damaged; and into messages."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from sesa2.messages.length_messages import (
    LENGTHS_TYPE,
    NAMELESS,
    NO_LENGTH,
    TWICE,
    UNKNOWN,
    UNREADABLE,
    LengthIntake,
    LengthMessages,
)

STORE = get_typestore(Stores.ROS2_JAZZY)
NAMES = ('b1', 'b2', 'left_rack')
STAMP_NS = 1_700_000_000_123_456_789


def message(names, positions, stamp_ns=STAMP_NS, *, frame='', little_endian=True, velocity=()):
    types = STORE.types
    stamp = types['builtin_interfaces/msg/Time'](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    header = types['std_msgs/msg/Header'](stamp=stamp, frame_id=frame)
    said = types[LENGTHS_TYPE](
        header=header,
        name=list(names),
        position=np.array(positions, dtype=float),
        velocity=np.array(velocity, dtype=float),
        effort=np.zeros(0),
    )
    return bytes(STORE.serialize_cdr(said, LENGTHS_TYPE, little_endian=little_endian))


@pytest.mark.parametrize('little_endian', [True, False])
@pytest.mark.parametrize('frame', ['', 'a', 'base_link'])
def test_lengths_are_taken_by_name_in_any_order(frame, little_endian):
    intake = LengthIntake(NAMES)
    data = message(('left_rack', 'b1'), (0.3, 0.1), frame=frame, little_endian=little_endian, velocity=(1, 2))
    said = intake.take(data)
    assert said.backbones == (2, 0)
    assert said.stamps_ns.tolist() == [STAMP_NS]
    np.testing.assert_array_equal(said.lengths, [[0.3, 0.1]])
    assert not intake.refused


def test_what_is_made_is_read_by_rosbags_and_back():
    stamps = STAMP_NS + 10_000_000 * np.arange(3)
    lengths = np.random.default_rng(0).uniform(0.1, 0.2, (3, 3))
    rows = [row.tobytes() for row in LengthMessages(NAMES).make_lengths(stamps, lengths)]
    for stamp, own, row in zip(stamps.tolist(), lengths, rows, strict=True):
        got = STORE.deserialize_cdr(row, LENGTHS_TYPE)
        assert (got.header.stamp.sec * 10**9 + got.header.stamp.nanosec, got.name) == (stamp, list(NAMES))
        np.testing.assert_array_equal(got.position, own)
        assert len(got.velocity) == len(got.effort) == 0
    [said] = LengthIntake(NAMES).take_many(rows)
    assert said.stamps_ns.tolist() == stamps.tolist()
    np.testing.assert_array_equal(said.lengths, lengths)


@pytest.mark.parametrize(
    ('data', 'reason', 'example'),
    [
        (message((), ()), NAMELESS, "expected ['b1', 'b2', 'left_rack']"),
        (message(('b1', 'b9'), (0.1, 0.2)), UNKNOWN, "['b9'], expected some of ['b1', 'b2', 'left_rack']"),
        (message(('b1', 'b1'), (0.1, 0.2)), TWICE, "['b1', 'b1']"),
        (message(('b1', 'b2'), (0.1,)), UNREADABLE, 'a JointState with 1 positions of 2 joints'),
        (message(('b1', 'b2'), ()), UNREADABLE, 'a JointState with 0 positions of 2 joints'),
        (message(('b1', 'b2'), (0.1, np.nan)), NO_LENGTH, "[0.1, nan] m of ['b1', 'b2']"),
        (message(('b1',), (np.inf,)), NO_LENGTH, "[inf] m of ['b1']"),
        (message(('b1',), (-0.1,)), NO_LENGTH, "[-0.1] m of ['b1']"),
        (message(('b1',), (0.0,)), NO_LENGTH, "[0.0] m of ['b1']"),
        (b'', UNREADABLE, 'a JointState that is not plain CDR'),
        (b'\0\1\0\0', UNREADABLE, 'a JointState of 4 bytes is not whole'),
    ],
)
def test_what_is_no_length_is_refused_counted_and_shown(data, reason, example):
    intake = LengthIntake(NAMES)
    assert intake.take(data) is None
    assert intake.take(data) is None
    assert intake.refused == {reason: 2}
    assert intake.example == {reason: example}
    assert intake.take(message(('b1',), (0.1,))).lengths.tolist() == [[0.1]], 'it goes on'


def test_a_message_cut_anywhere_is_refused():
    data = message(NAMES, (0.1, 0.2, 0.3), velocity=(1, 2, 3))
    whole = data.index(np.float64(0.3).tobytes()) + 8  # of the rest nothing is wanted
    for fresh in (True, False):
        for size in range(whole):
            intake = LengthIntake(NAMES)
            if not fresh:
                intake.take(data)
            assert intake.take(data[:size]) is None, size
            assert intake.refused == {UNREADABLE: 1}
        assert LengthIntake(NAMES).take(data[:whole]) is not None


def test_scale_and_offset_tell_what_can_be_a_length():
    """An encoder that counts backwards from home."""
    intake = LengthIntake(('b1', 'b2'), scales=(-1.0,), offsets=(0.12, 0.2))
    said = intake.take(message(('b2', 'b1'), (-0.05, 0.1)))
    np.testing.assert_array_equal(said.lengths, [[-0.05, 0.1]])
    assert intake.take(message(('b2', 'b1'), (-0.05, 0.13))) is None
    assert intake.refused == {NO_LENGTH: 1}


def test_many_at_once_are_the_same_as_one_by_one():
    rng = np.random.default_rng(1)
    data = []
    for k in range(400):
        names = [NAMES, ('b1',), ('left_rack', 'b2'), ('b2', 'left_rack'), ('b7',)][rng.integers(5)]
        values = rng.uniform(0.1, 0.2, len(names))
        if rng.uniform() < 0.05:
            values[0] = np.nan
        one = message(names, values, STAMP_NS + k, little_endian=rng.uniform() < 0.8)
        data.append(one[:30] if rng.uniform() < 0.05 else one)
    together, single = LengthIntake(NAMES), LengthIntake(NAMES)
    got = {}
    for said in together.take_many(data):
        assert (np.diff(said.rows) > 0).all()
        for row, stamp, own in zip(said.rows.tolist(), said.stamps_ns.tolist(), said.lengths, strict=True):
            got[row] = (said.backbones, stamp, own.tolist())
    for row, one in enumerate(data):
        said = single.take(one)
        assert got.get(row) == (
            None if said is None else (said.backbones, said.stamps_ns[0], said.lengths[0].tolist())
        )
    assert together.refused == single.refused
    assert sum(together.refused.values()) + len(got) == 400


def test_layouts_without_end_are_not_remembered():
    names = [f'b{k}' for k in range(40)]
    intake = LengthIntake(names)
    for k in range(40):
        assert intake.take(message((names[k],), (0.1,))).backbones == (k,)
    assert len(intake._layouts) < 20
