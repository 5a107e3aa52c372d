"""Messages of any recording, whatever its format and however it ended."""

import heapq
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from itertools import chain
from operator import attrgetter
from pathlib import Path

import yaml
from mcap.summary import Summary
from rosbags.rosbag2 import Reader

from sesa2.bags.captured_imus import CapturedImus
from sesa2.bags.mcap_index import indexed_messages, read_index
from sesa2.bags.ros1_bag import open_ros1_bag
from sesa2.bags.sensor_logs import listed_files, open_inertial_columns, open_sensor_logs
from sesa2.bags.topics import Message, Part, RecordedTopic, is_latched
from sesa2.bags.unfinished import UnfinishedMcap
from sesa2.errors import Sesa2Error
from sesa2.messages.topic_names import absolute, is_called
from sesa2.mocap.formats import read_motion_capture
from sesa2.mocap.named_columns import UnusedColumns, unused_columns
from sesa2.regular_files import why_no_regular_file


class Recording:
    """A recording, open for reading; a context manager.

    Attributes
    ----------
    path
        where it is.
    topics
        by absolute name.
    """

    def __init__(self, path: Path, parts: list[Part], problems: Sequence[str] = ()):
        self.path = path
        self._parts = parts
        self._beside: list[Part] = []
        self._columns: list[str] = []
        self._problems = problems
        self.topics: dict[str, RecordedTopic] = {}
        for part in parts:
            self._add_topics(part)

    def add(self, part: Part, columns: Sequence[str] = ()) -> None:
        """Take up a further part, which was recorded at the same time as the others; and which columns it reads."""
        self._beside.append(part)
        self._columns += columns
        self._add_topics(part)

    def _add_topics(self, part: Part) -> None:
        for name, topic in part.topics.items():
            before = self.topics[name].count if name in self.topics else 0
            self.topics[name] = replace(topic, count=topic.count + before)

    @property
    def _all(self) -> list[Part]:
        return [*self._parts, *self._beside]

    @property
    def problems(self) -> list[str]:
        """What could not be read, for people; complete once all messages have been read."""
        problems: list[str] = []
        for problem in (*self._problems, *(problem for part in self._all for problem in part.problems)):
            if isinstance(problem, UnusedColumns):
                rest = [name for name in problem.names if name not in self._columns]
                problems += unused_columns(problem.where, rest)
            else:
                problems.append(problem)
        return problems

    def messages(
        self, topics: Iterable[str] | None = None, span_ns: tuple[int, int] | None = None
    ) -> Iterator[Message]:
        """Messages in order of time; of a bag cut short, in the order of recording.

        Parameters
        ----------
        topics
            names; all where it is None.
        span_ns
            only those recorded from one time to before another, ns; what has an index is then read there alone.
        """
        wanted = set(self.topics if topics is None else topics)
        one_after_another = chain.from_iterable(_within(part, wanted, span_ns) for part in self._parts)
        if not self._beside:
            return one_after_another
        beside = [_within(part, wanted, span_ns) for part in self._beside]
        return heapq.merge(one_after_another, *beside, key=attrgetter('log_ns'))

    @property
    def indexed_ns(self) -> tuple[int, int] | None:
        """When its first and last message were recorded, ns, where parts of it can be read; else None."""
        spans = [part.span_ns if isinstance(part, _Rosbag2) else None for part in self._all]
        known = [span for span in spans if span is not None]
        if len(known) < len(spans) or not known:
            return None
        return min(begin for begin, _ in known), max(end for _, end in known)

    def find(self, name: str, type_name: str) -> str | None:
        """Absolute name of a topic of this type; None where there is none.

        Parameters
        ----------
        name
            absolute, or relative: then it is found in whichever namespace it is.
        type_name
            such as `geometry_msgs/msg/PoseArray`.

        Raises
        ------
        Sesa2Error
            there are several of this name.
        """
        of_type = [n for n, topic in self.topics.items() if topic.type == type_name]
        found = [n for n in of_type if is_called(n, name)]
        if len(found) > 1:
            raise Sesa2Error(
                f'{self.path}: {" and ".join(sorted(found))} are in it, expected the topics of one arm'
            )
        return found[0] if found else None

    def close(self) -> None:
        """Close its files."""
        for part in self._all:
            part.close()

    def __enter__(self) -> 'Recording':
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_recording(source: str | Path | Mapping[int, Path], first_id: int | None = None) -> Recording:
    """Open a recording.

    Parameters
    ----------
    source
        a rosbag2 folder, one file of it (.mcap, .db3), a bag of ROS 1 (.bag), a CSV of what IMUs
        measured (`imu_logs.inertial_columns`), or what a motion capture system exported (`mocap.formats`); or the log
        of each IMU, by id (`imu_logs.log_formats`).
    first_id
        for the predecessor's: the ID in the bag that is our IMU 1; the lowest in the bag where it is None.

    Raises
    ------
    Sesa2Error
        there is no such file, it is no recording, or nothing in it is readable.
    """
    if isinstance(source, Mapping):
        return Recording(Path(listed_files(source.values())), [open_sensor_logs(source)])
    path = Path(source)
    try:
        if path.is_dir():
            recording = _open_folder(path)
        elif path.exists():
            if why := why_no_regular_file(path):
                raise Sesa2Error(f'{path}: {why}')
            recording = Recording(path, [_open_file(path, first_id)])
        else:
            raise Sesa2Error(f'{path}: no such file or folder, expected a recording')
    except OSError as error:
        raise Sesa2Error(f'{path}: cannot be read: {error.strerror or error}') from None
    if recording.problems and not any(topic.count for topic in recording.topics.values()):
        recording.close()
        raise Sesa2Error(f'nothing readable: {"; ".join(recording.problems)}')
    return recording


