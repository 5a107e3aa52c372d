"""What sesa2 reads out of recordings: samples of the IMUs, the configuration, and poses."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sesa2.bags.captured_bodies import add_captured_imus
from sesa2.bags.definitions import PATH, STRING, deserialise
from sesa2.bags.length_columns import add_length_columns
from sesa2.bags.recorded_magnetometers import MagnetometerTopics
from sesa2.bags.recorded_poses import Poses, read_pose_topics
from sesa2.bags.recorded_stamps import RecordedStamps
from sesa2.bags.recording import Recording, opened
from sesa2.bags.topics import Message, RecordedTopic, field_topic, imu_topic, named_imu_topic
from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.messages import poses
from sesa2.messages.field_messages import FIELD_TYPE
from sesa2.messages.header_bytes import read_stamp, with_stamp
from sesa2.messages.imu_messages import TYPE as IMU
from sesa2.messages.imu_messages import read_imus
from sesa2.messages.length_messages import LENGTHS_TYPE
from sesa2.messages.orientation_intake import OrientationIntake, TakenOrientations
from sesa2.messages.topic_names import BACKBONE_LENGTHS, CONFIGURATION, absolute, imu_fields, imu_topics
from sesa2.shape.rotations import FloatArray

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


class BesideMessage(NamedTuple):
    """What was measured beside an IMU, in CDR, and when it was recorded, ns.

    A sensor_msgs/MagneticField of the IMU of an id, or of the magnetometer of an id; or lengths,
    sensor_msgs/JointState: then both are None.
    """

    id: int | None
    log_ns: int
    data: bytes
    magnetometer: int | None = None


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
    fields
        what magnetometers beside the IMUs said until then, where the intake wants that.
    lengths
        messages of measured lengths that were recorded among them; a part of the block has none.
    magnetic
        the same of magnetometers in the arm.
    """

    ids: np.ndarray
    stamps_ns: np.ndarray
    orientations: FloatArray
    data: list[bytes]
    log_ns: np.ndarray
    fields: Sequence[BesideMessage] = ()
    lengths: Sequence[Message] = ()
    magnetic: Sequence[Message] = ()

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


_NO_IMU = ImuBlock(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 4)), [], np.zeros(0, np.int64))
_STAMPED = 16  # bytes of a message that has a header


