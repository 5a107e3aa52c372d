"""The index of a recording's chunks: whole at the end, and in no memory until then."""

import tracemalloc

import pytest
from mcap.reader import make_reader
from mcap.records import ChunkIndex

from sesa2.bags.chunk_index_file import ChunkIndexFile
from sesa2.bags.writing import record
from sesa2.messages.imu_messages import TYPE


def index_of(k):
    return ChunkIndex(
        chunk_length=1000 + k,
        chunk_start_offset=2**40 + k,
        compression='lz4',
        compressed_size=900 + k,
        message_end_time=2**60 + k,
        message_index_length=77,
        message_index_offsets={channel: 2**40 + 10 * k + channel for channel in range(1, k % 30)},
        message_start_time=2**60,
        uncompressed_size=5000 + k,
    )


@pytest.fixture
def index_file(tmp_path):
    made = ChunkIndexFile(tmp_path)
    yield made
    made.close()


def test_what_was_put_in_comes_out_in_order(index_file):
    for k in range(100):
        index_file.append(index_of(k))
    assert len(index_file) == 100
    assert list(index_file) == list(index_file) == [index_of(k) for k in range(100)]


def test_it_has_no_name_that_a_kill_could_leave(index_file, tmp_path):
    index_file.append(index_of(5))
    assert list(tmp_path.iterdir()) == []


def test_an_empty_one(index_file):
    assert list(index_file) == []


def write_chunks(writer, topics, first, n):
    for k in range(first, first + n):
        for topic in topics:
            writer.write(topic, 1000 + k, bytes(324))
        writer.flush()


def test_a_recording_grows_no_memory_and_has_its_index(tmp_path):
    """Seven minutes of flushes; a list in memory takes 0.8 MB."""
    writer = record(tmp_path / 'out')
    topics = [writer.add_topic(f'/imu_{i}/data', TYPE) for i in range(1, 9)]
    write_chunks(writer, topics, 0, 100)
    tracemalloc.start()
    try:
        write_chunks(writer, topics, 100, 900)
        grown = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert grown < 50_000
    assert len(writer._chunk_indexes) == 1000
    writer.close()
    assert sorted(p.name for p in writer.path.iterdir()) == ['metadata.yaml', 'out_0.mcap']
    with (writer.path / 'out_0.mcap').open('rb') as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    assert [chunk.message_start_time for chunk in chunks] == list(range(1000, 2000))
    assert all(sorted(chunk.message_index_offsets) == topics for chunk in chunks)
