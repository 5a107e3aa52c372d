"""Poses of a recording over time, topic by topic."""

from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sesa2.bags.definitions import POSE_ARRAY, deserialise
from sesa2.bags.recording import Recording, opened
from sesa2.bags.topics import Message
from sesa2.errors import Sesa2Error
from sesa2.messages import poses
from sesa2.messages.topic_names import absolute
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

_BLOCK = 4096  # messages that are worked on at once


class Poses(NamedTuple):
    """Poses over time, as a PoseArray carries them.

    Attributes
    ----------
    times_s : (n,)
        stamps of the messages, or when they were recorded where they have none, s.
    positions : (n, m, 3)
        m.
    frame
        in which they are.
    orientations : (n, m, 4)
        x y z w.
    """

    times_s: FloatArray
    positions: FloatArray
    frame: str
    orientations: FloatArray


def read_pose_topics(path: str | Path | Recording, topics: Sequence[str]) -> list[Poses]:
    """Read topics of geometry_msgs/PoseArray.

    Parameters
    ----------
    path
        of the recording, or the open recording.
    topics
        their names, as `Recording.find` takes them.

    Raises
    ------
    Sesa2Error
        the recording is not readable, has no such topic or several, or its messages have different numbers of poses.
    """
    with opened(path) as recording:
        path = recording.path
        names = [_pose_array(recording, topic) for topic in topics]
        read = {name: _ReadPoses(f'{path}: message {{}} of {name}') for name in names}
        messages = recording.messages(read)
        while part := list(islice(messages, _BLOCK)):
            for name, one in read.items():
                one.add([message for message in part if message.topic == name])
    return [read[name].together(f'{path}: no message on {name}') for name in names]


def _pose_array(recording: Recording, topic: str) -> str:
    found = recording.find(topic, POSE_ARRAY)
    if not found:
        name = absolute(topic)
        there = recording.topics.get(name)
        got = f'it is of {there.type}' if there else 'there is none'
        arrays = ', '.join(n for n, t in recording.topics.items() if t.type == POSE_ARRAY)
        raise Sesa2Error(
            f'{recording.path}: expected a topic {name} of {POSE_ARRAY}, {got}; of this type are: {arrays or "none"}'
        )
    return found


class _ReadPoses:
    """One topic, block by block."""

    def __init__(self, what: str):
        self._what, self._n, self._frame = what, 0, ''
        self._stamps: list[np.ndarray] = []
        self._poses: list[FloatArray] = []

    def add(self, messages: list[Message]) -> None:
        if not messages:
            return
        data = [message.data for message in messages]
        try:
            if not self._n:
                self._frame = deserialise(data[0], POSE_ARRAY).header.frame_id
            stamps, arrays = poses.read_pose_arrays(data)
        except Exception:  # cut bytes make a parser stumble in any way
            self._refuse(data)
            raise
        if self._poses and arrays.shape[1] != self._poses[0].shape[1]:
            self._refuse(data)
        logged = np.fromiter((message.log_ns for message in messages), np.int64, len(messages))
        self._stamps.append(np.where(stamps == 0, logged, stamps))
        self._poses.append(arrays)
        self._n += len(data)

    def _refuse(self, data: list[bytes]) -> None:
        """Raise what is wrong with the first message that is."""
        expected = self._poses[0].shape[1] if self._poses else None
        for k, message in enumerate(data, start=self._n):
            try:
                if k == 0:
                    deserialise(message, POSE_ARRAY)
                n = len(poses.read_pose_array(message).poses)
            except Exception:
                raise Sesa2Error(f'{self._what.format(k)} is no {POSE_ARRAY}') from None
            expected = n if expected is None else expected
            if n != expected:
                raise Sesa2Error(f'{self._what.format(k)} has {n} poses, the first one {expected}')

    def together(self, nothing: str) -> Poses:
        if not self._n:
            raise Sesa2Error(nothing)
        all_poses = np.concatenate(self._poses)
        return Poses(np.concatenate(self._stamps) / NS, all_poses[..., :3], self._frame, all_poses[..., 3:])
