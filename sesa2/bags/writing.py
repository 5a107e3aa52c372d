"""Bags as rosbag2 writes them: a folder with one MCAP file and metadata.yaml.

An MCAP file is made of chunks. Of a live recording each chunk is closed and handed to the kernel twice a second, so
that a killed process loses no more than that. It is forced onto the disk only at the end, since fsync can halt its
caller for seconds: a power cut may cost what the kernel had not yet written, usually the last half minute.
"""

import os
import shutil
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from sesa2.bags.chunk_index_file import ChunkIndexFile
from sesa2.bags.definitions import definition
from sesa2.bags.mcap_file import McapFile
from sesa2.errors import Sesa2Error
from sesa2.partial_files import lock_partial, partial_path, sweep_partials

FLUSH_EVERY = 0.5  # s
CHUNK_SIZE = 1 << 20  # bytes
DEPTH = 100  # of every publisher of sesa2

_FOREVER = {'sec': 9223372036, 'nsec': 854775807}
_NEVER = 2**63 - 1  # when an empty bag begins, to rosbag2


class _Channel(NamedTuple):
    name: str
    type: str
    hash: str
    qos: list[dict[str, Any]]


class BagWriter:
    """Writes a bag into a folder; `record` and `new_bag` make one.

    Parameters
    ----------
    folder
        exists and is empty.
    name
        of the bag, for its file.
    flush_every
        how often what was written is handed to the kernel, s; where None, whenever a chunk is full.

    Attributes
    ----------
    counts
        number of messages written, by the topic's number.

    Raises
    ------
    Sesa2Error
        by every method: it cannot be written, for example on a full disk. What was written before stays readable.
    """

    def __init__(self, folder: Path, name: str, flush_every: float | None = None):
        self.path = folder
        self._file_name = f'{name}_0.mcap'
        self._flush_every = flush_every
        self._flushed = time.monotonic()
        self._channels: dict[int, _Channel] = {}
        self._schemas: dict[str, int] = {}
        self.counts: dict[int, int] = {}
        self._first_ns, self._last_ns = _NEVER, 0
        try:
            self._file = (folder / self._file_name).open('wb')
            self._chunk_indexes = ChunkIndexFile(folder)
        except OSError as error:
            raise _not_written(folder, error) from None
        try:
            # LZ4 makes files a fifth larger than Zstandard does, and takes hardly more time than no compression.
            self._mcap = McapFile(self._file, CHUNK_SIZE, self._chunk_indexes)
        except OSError as error:
            raise self._failure(error) from None

    def add_topic(self, name: str, type_name: str, *, latched: bool = False) -> int:
        """Announce a topic.

        Parameters
        ----------
        name
            absolute.
        type_name
            such as `sensor_msgs/msg/Imu`.
        latched
            whether late subscribers get the last message.

        Returns
        -------
        The topic's number, for `write`.
        """
        text, type_hash = definition(type_name)
        qos = [_qos(latched)]
        about = {'offered_qos_profiles': yaml.safe_dump(qos, sort_keys=False), 'topic_type_hash': type_hash}
        try:
            if type_name not in self._schemas:
                self._schemas[type_name] = self._mcap.add_schema(type_name, text)
            number = self._mcap.add_channel(name, self._schemas[type_name], about)
        except OSError as error:
            raise self._failure(error) from None
        self._channels[number] = _Channel(name, type_name, type_hash, qos)
        self.counts[number] = 0
        return number

    def write(self, topic: int, log_ns: int, data: bytes, publish_ns: int | None = None) -> None:
        """Write a message.

        Parameters
        ----------
        topic
            its number.
        log_ns
            when the message was recorded, ns.
        data
            in CDR.
        publish_ns
            when it was published, ns; where None, when it was recorded.
        """
        try:
            self._mcap.add(topic, log_ns, log_ns if publish_ns is None else publish_ns, data)
        except OSError as error:
            raise self._failure(error) from None
        self.counts[topic] += 1
        self._first_ns = min(self._first_ns, log_ns)
        self._last_ns = max(self._last_ns, log_ns)
        if self._flush_every is not None and time.monotonic() - self._flushed >= self._flush_every:
            self.flush()

    def write_many(self, topics: Sequence[int], log_ns: Sequence[int], data: Sequence[bytes]) -> None:
        """Write messages that were published when they were recorded.

        Parameters
        ----------
        topics
            number of the topic of each.
        log_ns
            when each was recorded, ns.
        data
            each, in CDR.
        """
        if not data:
            return
        try:
            self._mcap.add_many(topics, log_ns, data)
        except OSError as error:
            raise self._failure(error) from None
        for topic, n in Counter(topics).items():
            self.counts[topic] += n
        self._first_ns = min(self._first_ns, *log_ns)
        self._last_ns = max(self._last_ns, *log_ns)

    def flush(self) -> None:
        """Close the chunk and hand it to the kernel. Live, also from a timer, for when messages stop coming."""
        try:
            self._mcap.end_chunk()
        except OSError as error:
            raise self._failure(error) from None
        self._flushed = time.monotonic()

    def close(self) -> None:
        """Write what makes it a whole bag, and force it onto the disk. After a failure, just close the file."""
        if self._file.closed:
            return
        try:
            self._mcap.finish()
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            self._chunk_indexes.close()
            (self.path / 'metadata.yaml').write_text(self._metadata(), encoding='utf-8')
        except OSError as error:
            raise self._failure(error) from None

    def abandon(self) -> None:
        """Close the file as it is."""
        for file in (self._file, self._chunk_indexes):
            with suppress(OSError):  # closing tries once more to write what is buffered
                file.close()

    def _failure(self, error: OSError) -> Sesa2Error:
        self.abandon()
        return _not_written(self.path / self._file_name, error)

    def _metadata(self) -> str:
        """As rosbag2 of Jazzy writes it, version 9."""
        start = {'nanoseconds_since_epoch': self._first_ns}
        duration = {'nanoseconds': max(self._last_ns - self._first_ns, 0)}
        total = sum(self.counts.values())
        information = {
            'version': 9,
            'storage_identifier': 'mcap',
            'duration': duration,
            'starting_time': start,
            'message_count': total,
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': channel.name,
                        'type': channel.type,
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': channel.qos,
                        'type_description_hash': channel.hash,
                    },
                    'message_count': self.counts[number],
                }
                for number, channel in self._channels.items()
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self._file_name],
            'files': [
                {
                    'path': self._file_name,
                    'starting_time': dict(start),
                    'duration': dict(duration),
                    'message_count': total,
                }
            ],
            'custom_data': None,
            'ros_distro': 'jazzy',
        }
        return yaml.safe_dump({'rosbag2_bagfile_information': information}, sort_keys=False)


