"""MCAP files with chunks that are laid out by numpy: the mcap library takes some 30 µs a message, most of a replay.

The library's own records stand for all that comes once a file or once a chunk. https://mcap.dev/spec
"""

import struct
import zlib
from collections.abc import Sequence
from typing import IO

import lz4.frame
import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Schema,
    Statistics,
    SummaryOffset,
)

from sesa2.bags.chunk_index_file import ChunkIndexFile

MAGIC = b'\x89MCAP0\r\n'
# Opcode, length, channel, sequence, time of the recording and of publishing; then the message.
_MESSAGE = np.dtype(
    [
        ('op', 'u1'),
        ('length', '<u8'),
        ('channel', '<u2'),
        ('sequence', '<u4'),
        ('log', '<u8'),
        ('publish', '<u8'),
    ]
)
_BEFORE_LENGTH_ENDS = 9
_NEVER = 2**64 - 1


def _bytes_of(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


class McapFile:
    """Writes an MCAP file.

    Parameters
    ----------
    file
        open for writing; the caller closes it.
    chunk_size
        of messages that are compressed together, bytes.
    indices
        takes where the chunks are.

    Raises
    ------
    OSError
        by every method, where the file cannot be written.
    """

    def __init__(self, file: IO[bytes], chunk_size: int, indices: ChunkIndexFile):
        self._file = file
        self._chunk_size = chunk_size
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._announced = b''  # schemas and channels for the next chunk
        self._channel_of: list[int] = []  # of messages that wait for it
        self._log_ns: list[int] = []
        self._publish_ns: list[int] = []
        self._data: list[bytes] = []
        self._size = 0
        self._indices = indices
        self._start_ns, self._end_ns = _NEVER, 0
        self._counts: dict[int, int] = {}
        self._at = 0
        self._put(MAGIC + _bytes_of(Header('ros2', 'sesa2')))

    def add_schema(self, name: str, text: str) -> int:
        """Announce a type of ROS 2; its number."""
        schema = Schema(id=len(self._schemas) + 1, data=text.encode(), encoding='ros2msg', name=name)
        self._schemas.append(schema)
        self._announced += _bytes_of(schema)
        return schema.id

    def add_channel(self, topic: str, schema: int, about: dict[str, str]) -> int:
        """Announce a topic; its number."""
        number = len(self._channels) + 1
        channel = Channel(id=number, topic=topic, message_encoding='cdr', schema_id=schema, metadata=about)
        self._channels.append(channel)
        self._announced += _bytes_of(channel)
        return number

    def add(self, channel: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Add a message."""
        self._channel_of.append(channel)
        self._log_ns.append(log_ns)
        self._publish_ns.append(publish_ns)
        self._data.append(data)
        self._size += _MESSAGE.itemsize + len(data)
        if self._size >= self._chunk_size:
            self.end_chunk()

    def add_many(self, channels: Sequence[int], log_ns: Sequence[int], data: Sequence[bytes]) -> None:
        """Add messages that were published when they were recorded."""
        begin = 0
        while begin < len(data):
            end = begin
            while end < len(data) and self._size < self._chunk_size:
                self._size += _MESSAGE.itemsize + len(data[end])
                end += 1
            self._channel_of += channels[begin:end]
            self._log_ns += log_ns[begin:end]
            self._publish_ns += log_ns[begin:end]
            self._data += data[begin:end]
            begin = end
            if self._size >= self._chunk_size:
                self.end_chunk()

    def end_chunk(self) -> None:
        """Write what waits, and hand it to the kernel."""
        if self._announced or self._data:
            self._put_chunk()
        self._file.flush()

    def finish(self) -> None:
        """Write what waits, and the summary."""
        self.end_chunk()
        self._put(_bytes_of(DataEnd(0)))
        summary, offsets, begin = b'', [], self._at
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._indices),
            message_count=sum(self._counts.values()),
            message_end_time=self._end_ns,
            message_start_time=self._start_ns if self._counts else 0,
            metadata_count=0,
            schema_count=len(self._schemas),
        )
        for opcode, records in (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._indices),
        ):
            group = _bytes_of(*records)
            offsets.append(SummaryOffset(opcode, begin + len(summary), len(group)))
            summary += group
        offset_start = begin + len(summary)
        summary += _bytes_of(*offsets)
        footer = struct.pack('<BQQQ', Opcode.FOOTER, 20, begin, offset_start)
        self._put(
            summary + _bytes_of(Footer(begin, offset_start, zlib.crc32(footer, zlib.crc32(summary)))) + MAGIC
        )

    def _put(self, data: bytes) -> None:
        self._file.write(data)
        self._at += len(data)

    def _put_chunk(self) -> None:
        n = len(self._data)
        lengths = np.fromiter(map(len, self._data), np.int64, n)
        heads = np.zeros(n, _MESSAGE)
        heads['op'] = Opcode.MESSAGE
        heads['length'] = lengths + _MESSAGE.itemsize - _BEFORE_LENGTH_ENDS
        heads['channel'], heads['log'], heads['publish'] = self._channel_of, self._log_ns, self._publish_ns
        pieces = [self._announced] * (2 * n + 1)
        size = _MESSAGE.itemsize
        head = heads.tobytes()
        pieces[1::2] = [head[k : k + size] for k in range(0, n * size, size)]
        pieces[2::2] = self._data
        records = b''.join(pieces)
        starts = len(self._announced) + np.cumsum(lengths + size) - (lengths + size)
        start_ns, end_ns = (int(heads['log'].min()), int(heads['log'].max())) if n else (0, 0)
        compressed = lz4.frame.compress(records)
        begin = self._at
        chunk = Chunk(
            compression='lz4',
            data=compressed,
            message_end_time=end_ns,
            message_start_time=start_ns,
            uncompressed_crc=zlib.crc32(records),
            uncompressed_size=len(records),
        )
        self._put(_bytes_of(chunk))
        length = self._at - begin
        if n:
            self._start_ns, self._end_ns = min(self._start_ns, start_ns), max(self._end_ns, end_ns)
        index_offsets = {}
        for number in np.unique(heads['channel']).tolist():
            of_it = heads['channel'] == number
            index_offsets[number] = self._at
            places = np.stack([heads['log'][of_it], starts[of_it].astype('<u8')], axis=1).tobytes()
            self._put(
                struct.pack('<BQHI', Opcode.MESSAGE_INDEX, 6 + len(places), number, len(places)) + places
            )
            self._counts[number] = self._counts.get(number, 0) + int(of_it.sum())
        self._indices.append(
            ChunkIndex(
                chunk_length=length,
                chunk_start_offset=begin,
                compression='lz4',
                compressed_size=len(compressed),
                message_end_time=end_ns,
                message_index_length=self._at - begin - length,
                message_index_offsets=index_offsets,
                message_start_time=start_ns,
                uncompressed_size=len(records),
            )
        )
        self._announced, self._size = b'', 0
        self._channel_of, self._log_ns, self._publish_ns, self._data = [], [], [], []