class ImuRecording:
    """The IMUs of a recording.

    Parameters
    ----------
    recording
        open, and kept open by the caller.
    configuration
        says which IMUs there are, and how their topics are called if not `imu_<id>/data`. What is called so is taken
        by its id also where other names are given and none of them is in the recording.
    intake
        makes orientations of the messages, and keeps count of those that have none; where it is None, measurements of
        IMUs that have none are all zero.

    Attributes
    ----------
    namespace
        of the topics, with a slash at its end.
    counts
        number of messages of each id.
    lengths_topic
        that of measured lengths, where the configuration has some and they are in the recording; else empty.
    magnetometers
        where the configuration has magnetometers, their topics.
    unknown, absent
        ids that are not in the configuration; those that it uses and that have no message.
    unreadable
        number of messages of each id that were no whole sensor_msgs/Imu; complete after reading.
    stamps
        what stood in where messages have no stamp; complete after reading.

    Raises
    ------
    Sesa2Error
        there is no message of an IMU in it, and the configuration has some; or there are those of several arms; or most
        of those that the configuration uses are absent and others are there.
    """

    def __init__(
        self,
        recording: Recording,
        configuration: Configuration | None = None,
        intake: OrientationIntake | None = None,
    ):
        self._recording = recording
        self.stamps = RecordedStamps(configuration is not None and configuration.imus.stamps == 'arrival')
        self._intake = intake
        given = imu_topics(configuration) if configuration and configuration.imus.topics else {}
        self.magnetometers: MagnetometerTopics | None = None
        if configuration and not configuration.imus.all_ids:
            self.magnetometers = MagnetometerTopics(recording, configuration)
            self.namespace, self._ids = self.magnetometers.namespace, {}
            self._finish(configuration, {})
            return
        found = _imus_by_namespace(recording.topics, given)
        if not found:
            add_captured_imus(recording)
            found = _imus_by_namespace(recording.topics, {})
        heard = {
            namespace: {name: id_ for name, id_ in ids.items() if recording.topics[name].count}
            for namespace, ids in found.items()
        }
        anywhere = heard.pop('', {})
        by_namespace = {namespace: ids for namespace, ids in heard.items() if ids}
        if not (anywhere or by_namespace):
            there = ', '.join(f'{name} ({t.type}, {t.count})' for name, t in recording.topics.items())
            expected = ', '.join(given.values()) or 'imu_<id>/data'
            raise Sesa2Error(
                f'{recording.path}: no message of an IMU, expected topics {expected} of {IMU}; '
                f'its topics: {there or "none"}; imus.topics says which is whose where they are called otherwise'
            )
        if len(by_namespace) > 1:
            names = ' and '.join(sorted(by_namespace))
            raise Sesa2Error(
                f'{recording.path}: IMU topics in the namespaces {names}, expected those of one arm'
            )
        self.namespace, relative = next(iter(by_namespace.items()), (_namespace(recording), {}))
        self._ids = {**anywhere, **relative}
        if configuration and configuration.magnetometers.ids:
            self.magnetometers = MagnetometerTopics(recording, configuration, self.namespace)
        self._finish(configuration, given)

    def _finish(self, configuration: Configuration | None, given: Mapping[int, str]) -> None:
        """What is there beside the topics of the IMUs, once these are known."""
        recording = self._recording
        self.counts = {id_: recording.topics[name].count for name, id_ in self._ids.items()}
        self._fields = self._topics_of_fields(imu_fields(configuration) if given and configuration else {})
        self.lengths_topic = self._lengths_wanted = ''
        if configuration and configuration.has_lengths:
            self._find_lengths(configuration.lengths.names)
        self.unreadable: Counter[int] = Counter()
        self.unknown: list[int] = []
        self.absent: list[int] = []
        if configuration and configuration.imus.all_ids:
            self._compare(configuration)

    def _find_lengths(self, names: Sequence[str]) -> None:
        own, of_type = f'{self.namespace}{BACKBONE_LENGTHS}', LENGTHS_TYPE
        self._lengths_wanted = (
            f'expected a topic {own} of {of_type} with the lengths of {", ".join(names)}; in a CSV, columns '
            f'of these names, in m'
        )
        add_length_columns(self._recording, names)
        topic = self._recording.topics.get(own)
        if topic and topic.type == of_type:
            self.lengths_topic = own
        else:
            self.lengths_topic = self._recording.find(BACKBONE_LENGTHS, of_type) or ''

    def check_lengths(self) -> None:
        """Refuse a recording that lacks the lengths that its configuration has.

        Raises
        ------
        Sesa2Error
            there is no message of them.
        """
        if self._lengths_wanted and not (
            self.lengths_topic and self._recording.topics[self.lengths_topic].count
        ):
            raise Sesa2Error(f'{self._recording.path}: no measured length in it, {self._lengths_wanted}')

    def _compare(self, c: Configuration) -> None:
        """Whether those are there that the configuration uses."""
        self.unknown = sorted(set(self.counts) - set(c.imus.all_ids))
        self.absent = [id_ for id_ in c.imus.used_ids if id_ not in self.counts]
        heard = len(c.imus.used_ids) - len(self.absent)
        if heard == 0 and not self.unknown:
            raise Sesa2Error(f'{self._recording.path}: the IMUs with samples are disabled')
        if self.unknown and len(self.absent) > heard:
            what = 'configured IMUs' if heard == 0 else 'IMUs'
            raise Sesa2Error(
                f'{self._recording.path}: no message of the {what} {_listed(self.absent)}; it has topics of '
                f'{_listed(self.counts)}: say in imus.ids or imus.topics which is whose, or which were not there, in '
                'imus.enabled'
            )

    def _topics_of_fields(self, given: Mapping[int, str]) -> dict[str, int]:
        of_type = [name for name, topic in self._recording.topics.items() if topic.type == FIELD_TYPE]
        found = {name: field.id for name in of_type if (field := named_imu_topic(name, given))}
        return found or {
            name: field.id
            for name in of_type
            if (field := field_topic(name)) and field.namespace == self.namespace
        }

    @property
    def warnings(self) -> list[str]:
        """What is there too much and too little, for people; complete after reading."""
        return [
            *self.stamps.problems,
            *(self.magnetometers.warnings if self.magnetometers else []),
            *(f'IMU {id_}: {self.counts[id_]} messages not used: not in imus.ids' for id_ in self.unknown),
            *(f'IMU {id_}: no message' for id_ in self.absent),
            *(f'IMU {id_}: {n} messages not used: damaged' for id_, n in self.unreadable.items()),
        ]

    def blocks(self, span_ns: tuple[int, int] | None = None) -> Iterator[ImuBlock]:
        """All measurements, or those recorded from one time to before another, ns; in the recording's order."""
        wants_fields = self._intake is not None and self._intake.wants_fields
        fields: list[BesideMessage] = []
        of_magnets = self.magnetometers.ids if self.magnetometers else {}
        beside = [
            *(self._fields if wants_fields else ()),
            *filter(None, [self.lengths_topic]),
            *of_magnets,
        ]
        messages = self._recording.messages([*self._ids, *beside], span_ns)
        while part := list(islice(messages, BLOCK)):
            lengths = [message for message in part if message.topic == self.lengths_topic]
            if lengths:
                part = [message for message in part if message.topic != self.lengths_topic]
            magnetic = [message for message in part if message.topic in of_magnets]
            if magnetic:
                part = [message for message in part if message.topic not in of_magnets]
            if wants_fields:
                part = self._without_fields(part, fields)
            if not part:
                if lengths or magnetic:
                    yield _NO_IMU._replace(lengths=lengths, magnetic=magnetic)
                continue
            ids = np.fromiter((self._ids[message.topic] for message in part), np.int64, len(part))
            log_ns = np.fromiter((message.log_ns for message in part), np.int64, len(part))
            data = [message.data for message in part]
            if self._intake is not None and self._intake.fuses:  # it goes by the stamps in the messages
                ids, log_ns, data = self._with_stamps(ids, log_ns, data)
            if self._intake is None:
                read = read_imus(data)
                taken = TakenOrientations(read.stamps_ns, read.orientations, read.readable, read.readable)
            else:
                taken = self._intake.take_many(ids, data)
            if not taken.readable.all():
                self.unreadable.update(ids[~taken.readable].tolist())
            block = ImuBlock(ids, taken.stamps_ns, taken.orientations, data, log_ns)
            if not taken.usable.any() and not (lengths or magnetic):
                continue
            block = block if taken.usable.all() else block.chosen(np.flatnonzero(taken.usable))
            self.stamps.complete(block.ids, block.stamps_ns, block.log_ns, block.data)
            there = fields or lengths or magnetic
            yield block._replace(fields=fields, lengths=lengths, magnetic=magnetic) if there else block
            fields = []

    def _with_stamps(
        self, ids: np.ndarray, log_ns: np.ndarray, data: list[bytes]
    ) -> tuple[np.ndarray, np.ndarray, list[bytes]]:
        """The readable ones of some messages, each with a stamp."""
        read = read_imus(data)
        self.unreadable.update(ids[~read.readable].tolist())
        there = np.flatnonzero(read.readable)
        ids, log_ns, data = ids[there], log_ns[there], [data[k] for k in there]
        self.stamps.complete(ids, read.stamps_ns[there], log_ns, data)
        return ids, log_ns, data

    def beside(self) -> Iterator[BesideMessage]:
        """Magnetic fields and lengths, in the recording's order, each with a stamp."""
        of_magnets = self.magnetometers.ids if self.magnetometers else {}
        topics = [*self._fields, *filter(None, [self.lengths_topic]), *of_magnets]
        for message in self._recording.messages(topics) if topics else ():
            id_, data = self._fields.get(message.topic), message.data
            magnetometer = of_magnets.get(message.topic)
            if id_ is not None or magnetometer is not None:
                data = self.stamps.of_field(data, message.log_ns)
            elif len(data) >= _STAMPED and not read_stamp(data):
                data = with_stamp(data, message.log_ns)
            yield BesideMessage(id_, message.log_ns, data, magnetometer)

    def field_samples(self) -> Iterator[Sample]:
        """What magnetometers in the arm said, one by one, as `samples`, of no orientation."""
        of_magnets = self.magnetometers.ids if self.magnetometers else {}
        for message in self._recording.messages(of_magnets) if of_magnets else ():
            data = self.stamps.of_field(message.data, message.log_ns)
            stamp_ns = read_stamp(data) if len(data) >= _STAMPED else message.log_ns
            nan = float('nan')
            id_ = of_magnets[message.topic]
            yield Sample(id_, stamp_ns, nan, nan, nan, nan, data, message.log_ns)

    @property
    def field_ids(self) -> list[int]:
        """IMUs with a magnetometer beside them."""
        return sorted(self._fields.values())

    def _without_fields(self, part: list[Message], fields: list[BesideMessage]) -> list[Message]:
        assert self._intake is not None
        rest = []
        for message in part:
            if message.topic not in self._fields:
                rest.append(message)
                continue
            imu = self._fields[message.topic]
            try:
                data = self.stamps.of_field(message.data, message.log_ns)
                self._intake.take_field(imu, data)
            except Sesa2Error:
                self.unreadable[imu] += 1
            else:
                fields.append(BesideMessage(imu, message.log_ns, data))
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


