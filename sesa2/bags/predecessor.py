"""Bags of the ROS 1 predecessor, shown as if our own bridge had published what they hold.

Its sensors all publish on `quat_meas`, type `sesa/quat`: a header without a stamp, an ID, and w x y z.
"""

from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from sesa2.bags.topics import Message, RecordedTopic
from sesa2.errors import Sesa2Error
from sesa2.messages.imu_messages import TYPE, ImuMessages
from sesa2.messages.topic_names import absolute, imu_data

_TOPIC = 'quat_meas'


def is_of_predecessor(connection: Connection) -> bool:
    """Whether a topic of a ROS 1 bag is the one on which the predecessor's sensors publish."""
    return connection.topic.endswith(_TOPIC)


class _Quaternion(NamedTuple):
    """A message of the predecessor; its stamp is when the bag recorded it."""

    stamp_ns: int
    id: int
    x: float
    y: float
    z: float
    w: float


class PredecessorBag:
    """A bag of the predecessor, as a part of a recording (`topics.Part`).

    Parameters
    ----------
    path
        the .bag file, for messages.
    reader
        of it, open; this closes it.
    first_id
        the ID in the bag that is our IMU 1; the lowest in the bag where it is None.

    Raises
    ------
    Sesa2Error
        the definition of its messages is damaged.
    """

    def __init__(self, path: Path, reader: Reader, first_id: int | None = None):
        self._path = path
        self.problems: list[str] = []
        self._reader = reader
        self._connections = [c for c in reader.connections if is_of_predecessor(c)]
        self._types = get_typestore(Stores.EMPTY)
        try:
            for connection in self._connections:
                self._types.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        except Exception as error:  # damage makes its parser stumble in any way
            raise Sesa2Error(f'{path}: nothing readable: {error or type(error).__name__}') from None
        counts = Counter(quaternion.id for quaternion in self._quaternions(self.problems))
        self._first = min(counts, default=0) if first_id is None else first_id
        below = sum(n for id_, n in counts.items() if id_ < self._first)
        if below:
            self.problems.append(
                f'{path}: {below} samples of IDs below the first ID {self._first} are not used'
            )
        self.topics = {
            self._name(id_): RecordedTopic(TYPE, n) for id_, n in sorted(counts.items()) if id_ >= self._first
        }

    def _name(self, bag_id: int) -> str:
        return absolute(imu_data(bag_id - self._first + 1))

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Its quaternions as sensor_msgs/Imu."""
        makers: dict[str, ImuMessages] = {}
        for stamp_ns, bag_id, *orientation in self._quaternions([]):
            name = self._name(bag_id)
            if name in topics:
                maker = makers.setdefault(name, ImuMessages(name.split('/')[1]))
                yield Message(name, TYPE, stamp_ns, maker.make(stamp_ns, np.array(orientation)))

    def _quaternions(self, problems: list[str]) -> Iterator[_Quaternion]:
        read = 0
        try:
            for connection, log_ns, data in self._reader.messages(self._connections):
                m: Any = self._types.deserialize_ros1(data, connection.msgtype)
                yield _Quaternion(log_ns, m.ID, m.x, m.y, m.z, m.w)
                read += 1
        except Exception as error:  # as above
            problems.append(f'{self._path} is damaged after {read} samples, the rest is not used: {error}')

    def close(self) -> None:
        """Close the file."""
        self._reader.close()
