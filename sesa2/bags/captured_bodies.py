"""Motion capture out of bags: whatever topics the drivers of motion capture systems publish poses on."""

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from sesa2.bags.captured_imus import CapturedImus
from sesa2.bags.recording import Recording, open_recording
from sesa2.bags.topics import RecordedTopic
from sesa2.errors import Sesa2Error
from sesa2.messages.topic_names import absolute, is_called
from sesa2.mocap.capture import MotionCapture, TrackedBody
from sesa2.time import NS

# Ends of topics that say what is published, not of whom.
_OF_NOBODY = {
    'pose',
    'poses',
    'odom',
    'odometry',
    'transform',
    'position',
    'pose_stamped',
    'point',
    'data',
    'state',
}


class _Seen(NamedTuple):
    """A body at one instant: its name, empty where its topic names it; stamp, ns; frame; position and orientation."""

    name: str
    stamp_ns: int
    frame: str
    pose: tuple[float, ...]


def read_bodies(path: str | Path, topic: str | None = None) -> MotionCapture:
    """Read the bodies and markers in a bag.

    A body is called as its topic is (`/vrpn_mocap/M1/pose`: M1; the whole topic where that is not unique), as its frame
    in tf, as its message says, or `topic[k]` in a PoseArray.

    Parameters
    ----------
    path
        of the recording.
    topic
        to read; all that carry poses where it is None.

    Raises
    ------
    Sesa2Error
        the recording is not readable, or has no such topic.
    """
    with open_recording(path) as recording:
        return _bodies_in(recording, topic)


def add_captured_imus(recording: Recording) -> None:
    """Show bodies of a recording that are called `imu_<id>` as IMUs, where there are some with orientations."""
    try:
        part = CapturedImus(recording.path, _bodies_in(recording))
    except Sesa2Error:
        return
    recording.add(part)


def _bodies_in(recording: Recording, topic: str | None = None) -> MotionCapture:
    path = recording.path
    readers = {
        name: reader
        for name, of in recording.topics.items()
        if (topic is None or is_called(name, topic)) and of.count and (reader := _reader_of(of))
    }
    if not readers:
        asked = f'expected a topic {absolute(topic)}' if topic else 'expected one'
        raise Sesa2Error(f'{path}: {asked} with poses of markers; its topics: {_described(recording)}')
    names = _names(list(readers))
    seen: dict[str, list[_Seen]] = {}
    lengths: dict[str, set[int]] = {}  # of the arrays on a topic
    unreadable = 0
    for message in recording.messages(readers):
        try:
            bodies_here = list(readers[message.topic](message.data))
            if recording.topics[message.topic].type == _POSE_ARRAY:
                lengths.setdefault(message.topic, set()).add(len(bodies_here))
            for body in bodies_here:
                name = body.name or names[message.topic]
                if name.startswith('['):  # a place in an array
                    name = message.topic + name
                stamped = body if body.stamp_ns else body._replace(stamp_ns=message.log_ns)
                seen.setdefault(name, []).append(stamped)
        except Exception:  # cut bytes make a parser stumble in any way
            unreadable += 1
    notes = list(recording.problems)
    if unreadable:
        notes.append(f'{path}: {unreadable} messages not used: damaged')
    notes += [
        f'{path}: {topic} has {min(n)} to {max(n)} poses a message, and nothing says which are missing: a place in it '
        'may be now one body, now another'
        for topic, n in lengths.items()
        if len(n) > 1
    ]
    bodies = {}
    for name, samples in seen.items():
        poses = np.array([s.pose for s in samples])
        times = np.array([s.stamp_ns for s in samples]) / NS
        orientations = poses[:, 3:] if poses.shape[1] > 3 else None
        bodies[name] = TrackedBody(times, poses[:, :3], orientations, samples[0].frame)
    if not bodies:
        raise Sesa2Error(f'{path}: no message with a pose on {", ".join(readers)}')
    return MotionCapture('bag', bodies, notes=tuple(notes))


def _described(recording: Recording) -> str:
    return ', '.join(f'{name} ({of.type}, {of.count})' for name, of in recording.topics.items()) or 'none'


def _names(topics: list[str]) -> dict[str, str]:
    """What the body of each topic is called."""
    short = {}
    for topic in topics:
        parts = [part for part in topic.split('/') if part]
        short[topic] = next((part for part in reversed(parts) if part.lower() not in _OF_NOBODY), parts[-1])
    unique = {topic: list(short.values()).count(name) == 1 for topic, name in short.items()}
    return {topic: name if unique[topic] else topic for topic, name in short.items()}