def _imus_by_namespace(
    topics: Mapping[str, RecordedTopic], given: Mapping[int, str]
) -> dict[str, dict[str, int]]:
    """Ids of the IMUs by topic, for each namespace; '' is that of topics whose names were given absolute."""
    imus = [name for name, topic in topics.items() if topic.type == IMU]
    found: dict[str, dict[str, int]] = defaultdict(dict)
    for find in (lambda name: named_imu_topic(name, given), imu_topic):
        for name in imus:
            if imu := find(name):
                found[imu.namespace][name] = imu.id
        if found:
            break
    return found


def _namespace(recording: Recording) -> str:
    """That of a recording whose IMUs are called by absolute names."""
    names = [n for n, t in recording.topics.items() if n.endswith('/configuration') and t.type == STRING]
    return names[0].removesuffix('configuration') if len(names) == 1 else '/'


def _listed(ids: Iterable[int]) -> str:
    return ', '.join(map(str, sorted(ids)))


def read_configuration(path: str | Path | Recording) -> str | None:
    """The configuration in a bag, as YAML; None where it holds none. Its first message, in a bag of ours.

    Raises
    ------
    Sesa2Error
        the bag is not readable, or has the configurations of several arms.
    """
    with opened(path) as recording:
        path = recording.path
        name = recording.find(CONFIGURATION, STRING)
        message = next(recording.messages([name]), None) if name else None
    return deserialise(message.data, STRING).data if message else None


def read_poses(path: str | Path | Recording, topic: str) -> Poses:
    """Read one topic of geometry_msgs/PoseArray; parameters and errors as of `read_pose_topics`."""
    return read_pose_topics(path, [topic])[0]


def read_backbone(path: str | Path | Recording, topic: str, index: int) -> FloatArray:
    """Positions of one message of a nav_msgs/Path.

    Parameters
    ----------
    path
        of the recording, or the open recording.
    topic
        its name, as `Recording.find` takes it.
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
    with opened(path) as recording:
        path = recording.path
        name = recording.find(topic, PATH)
        message = next(islice(recording.messages([name]), index, None), None) if name else None
    if message is None:
        raise Sesa2Error(f'{path}: no message {index} on {name or absolute(topic)}')
    return poses.read_path(message.data).poses[:, :3]
