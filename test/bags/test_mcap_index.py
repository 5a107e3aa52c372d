"""Messages by the index of an MCAP file, against rosbags and the mcap library on the same file."""

import numpy as np
import pytest
from made_samples import make_samples, write_samples
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.highlevel import AnyReader

from sesa2.bags.definitions import definition
from sesa2.bags.mcap_index import indexed_messages, read_index
from sesa2.bags.recording import open_recording
from sesa2.bags.writing import new_bag
from sesa2.messages.imu_messages import TYPE


def write_with_library(path, messages, **options):
    """(topic, log time, data) by the mcap library, in small chunks."""
    with path.open('wb') as file:
        writer = Writer(file, **{'chunk_size': 5_000, **options})
        writer.start('ros2')
        text, _ = definition(TYPE)
        schema = writer.register_schema(TYPE, 'ros2msg', text.encode())
        channels = {}
        for topic, log_ns, data in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, 'cdr', schema, {'offered_qos_profiles': ''})
            writer.add_message(channels[topic], log_ns, data, log_ns)
        writer.finish()
    return path


def by_rosbags(path):
    with AnyReader([path]) as reader:
        return [(c.topic, t, bytes(d)) for c, t, d in reader.messages()]


def ours(path, topics=None):
    summary = read_index(path)
    topics = {c.topic for c in summary.channels.values()} if topics is None else topics
    return [(m.topic, m.log_ns, m.data) for m in indexed_messages(path, summary, topics)]


@pytest.mark.parametrize('compression', list(CompressionType))
@pytest.mark.parametrize('disorder', [0, 40, 100_000])
def test_messages_are_those_that_rosbags_reads_in_the_same_order(tmp_path, compression, disorder):
    """Chunks that overlap in time a little, or altogether."""
    rng = np.random.default_rng(disorder)
    made = make_samples(120)
    messages = [(m.topic, m.stamp_ns, m.data) for m in made]
    order = np.argsort(np.arange(len(messages)) + rng.uniform(0, disorder + 1e-9, len(messages)))
    path = write_with_library(tmp_path / 'a.mcap', [messages[k] for k in order], compression=compression)
    got = ours(path)
    assert got == messages == by_rosbags(path)
    assert ours(path, {'/imu_2/data'}) == [m for m in messages if m[0] == '/imu_2/data']
    assert ours(path, set()) == []


def test_what_has_no_index_is_left_to_rosbags(tmp_path):
    messages = [(m.topic, m.stamp_ns, m.data) for m in make_samples(40)]
    for k, options in enumerate(
        ({'index_types': IndexType.NONE}, {'use_chunking': False}, {'use_statistics': False})
    ):
        path = write_with_library(tmp_path / f'{k}.mcap', messages, **options)
        assert read_index(path) is None
        with open_recording(path) as recording:
            assert sorted((m.topic, m.log_ns, m.data) for m in recording.messages()) == sorted(messages)
    (tmp_path / 'cut.mcap').write_bytes(path.read_bytes()[:-9])
    assert read_index(tmp_path / 'cut.mcap') is None
    assert read_index(tmp_path / 'missing.mcap') is None


def test_a_damaged_chunk_is_told_and_what_comes_before_it_is_read(tmp_path):
    messages = [(m.topic, m.stamp_ns, m.data) for m in make_samples(200)]
    path = write_with_library(tmp_path / 'a.mcap', messages)
    chunks = read_index(path).chunk_indexes
    data = bytearray(path.read_bytes())
    data[chunks[3].chunk_start_offset + chunks[3].chunk_length - 20] ^= 0xFF
    path.write_bytes(data)
    with open_recording(path) as recording:
        got = [(m.topic, m.log_ns, m.data) for m in recording.messages()]
        [problem] = recording.problems
    assert got == messages[: len(got)]
    assert 20 < len(got) < 100
    assert f'damaged after {len(got)} messages' in problem


def test_what_we_write_is_what_the_library_would(tmp_path, monkeypatch):
    """Message by message, and many at once; the library checks every checksum."""
    monkeypatch.setattr('sesa2.bags.writing.CHUNK_SIZE', 20_000)
    made = make_samples(300)
    with new_bag(tmp_path / 'one') as bag:
        write_samples(bag, made)
    with new_bag(tmp_path / 'many') as bag:
        topics = {name: bag.add_topic(name, TYPE) for name in dict.fromkeys(m.topic for m in made)}
        for begin in range(0, len(made), 100):
            part = made[begin : begin + 100]
            bag.write_many(
                [topics[m.topic] for m in part], [m.stamp_ns for m in part], [m.data for m in part]
            )
    theirs = write_with_library(
        tmp_path / 'theirs.mcap',
        [(m.topic, m.stamp_ns, m.data) for m in made],
        chunk_size=20_000,
        compression=CompressionType.LZ4,
    )
    found = []
    for path in (tmp_path / 'one/one_0.mcap', tmp_path / 'many/many_0.mcap', theirs):
        with path.open('rb') as file:
            reader = make_reader(file, validate_crcs=True)
            messages = [(c.topic, m.log_time, m.publish_time, m.data) for _, c, m in reader.iter_messages()]
            summary = reader.get_summary()
        assert len(summary.chunk_indexes) > 10
        for chunk in summary.chunk_indexes:
            assert set(chunk.message_index_offsets) == {1, 2, 3}
        found.append((messages, summary.statistics.message_count, summary.statistics.channel_message_counts))
        found[-1] += (summary.statistics.message_start_time, summary.statistics.message_end_time)
        found[-1] += tuple((c.message_start_time, c.message_end_time) for c in summary.chunk_indexes[1:-1])
    assert found[0] == found[1]
    assert found[0][:5] == found[2][:5]
    assert (tmp_path / 'one/one_0.mcap').read_bytes() == (tmp_path / 'many/many_0.mcap').read_bytes()
