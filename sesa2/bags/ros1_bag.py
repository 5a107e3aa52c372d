"""Bags of ROS 1, read with rosbags: the predecessor's, and any other, whose messages are shown as those of ROS 2."""

from collections.abc import Collection, Iterator
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from sesa2.bags.predecessor import PredecessorBag, is_of_predecessor
from sesa2.bags.topics import Message, Part, RecordedTopic
from sesa2.errors import Sesa2Error
from sesa2.messages.topic_names import absolute

# These have other fields in ROS 2, or stand in the language itself in ROS 1; rosbags converts between them.
_OF_ROS2 = ('std_msgs/msg/Header', 'builtin_interfaces/msg/Time', 'builtin_interfaces/msg/Duration')
_RENAMED = {'tf/msg/tfMessage': 'tf2_msgs/msg/TFMessage'}


def open_ros1_bag(path: Path, first_id: int | None = None) -> Part:
    """Open a .bag file.

    Parameters
    ----------
    path
        of the file.
    first_id
        for the predecessor's: the ID in the bag that is our IMU 1; the lowest in the bag where it is None.

    Raises
    ------
    Sesa2Error
        it is no whole ROS 1 bag.
    """
    reader = Reader(path)
    try:
        reader.open()
        if any(map(is_of_predecessor, reader.connections)):
            return PredecessorBag(path, reader, first_id)
    except (OSError, Sesa2Error):
        raise
    except Exception as error:  # a damaged file makes its parser stumble in any way
        raise Sesa2Error(f'{path}: nothing readable: {error or type(error).__name__}') from None
    part = Ros1Bag(path, reader)
    if first_id is not None:
        part.problems.append(
            f'{path}: no bag of the predecessor; ids are those of its topics, not from {first_id}'
        )
    return part


class Ros1Bag:
    """A ROS 1 bag as a part of a recording (`topics.Part`).

    Parameters
    ----------
    path
        where it is, for messages.
    reader
        of it, open; this closes it.
    """

    def __init__(self, path: Path, reader: Reader):
        self._path, self._reader = path, reader
        self.problems: list[str] = []
        self.topics: dict[str, RecordedTopic] = {}
        self._stores: dict[int, Typestore] = {}
        for connection in reader.connections:
            name = absolute(connection.topic)
            count = connection.msgcount + (self.topics[name].count if name in self.topics else 0)
            text = ''
            try:
                self._stores[connection.id] = store = _types_of(connection)
                text = store.generate_msgdef(connection.msgtype, ros_version=2)[0]
            except Exception as error:  # a definition in a dialect that rosbags does not parse
                self.problems.append(f'{path}: {name} of {connection.msgtype} is not read: {error}')
            self.topics[name] = RecordedTopic(_type_of(connection), count, definition=text)

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Its messages as ROS 2 has them, in CDR."""
        wanted = [c for c in self._reader.connections if absolute(c.topic) in topics and c.id in self._stores]
        if not wanted:  # rosbags would take none for all
            return
        read = 0
        try:
            for connection, log_ns, data in self._reader.messages(wanted):
                cdr = bytes(self._stores[connection.id].ros1_to_cdr(data, connection.msgtype))
                yield Message(absolute(connection.topic), _type_of(connection), log_ns, cdr)
                read += 1
        except Exception as error:  # as above
            problem = f'{self._path} is damaged after {read} messages, the rest is not used: {error}'
            if problem not in self.problems:
                self.problems.append(problem)

    def close(self) -> None:
        """Close the file."""
        self._reader.close()


def _type_of(connection: Connection) -> str:
    return _RENAMED.get(connection.msgtype, connection.msgtype)


def _types_of(connection: Connection) -> Typestore:
    """The types of one connection as its bag has them: those of another may be of another version."""
    store, ros2 = get_typestore(Stores.EMPTY), get_typestore(Stores.ROS2_JAZZY)
    store.register({name: ros2.fielddefs[name] for name in _OF_ROS2})
    types = get_types_from_msg(connection.msgdef.data, connection.msgtype)
    store.register({name: fields for name, fields in types.items() if name not in _OF_ROS2})
    return store