def opened(
    source: 'str | Path | Mapping[int, Path] | Recording', first_id: int | None = None
) -> 'AbstractContextManager[Recording]':
    """What `open_recording` opens; a recording that is open stays so: of a long one, opening takes its time."""
    return nullcontext(source) if isinstance(source, Recording) else open_recording(source, first_id)


def _open_folder(path: Path) -> Recording:
    problems = []
    if (path / 'metadata.yaml').is_file():
        try:
            return Recording(path, [_Rosbag2(path)])
        except _RefusedError as refused:
            problems = [f'{path}: not all of the bag that metadata.yaml describes is there: {refused}']
    files = sorted((p for p in path.iterdir() if p.suffix in ('.mcap', '.db3')), key=_number_in_name)
    if not files:
        raise Sesa2Error(f'{path}: no recording in this folder, expected .mcap or .db3 files')
    return Recording(path, [_open_file(file) for file in files], problems)


def _number_in_name(path: Path) -> tuple[int, str]:
    """The files of a bag that was split are numbered; the tenth comes after the second."""
    number = re.search(r'_(\d+)$', path.stem)
    return int(number[1]) if number else 0, path.name


def _open_file(path: Path, first_id: int | None = None) -> Part:
    if path.suffix == '.bag':
        return open_ros1_bag(path, first_id)
    if path.suffix not in ('.mcap', '.db3'):
        return open_inertial_columns(path) or CapturedImus(path, read_motion_capture(path))
    try:
        return _Rosbag2(path)
    except _RefusedError as refused:
        if path.suffix == '.db3':
            raise Sesa2Error(f'{path}: nothing readable: {refused}') from None
        return UnfinishedMcap(path)


def _indexed_files(path: Path) -> list[tuple[Path, Summary]]:
    """The files of a bag with their indices; none where not all of them are MCAP files that have one."""
    files = [path]
    if path.is_dir():
        information = yaml.safe_load((path / 'metadata.yaml').read_text('utf-8'))[
            'rosbag2_bagfile_information'
        ]
        if information.get('compression_mode'):
            return []
        files = [path / name for name in information['relative_file_paths']]
    found = [(file, read_index(file)) for file in files if file.suffix == '.mcap']
    indexed = [(file, summary) for file, summary in found if summary is not None]
    return indexed if len(indexed) == len(files) else []


def _within(part: Part, topics: set[str], span_ns: tuple[int, int] | None) -> Iterator[Message]:
    if span_ns is None:
        return part.messages(topics)
    begin, end = span_ns
    found = part.messages(topics, span_ns) if isinstance(part, _Rosbag2) else part.messages(topics)
    return (message for message in found if begin <= message.log_ns < end)


class _RefusedError(Exception):
    """Why rosbags does not read a bag."""


class _Rosbag2:
    """A bag or file that ended well, read with rosbags, as a part of a recording (`topics.Part`)."""

    def __init__(self, path: Path):
        self._path = path
        self.topics: dict[str, RecordedTopic] = {}
        self.problems: list[str] = []
        try:
            self._reader = Reader(path)
            self._reader.open()
        except OSError:
            raise
        except Exception as error:  # a damaged file makes its parser stumble in any way
            raise _RefusedError(str(error) or type(error).__name__) from None
        self._indexed = _indexed_files(path)
        self._names = {c.id: absolute(c.topic) for c in self._reader.connections}
        for connection in self._reader.connections:
            name = self._names[connection.id]
            count = connection.msgcount + (self.topics[name].count if name in self.topics else 0)
            latched = is_latched(getattr(connection.ext, 'offered_qos_profiles', ()))
            self.topics[name] = RecordedTopic(connection.msgtype, count, latched, connection.msgdef.data)

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Times of the first and last message, ns; None where it is not indexed."""
        if not self._indexed:
            return None
        statistics = [summary.statistics for _, summary in self._indexed]
        times = [(s.message_start_time, s.message_end_time) for s in statistics if s is not None]
        return min(begin for begin, _ in times), max(end for _, end in times)

    def messages(self, topics: Collection[str], span_ns: tuple[int, int] | None = None) -> Iterator[Message]:
        wanted = [c for c in self._reader.connections if self._names[c.id] in topics]
        if not wanted:  # rosbags would take none for all
            return
        read = 0
        try:
            for file, summary in self._indexed:
                for message in indexed_messages(file, summary, topics, [span_ns] if span_ns else ()):
                    yield message
                    read += 1
            if not self._indexed:
                for connection, log_ns, data in self._reader.messages(wanted):
                    yield Message(self._names[connection.id], connection.msgtype, log_ns, data)
                    read += 1
        except Exception as error:  # as above
            self.problems = [f'{self._path} is damaged after {read} messages, the rest is not used: {error}']

    def close(self) -> None:
        self._reader.close()
