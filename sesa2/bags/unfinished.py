"""MCAP files without their end, as a killed recorder or a full disk leaves them."""

from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path

from mcap.records import Channel, McapRecord, Schema
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader
from rosbags.rosbag2.metadata import parse_qos

from sesa2.bags.topics import Message, Topic, absolute, is_latched
from sesa2.errors import Sesa2Error

NS = 1_000_000_000


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
        self.topics: dict[str, Topic] = {}
        self.problems: list[str] = []
        counts: Counter[str] = Counter()
        stamps: list[int] = []
        for message in self._messages(self.topics, self.problems):
            counts[message.topic] += 1
            stamps = [min([*stamps[:1], message.log_ns]), max([*stamps[1:], message.log_ns])]
        self.topics = {name: topic._replace(count=counts[name]) for name, topic in self.topics.items()}
        if self.problems and counts:
            seconds = (stamps[1] - stamps[0]) / NS
            self.problems[-1] += f'; {counts.total()} messages over {seconds:.2f} s before them were read'

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Messages of these topics."""
        return (message for message in self._messages({}, []) if message.topic in topics)

    def _messages(self, topics: dict[str, Topic], problems: list[str]) -> Iterator[Message]:
        schemas: dict[int, str] = {}
        channels: dict[int, tuple[str, str]] = {}
        for record in self._records(problems):
            if isinstance(record, McapMessage):
                yield Message(*channels[record.channel_id], record.log_time, record.data)
            elif isinstance(record, Schema):
                schemas[record.id] = record.name
            elif isinstance(record, Channel):
                name, type_name = absolute(record.topic), schemas.get(record.schema_id, '')
                if record.message_encoding != 'cdr':
                    raise Sesa2Error(
                        f'{self._path}: {name} is encoded as {record.message_encoding!r}, expected cdr (ROS 2)'
                    )
                channels[record.id] = name, type_name
                qos = parse_qos(record.metadata.get('offered_qos_profiles', ''))
                topics[name] = Topic(type_name, 0, is_latched(qos))

    def _records(self, problems: list[str]) -> Iterator[McapRecord]:
        size = self._path.stat().st_size
        whole = 0
        with self._path.open('rb') as file:
            records = iter(StreamReader(file, validate_crcs=True, record_size_limit=size).records)
            while True:
                try:
                    record = next(records, None)
                except Exception:  # half a record makes its parser, or its decompression, stumble in any way
                    what = 'cut short' if file.tell() == size else 'damaged'
                    problems.append(f'{self._path} is {what}: of its {size} bytes the last {size - whole} are not whole')
                    return
                if record is None:
                    return
                yield record
                whole = file.tell()

    def close(self) -> None:
        """Each pass closes its own file."""
