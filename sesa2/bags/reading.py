"""What sesa2 reads out of recordings: samples of the IMUs, the configuration, and poses."""

from collections import Counter, defaultdict
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sesa2.bags.captured_bodies import add_captured_imus
from sesa2.bags.definitions import POSE_ARRAY, STRING, deserialise
from sesa2.bags.recording import Recording, open_recording
from sesa2.bags.topics import Message, field_topic, imu_topic
from sesa2.errors import Sesa2Error
from sesa2.messages import poses
from sesa2.messages.imu_messages import read_imus
from sesa2.messages.orientation_intake import OrientationIntake, TakenOrientations
from sesa2.messages.topic_names import absolute
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

# Samples that are worked on at once: enough to make numpy worth its while, few enough to stay in the processor's cache.
BLOCK = 2048


class Sample(NamedTuple):
    """One measurement of one IMU: stamp, ns, q_WS, its sensor_msgs/Imu in CDR, and when it was recorded, ns."""

    id: int
    stamp_ns: int
    x: float
    y: float
    z: float
    w: float
    data: bytes
    log_ns: int


class ImuBlock(NamedTuple):
    """Measurements in the recording's order.

    Attributes
    ----------
    ids : (n,)
        of the IMUs.
    stamps_ns : (n,)
        ns.
    orientations : (n, 4)
        q_WS, x y z w.
    data
        the sensor_msgs/Imu that each was read from, in CDR.
    log_ns : (n,)
        when each was recorded, ns.
    """

    ids: np.ndarray
    stamps_ns: np.ndarray
    orientations: FloatArray
    data: list[bytes]
    log_ns: np.ndarray

    def part(self, begin: int, end: int) -> 'ImuBlock':
        """Those from one to before another."""
        which = slice(begin, end)
        data = self.data[which]
        return ImuBlock(
            self.ids[which], self.stamps_ns[which], self.orientations[which], data, self.log_ns[which]
        )

    def chosen(self, which: np.ndarray) -> 'ImuBlock':
        """Those of these numbers."""
        data = [self.data[k] for k in which.tolist()]
        return ImuBlock(
            self.ids[which], self.stamps_ns[which], self.orientations[which], data, self.log_ns[which]
        )

    def samples(self) -> Iterator[Sample]:
        """One by one."""
        columns = (self.ids.tolist(), self.stamps_ns.tolist(), self.orientations.tolist(), self.data)
        for id_, stamp_ns, q, data, log_ns in zip(*columns, self.log_ns.tolist(), strict=True):
            yield Sample(id_, stamp_ns, q[0], q[1], q[2], q[3], data, log_ns)


class FieldMessage(NamedTuple):
    """A sensor_msgs/MagneticField in CDR: of which IMU, and when it was recorded, ns."""

    id: int
    log_ns: int
    data: bytes


class ImuRecording:
    """The IMUs of a recording.

    Parameters
    ----------
    recording
        open, and kept open by the caller.
    intake
        makes orientations of the messages, and keeps count of those that have none; where it is None, measurements of
        IMUs that have none are all zero.

    Attributes
    ----------
    namespace
        of the topics, with a slash at its end.
    counts
        number of messages of each id.
    unreadable
        number of messages of each id that were no whole sensor_msgs/Imu; complete after reading.

    Raises
    ------
    Sesa2Error
        there is no message of an IMU in it, or there are those of several arms.
    """

    def __init__(self, recording: Recording, intake: OrientationIntake | None = None):
        self._recording = recording
        self._intake = intake
        if not any(imu_topic(name, topic.type) for name, topic in recording.topics.items()):
            add_captured_imus(recording)
        by_namespace: dict[str, dict[str, int]] = defaultdict(dict)
        for name, topic in recording.topics.items():
            imu = imu_topic(name, topic.type)
            if imu and topic.count:
                by_namespace[imu.namespace][name] = imu.id
        if not by_namespace:
            there = ', '.join(f'{name} ({t.type}, {t.count})' for name, t in recording.topics.items())
            raise Sesa2Error(
                f'{recording.path}: no message of an IMU, expected topics imu_<id>/data of sensor_msgs/msg/Imu; '
                f'its topics: {there or "none"}'
            )
        if len(by_namespace) > 1:
            names = ' and '.join(sorted(by_namespace))
            raise Sesa2Error(
                f'{recording.path}: IMU topics in the namespaces {names}, expected those of one arm'
            )
        ((self.namespace, self._ids),) = by_namespace.items()
        self.counts = {id_: recording.topics[name].count for name, id_ in self._ids.items()}
        self._fields = {
            name: found.id
            for name, topic in recording.topics.items()
            if (found := field_topic(name, topic.type)) and found.namespace == self.namespace
        }
        self.unreadable: Counter[int] = Counter()

    def blocks(self) -> Iterator[ImuBlock]:
        """All measurements, in the recording's order."""
        wants_fields = self._intake is not None and self._intake.wants_fields
        messages = self._recording.messages([*self._ids, *(self._fields if wants_fields else ())])
        while part := list(islice(messages, BLOCK)):
            if wants_fields and not (part := self._without_fields(part)):
                continue
            ids = np.fromiter((self._ids[message.topic] for message in part), np.int64, len(part))
            log_ns = np.fromiter((message.log_ns for message in part), np.int64, len(part))
            data = [message.data for message in part]
            if self._intake is None:
                read = read_imus(data)
                taken = TakenOrientations(read.stamps_ns, read.orientations, read.readable, read.readable)
            else:
                taken = self._intake.take_many(ids, data)
            if not taken.readable.all():
                self.unreadable.update(ids[~taken.readable].tolist())
            block = ImuBlock(ids, taken.stamps_ns, taken.orientations, data, log_ns)
            if taken.usable.all():
                yield block
            elif taken.usable.any():
                yield block.chosen(np.flatnonzero(taken.usable))

    def fields(self) -> Iterator[FieldMessage]:
        """What the magnetometers beside the IMUs said, in the recording's order."""
        for message in self._recording.messages(self._fields) if self._fields else ():
            yield FieldMessage(self._fields[message.topic], message.log_ns, message.data)

    @property
    def field_ids(self) -> list[int]:
        """IMUs with a magnetometer beside them."""
        return sorted(self._fields.values())

    def _without_fields(self, part: list[Message]) -> list[Message]:
        assert self._intake is not None
        rest = []
        for message in part:
            if message.topic not in self._fields:
                rest.append(message)
                continue
            try:
                self._intake.take_field(self._fields[message.topic], message.data)
            except Sesa2Error:
                self.unreadable[self._fields[message.topic]] += 1
        return rest

    def samples(self) -> Iterator[Sample]:
        """The same one by one."""
        for block in self.blocks():
            yield from block.samples()

    def configuration(self) -> str | None:
        """The configuration that was in force, as YAML; None where the recording does not hold it."""
        name = f'{self.namespace}configuration'
        if name not in self._recording.topics or self._recording.topics[name].type != STRING:
            return None
        message = next(self._recording.messages([name]), None)
        return deserialise(message.data, STRING).data if message else None


