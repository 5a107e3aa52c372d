"""Messages of finished MCAP files by their index; rosbags parses record after record, which takes much longer.

https://mcap.dev/spec
"""

import zlib
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.summary import Summary

from sesa2.bags.topics import Message
from sesa2.messages.topic_names import absolute

_COMPRESSIONS = ('', 'lz4', 'zstd')
# A chunk begins with opcode and length, its times and its size; then come its checksum and the rest.
_BEFORE_CRC = 9 + 24
# A message begins with opcode and length; then come channel, sequence number and two times.
_LENGTH, _HEAD = 9, 31
# A message index begins with opcode, length, channel and the length of what follows.
_INDEX_HEAD = 15


class _Found(NamedTuple):
    """A message of a chunk; `data` from begin to end."""

    log_ns: int
    channel: int
    chunk: bytes
    begin: int
    end: int


def read_index(path: Path) -> Summary | None:
    """What an MCAP file holds; None where not all of its messages are in chunks with an index, or anything is odd."""
    try:
        with path.open('rb') as file:
            summary = make_reader(file).get_summary()
    except Exception:  # rosbags will tell what is wrong
        return None
    if summary is None or summary.statistics is None or not summary.chunk_indexes:
        return None
    indexed = all(c.message_index_offsets and c.compression in _COMPRESSIONS for c in summary.chunk_indexes)
    return summary if indexed else None


def indexed_messages(
    path: Path, summary: Summary, topics: Collection[str], spans: Sequence[tuple[int, int]] = ()
) -> Iterator[Message]:
    """Messages of these topics in order of time; where spans are given, ns, those of the chunks that reach into one.

    Raises
    ------
    Exception
        of any kind, where the file is damaged.
    """
    wanted = {
        number: (absolute(channel.topic), summary.schemas[channel.schema_id].name)
        for number, channel in summary.channels.items()
        if absolute(channel.topic) in topics
    }
    chunks = [c for c in summary.chunk_indexes if not wanted.keys().isdisjoint(c.message_index_offsets)]
    if spans:
        chunks = [
            c for c in chunks if any(b <= c.message_end_time and c.message_start_time < e for b, e in spans)
        ]
    chunks.sort(key=lambda c: c.message_start_time)
    waiting: list[_Found] = []  # of chunks that overlap the next one in time
    with path.open('rb') as file:
        for k, chunk in enumerate(chunks):
            found = waiting + _read_chunk(file, chunk, wanted)
            if waiting:
                found.sort(key=lambda m: m.log_ns)
            until = chunks[k + 1].message_start_time if k + 1 < len(chunks) else None
            ready = len(found)
            while until is not None and ready and found[ready - 1].log_ns >= until:
                ready -= 1
            for log_ns, channel, data, begin, end in found[:ready]:
                yield Message(*wanted[channel], log_ns, data[begin:end])
            waiting = found[ready:]


def _read_chunk(file: IO[bytes], chunk: ChunkIndex, wanted: Collection[int]) -> list[_Found]:
    """Messages of a chunk in order of time."""
    file.seek(chunk.chunk_start_offset + _BEFORE_CRC)
    crc = int.from_bytes(file.read(4), 'little')
    file.seek(chunk.chunk_start_offset + _BEFORE_CRC + 16 + len(chunk.compression))
    data = file.read(chunk.compressed_size)
    if chunk.compression == 'lz4':
        data = lz4.frame.decompress(data)
    elif chunk.compression == 'zstd':
        data = zstandard.decompress(data, chunk.uncompressed_size)
    if len(data) != chunk.uncompressed_size or (crc and zlib.crc32(data) != crc):
        raise ValueError('Chunk checksum mismatch.')
    places, channels = [], []
    for channel, offset in chunk.message_index_offsets.items():
        if channel in wanted:
            file.seek(offset + _INDEX_HEAD - 4)
            size = int.from_bytes(file.read(4), 'little')
            places.append(np.frombuffer(file.read(size), '<u8').reshape(-1, 2))
            channels.append(np.full(len(places[-1]), channel))
    log_ns, offsets = np.concatenate(places).T.astype(np.int64)
    order = np.lexsort((offsets, log_ns))
    log_ns, offsets, channel_of = log_ns[order], offsets[order], np.concatenate(channels)[order]
    raw: Any = np.frombuffer(data, np.uint8)
    if (raw[offsets] != Opcode.MESSAGE).any():
        raise ValueError('Message index mismatch.')
    lengths = raw[offsets[:, None] + np.arange(1, _LENGTH)].view('<u8')[:, 0].astype(np.int64)
    ends = offsets + _LENGTH + lengths
    if (ends > len(data)).any():
        raise ValueError('Message index mismatch.')
    columns = (log_ns, channel_of, offsets + _HEAD, ends)
    return [
        _Found(log, channel, data, begin, end)
        for log, channel, begin, end in zip(*(column.tolist() for column in columns), strict=True)
    ]