class _Cdr:
    """Little-endian CDR, read from front to back."""

    def __init__(self, data: bytes):
        self._data, self._at = data, 4

    def numbers(self, code: str, n: int, size: int) -> tuple[Any, ...]:
        self._at += (4 - self._at) % size
        values = struct.unpack_from(f'<{n}{code}', self._data, self._at)
        self._at += n * size
        return values

    def text(self) -> str:
        (length,) = self.numbers('I', 1, 4)
        end = self._at + length
        text = self._data[self._at : end - 1].decode()
        self._at = end
        return text

    def header(self) -> tuple[int, str]:
        seconds, nanoseconds = self.numbers('i', 2, 4)
        return seconds * NS + nanoseconds, self.text()


def _pose(data: bytes) -> Iterator[_Seen]:
    """PoseStamped, and PoseWithCovarianceStamped, which goes on."""
    cdr = _Cdr(data)
    yield _Seen('', *cdr.header(), cdr.numbers('d', 7, 8))


def _point(data: bytes) -> Iterator[_Seen]:
    cdr = _Cdr(data)
    yield _Seen('', *cdr.header(), cdr.numbers('d', 3, 8))


def _odometry(data: bytes) -> Iterator[_Seen]:
    cdr = _Cdr(data)
    header = cdr.header()
    cdr.text()  # the body's own frame
    yield _Seen('', *header, cdr.numbers('d', 7, 8))


def _transform(data: bytes) -> Iterator[_Seen]:
    cdr = _Cdr(data)
    header = cdr.header()
    yield _Seen(cdr.text(), *header, cdr.numbers('d', 7, 8))


def _tf(data: bytes) -> Iterator[_Seen]:
    cdr = _Cdr(data)
    for _ in range(cdr.numbers('I', 1, 4)[0]):
        header = cdr.header()
        yield _Seen(cdr.text(), *header, cdr.numbers('d', 7, 8))


def _array(data: bytes) -> Iterator[_Seen]:
    cdr = _Cdr(data)
    header = cdr.header()
    for k in range(cdr.numbers('I', 1, 4)[0]):
        yield _Seen(f'[{k}]', *header, cdr.numbers('d', 7, 8))


# How drivers call a body's name, and where it is.
_NAMES = ('name', 'rigid_body_name', 'marker_name', 'body_name', 'subject_name', 'segment_name')
_PLACES = ('pose', 'position', 'translation')

_POSE_ARRAY = 'geometry_msgs/msg/PoseArray'
_READERS: dict[str, Callable[[bytes], Iterator[_Seen]]] = {
    'geometry_msgs/msg/PoseStamped': _pose,
    'geometry_msgs/msg/PoseWithCovarianceStamped': _pose,
    'geometry_msgs/msg/PointStamped': _point,
    'geometry_msgs/msg/TransformStamped': _transform,
    _POSE_ARRAY: _array,
    'nav_msgs/msg/Odometry': _odometry,
    'tf2_msgs/msg/TFMessage': _tf,
}


def _reader_of(topic: RecordedTopic) -> Callable[[bytes], Iterator[_Seen]] | None:
    return _READERS.get(topic.type) or _named_bodies(topic)


def _named_bodies(topic: RecordedTopic) -> Callable[[bytes], Iterator[_Seen]] | None:
    """For a type that the bag explains: a list of things with a name and a pose or a position.

    That is what drivers have of their own: mocap4r2_msgs/RigidBodies and Markers, NamedPoseArray, and others.
    """
    if not topic.definition or 'string' not in topic.definition:
        return None
    store = get_typestore(Stores.ROS2_JAZZY)
    try:
        types = get_types_from_msg(topic.definition, topic.type)
        store.register({name: of for name, of in types.items() if name not in store.types})
        fields = dict(store.fielddefs[topic.type][1])
        lists = [name for name, of in fields.items() if _names_and_places(store, of)]
    except Exception:  # a definition in a dialect that rosbags does not parse
        return None
    if not lists or 'header' not in fields:
        return None

    def read(data: bytes) -> Iterator[_Seen]:
        message: Any = store.deserialize_cdr(data, topic.type)
        stamp, frame = message.header.stamp, message.header.frame_id
        for item in getattr(message, lists[0]):
            name = next(str(getattr(item, n)) for n in _NAMES if hasattr(item, n))
            place = next(getattr(item, n) for n in _PLACES if hasattr(item, n))
            point = getattr(place, 'position', place)
            pose: tuple[float, ...] = (point.x, point.y, point.z)
            if hasattr(place, 'orientation'):
                q = place.orientation
                pose += (q.x, q.y, q.z, q.w)
            yield _Seen(name, stamp.sec * NS + stamp.nanosec, frame, pose)

    return read


def _names_and_places(store: Typestore, field: Any) -> bool:
    """Whether a field is a list of things with a name and a place."""
    kind, of = field
    if kind not in (Nodetype.SEQUENCE, Nodetype.ARRAY) or of[0][0] is not Nodetype.NAME:
        return False
    inside = {name for name, _ in store.fielddefs[of[0][1]][1]}
    return bool(inside & set(_NAMES)) and bool(inside & set(_PLACES))