def read_configuration(path: str | Path) -> str | None:
    """The configuration in a bag, as YAML; None where it holds none. Its first message, in a bag of ours.

    Raises
    ------
    Sesa2Error
        the bag is not readable.
    """
    with open_recording(path) as recording:
        topics = [n for n, t in recording.topics.items() if n.endswith('/configuration') and t.type == STRING]
        message = next(recording.messages(topics), None) if topics else None
    return deserialise(message.data, STRING).data if message else None


class Poses(NamedTuple):
    """Positions over time, as a PoseArray carries them.

    Attributes
    ----------
    times_s : (n,)
        stamps of the messages, or when they were recorded where they have none, s.
    positions : (n, m, 3)
        m.
    frame
        in which the positions are.
    """

    times_s: FloatArray
    positions: FloatArray
    frame: str


def read_poses(path: str | Path, topic: str) -> Poses:
    """Read one topic of geometry_msgs/PoseArray.

    Parameters
    ----------
    path
        of the recording.
    topic
        its name; the slash in front may be left out.

    Raises
    ------
    Sesa2Error
        the recording is not readable, has no such topic, or its messages have different numbers of poses.
    """
    name = absolute(topic)
    with open_recording(path) as recording:
        there = recording.topics.get(name)
        if there is None or there.type != POSE_ARRAY:
            got = f'it is of {there.type}' if there else 'there is none'
            arrays = ', '.join(n for n, t in recording.topics.items() if t.type == POSE_ARRAY)
            raise Sesa2Error(
                f'{path}: expected a topic {name} of {POSE_ARRAY}, {got}; of this type are: {arrays or "none"}'
            )
        times: list[int] = []
        positions: list[FloatArray] = []
        frame = ''
        for message in recording.messages([name]):
            try:
                stamp_ns, array = poses.read_pose_array(message.data)
                if not times:
                    frame = deserialise(message.data, POSE_ARRAY).header.frame_id
            except Exception:  # cut bytes make a parser stumble in any way
                raise Sesa2Error(f'{path}: message {len(times)} of {name} is no {POSE_ARRAY}') from None
            times.append(stamp_ns or message.log_ns)
            positions.append(array[:, :3])
            if len(array) != len(positions[0]):
                raise Sesa2Error(
                    f'{path}: message {len(times) - 1} of {name} has {len(array)} poses, '
                    f'the first one {len(positions[0])}'
                )
    if not times:
        raise Sesa2Error(f'{path}: no message on {name}')
    return Poses(np.array(times) / NS, np.array(positions, dtype=float).reshape(len(times), -1, 3), frame)


def read_backbone(path: str | Path, topic: str, index: int) -> FloatArray:
    """Positions of one message of a nav_msgs/Path.

    Parameters
    ----------
    path
        of the recording.
    topic
        its name; the slash in front may be left out.
    index
        of the message, from 0.

    Returns
    -------
    (n, 3), m.

    Raises
    ------
    Sesa2Error
        the recording is not readable, or has no such message.
    """
    name = absolute(topic)
    with open_recording(path) as recording:
        messages = recording.messages([name]) if name in recording.topics else iter(())
        message = next(islice(messages, index, None), None)
    if message is None:
        raise Sesa2Error(f'{path}: no message {index} on {name}')
    return poses.read_path(message.data).poses[:, :3]
