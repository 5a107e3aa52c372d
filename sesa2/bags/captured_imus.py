"""Orientations of captured bodies, shown as a recording: other IMUs, or motion capture in place of perfect ones."""

import math
import re
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from sesa2.bags.topics import Message, RecordedTopic
from sesa2.errors import Sesa2Error
from sesa2.messages.imu_messages import TYPE, ImuMessages
from sesa2.messages.topic_names import absolute, imu_data, imu_name
from sesa2.mocap.body_names import listed
from sesa2.mocap.capture import MotionCapture
from sesa2.mocap.named_columns import EXPECTED
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

_WHAT = 'q|quat|quaternion|rot|rotation|orientation'  # of the IMU
_IMU = re.compile(rf'(?:.*[:/])?imu[_\- ]?(\d+)(?:[_. \-](?:{_WHAT}))?', re.IGNORECASE)
_BLOCK = 4096  # messages made at once


class CapturedImus:
    """The bodies called `imu_<id>`, as a part of a recording (`topics.Part`).

    A prefix (`Arm:imu_2`), ways of writing it (`IMU 2`) and what of it is meant (`imu_2_orientation`) do no harm. Where
    a body was not seen, the IMU has not measured. A bag knows no time before 0: earlier recordings are moved by whole
    seconds, and say so.

    Parameters
    ----------
    path
        where the recording is, for messages.
    capture
        the recording.

    Raises
    ------
    Sesa2Error
        no body is called so, two are the same IMU, or one has no orientation.
    """

    def __init__(self, path: Path, capture: MotionCapture):
        self.problems = [*capture.notes, *_about_axes(capture)]
        self._series: dict[str, tuple[np.ndarray, FloatArray]] = {}
        bodies: dict[int, str] = {}
        for body in capture.bodies:
            match = _IMU.fullmatch(body)
            if not match:
                continue
            if int(match[1]) in bodies:
                raise Sesa2Error(f'{path}: {bodies[int(match[1])]} and {body} are both IMU {match[1]}')
            bodies[int(match[1])] = body
        if not bodies:
            raise Sesa2Error(
                f'{path}: no body is an IMU, expected names imu_<id>; there are {listed(capture.bodies)}: '
                f'rename in the file those that are IMUs. {EXPECTED}'
            )
        first = min(float(np.min(capture.bodies[body].times)) for body in bodies.values())
        shift = math.floor(-first) + 1 if first < 0.0 else 0
        if shift:
            self.problems.append(
                f'{path}: its time begins at {first:g} s, and a bag knows none before 0: moved by {shift} s'
            )
        for imu, body in sorted(bodies.items()):
            captured = capture.bodies[body]
            if captured.orientations is None:
                why = '; '.join(['', *capture.notes])
                raise Sesa2Error(
                    f'{path}: {body} has no orientation, expected a quaternion of every IMU{why}'
                )
            measured = np.isfinite(captured.orientations).all(axis=1)
            stamps = np.round((captured.times[measured] + shift) * NS).astype(np.int64)
            order = np.argsort(stamps, kind='stable')
            self._series[absolute(imu_data(imu))] = stamps[order], captured.orientations[measured][order]
        self.topics = {name: RecordedTopic(TYPE, len(stamps)) for name, (stamps, _) in self._series.items()}

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Its orientations as sensor_msgs/Imu."""
        wanted = [(name, *self._series[name]) for name in self._series if name in topics]
        if not wanted:
            return
        # All samples in order of time; of one instant, in order of the IMUs.
        stamps = np.concatenate([s for _, s, _ in wanted])
        whose = np.repeat(np.arange(len(wanted)), [len(s) for _, s, _ in wanted])
        row = np.concatenate([np.arange(len(s)) for _, s, _ in wanted])
        order = np.argsort(stamps, kind='stable')
        makers = [ImuMessages(imu_name(int(name.split('_')[-1].split('/')[0]))) for name, _, _ in wanted]
        for begin in range(0, len(order), _BLOCK):
            block = order[begin : begin + _BLOCK]
            made = {}
            for k in np.unique(whose[block]).tolist():
                rows = row[block[whose[block] == k]]
                made[k] = iter(makers[k].make_many(wanted[k][1][rows], wanted[k][2][rows]))
            for k, stamp in zip(whose[block].tolist(), stamps[block].tolist(), strict=True):
                yield Message(wanted[k][0], TYPE, stamp, next(made[k]).tobytes())

    def close(self) -> None:
        """Nothing is open."""


def _about_axes(capture: MotionCapture) -> list[str]:
    return [f'{capture.axes}; arm.base_orientation is to be given in its axes'] if capture.axes else []