def _not_written(path: Path, error: OSError) -> Sesa2Error:
    return Sesa2Error(f'{path}: cannot be written: {error.strerror or error}')


def _qos(latched: bool) -> dict[str, Any]:
    return {
        'history': 'keep_last',
        'depth': 1 if latched else DEPTH,
        'reliability': 'reliable',
        'durability': 'transient_local' if latched else 'volatile',
        'deadline': dict(_FOREVER),
        'lifespan': dict(_FOREVER),
        'liveliness': 'automatic',
        'liveliness_lease_duration': dict(_FOREVER),
        'avoid_ros_namespace_conventions': False,
    }


def record(path: str | Path) -> BagWriter:
    """A bag that is written in place while messages arrive; close it at the end.

    Parameters
    ----------
    path
        of the new folder; where it exists, `_2`, `_3`, … is appended.

    Raises
    ------
    Sesa2Error
        the folder cannot be made.
    """
    path = Path(path)
    folder, number = path, 1
    try:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except FileExistsError as error:
            raise Sesa2Error(
                f'{path}: cannot be written: {error.filename} is a file, expected a folder'
            ) from None
        while True:
            try:
                folder.mkdir()
                break
            except FileExistsError:
                number += 1
                folder = path.with_name(f'{path.name}_{number}')
    except OSError as error:
        raise _not_written(Path(error.filename or path), error) from None
    return BagWriter(folder, folder.name, FLUSH_EVERY)


@contextmanager
def new_bag(path: str | Path) -> Iterator[BagWriter]:
    """A bag that is there once it is whole: until then it has a temporary name, and after an error it is removed.

    Parameters
    ----------
    path
        of the new folder.

    Raises
    ------
    Sesa2Error
        the folder exists, or cannot be written.
    """
    path = Path(path)
    if path.exists():
        raise Sesa2Error(f'{path}: exists already, expected the name of a new bag')
    sweep_partials(path)
    partial = partial_path(path)
    try:
        partial.mkdir()
        lock = os.open(partial, os.O_RDONLY | os.O_DIRECTORY)
        lock_partial(lock)
    except OSError as error:
        raise _not_written(path, error) from None
    try:
        bag = BagWriter(partial, path.name)
        try:
            yield bag
            bag.close()
        finally:
            bag.abandon()
        try:
            partial.rename(path)
        except OSError as error:
            raise _not_written(path, error) from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        os.close(lock)
