"""MCAP files without their end, as a killed recorder or a full disk leaves them."""

import math
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path

from mcap.records import Channel, Schema
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader
from rosbags.rosbag2.metadata import parse_qos

from sesa2.bags.topics import Message, RecordedTopic, is_latched
from sesa2.errors import Sesa2Error
from sesa2.messages.topic_names import absolute
from sesa2.time import NS


class UnfinishedMcap:
    """An MCAP file read record by record up to its first damage, as a part of a recording (`topics.Part`).

    It is gone through once at the start, to know what it holds. Its messages come in the order of recording.

    Parameters
    ----------
    path
        the .mcap file.

    Raises
    ------
    Sesa2Error
        its messages are not those of ROS 2.
    """

    def __init__(self, path: Path):
        self._path = path
        self.topics: dict[str, RecordedTopic] = {}
        self.problems: list[str] = []
        counts: Counter[str] = Counter()
        first, last = math.inf, -math.inf
        for message in self._messages(self.topics, self.problems):
            counts[message.topic] += 1
            first, last = min(first, message.log_ns), max(last, message.log_ns)
        self.topics = {name: replace(topic, count=counts[name]) for name, topic in self.topics.items()}
        if self.problems and counts:
            self.problems[-1] += f'; {counts.total()} messages over {(last - first) / NS:.2f} s were read'

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Messages of these topics."""
        return (message for message in self._messages({}, []) if message.topic in topics)

    def _messages(self, topics: dict[str, RecordedTopic], problems: list[str]) -> Iterator[Message]:
        """All messages; notes the topics, and what is not whole."""
        schemas: dict[int, Schema] = {}
        channels: dict[int, tuple[str, str]] = {}
        size = self._path.stat().st_size
        whole = 0
        with self._path.open('rb') as file:
            records = iter(StreamReader(file, validate_crcs=True, record_size_limit=size).records)
            while True:
                message = None
                try:
                    record = next(records, None)
                    if isinstance(record, McapMessage):
                        message = Message(*channels[record.channel_id], record.log_time, record.data)
                    elif isinstance(record, Schema):
                        schemas[record.id] = record
                    elif isinstance(record, Channel):
                        channels[record.id] = self._channel(record, schemas, topics)
                except Sesa2Error:
                    raise
                except Exception:  # half a record makes its parser, or its decompression, stumble in any way
                    what = 'cut short' if file.tell() == size else 'damaged'
                    problems.append(f'{self._path} is {what}: {_not_whole(size - whole, size)}')
                    return
                if record is None:
                    return
                if message:
                    yield message
                whole = file.tell()

    def _channel(
        self, channel: Channel, schemas: dict[int, Schema], topics: dict[str, RecordedTopic]
    ) -> tuple[str, str]:
        """Note a topic; its name and type."""
        schema = schemas[channel.schema_id]
        name, type_name = absolute(channel.topic), schema.name
        if channel.message_encoding != 'cdr':
            raise Sesa2Error(
                f'{self._path}: {name} is encoded as {channel.message_encoding!r}, expected cdr (ROS 2)'
            )
        qos = parse_qos(channel.metadata.get('offered_qos_profiles', ''))
        topics[name] = RecordedTopic(type_name, 0, is_latched(qos), schema.data.decode(errors='replace'))
        return name, type_name

    def close(self) -> None:
        """Each pass closes its own file."""


def _not_whole(lost: int, size: int) -> str:
    return (
        f'the last {lost} of its {size} bytes are not whole'
        if lost
        else f'it lacks its end after {size} bytes'
    )
