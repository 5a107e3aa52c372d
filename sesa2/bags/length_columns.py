"""Lengths in the columns of a CSV beside the IMUs, shown as messages."""

import math
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

import numpy as np

from sesa2.bags.recording import Recording
from sesa2.bags.topics import Message, RecordedTopic
from sesa2.errors import Sesa2Error
from sesa2.messages.length_messages import LENGTHS_TYPE, LengthMessages
from sesa2.messages.topic_names import BACKBONE_LENGTHS, absolute
from sesa2.mocap.export_file import ExportFile
from sesa2.mocap.named_columns import read_scalars
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

_BAGS = ('.mcap', '.db3', '.bag')


class LengthColumns:
    """Columns of lengths, as a part of a recording (`topics.Part`): a message a row, of the cells that are not empty.

    Parameters
    ----------
    times : (n,)
        s. A bag knows no time before 0: earlier ones are moved by whole seconds, as `CapturedImus` moves them.
    lengths
        of each backbone, (n,), m, NaN where there is none.
    """

    def __init__(self, times: FloatArray, lengths: dict[str, FloatArray]):
        self.problems: list[str] = []
        first = float(times.min()) if len(times) else 0.0
        shift = math.floor(-first) + 1 if first < 0.0 else 0
        stamps = np.round((times + shift) * NS).astype(np.int64)
        names, values = list(lengths), np.stack(list(lengths.values()), axis=-1)
        there = ~np.isnan(values)
        rows: list[tuple[int, bytes]] = []
        for own in np.unique(there[there.any(axis=1)], axis=0):
            which = np.flatnonzero((there == own).all(axis=1))
            made = LengthMessages([name for name, has in zip(names, own, strict=True) if has])
            messages = made.make_lengths(stamps[which], values[which][:, own])
            rows += zip(stamps[which].tolist(), map(np.ndarray.tobytes, messages), strict=True)
        self._rows = sorted(rows, key=lambda row: row[0])
        self._topic = absolute(BACKBONE_LENGTHS)
        self.topics = {self._topic: RecordedTopic(LENGTHS_TYPE, len(self._rows))}

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Its lengths as sensor_msgs/JointState."""
        if self._topic in topics:
            for stamp_ns, data in self._rows:
                yield Message(self._topic, LENGTHS_TYPE, stamp_ns, data)

    def close(self) -> None:
        """Nothing is open."""


def add_length_columns(recording: Recording, names: Sequence[str]) -> None:
    """Show columns of a CSV that are called as backbones are, where it is one and has some.

    Raises
    ------
    Sesa2Error
        not all of them are there, or a field is not a number.
    """
    path = recording.path
    if absolute(BACKBONE_LENGTHS) in recording.topics or not _may_have_columns(path):
        return
    times, lengths, cells = read_scalars(ExportFile.load(path), names)
    absent = [name for name in names if name not in lengths]
    if lengths and absent:
        raise Sesa2Error(
            f'{path}: no column {absent[0]}, but {next(iter(lengths))}; expected the length of each backbone, '
            f'{", ".join(names)}, in m'
        )
    if lengths:
        recording.add(LengthColumns(times, lengths), cells)


def _may_have_columns(path: Path) -> bool:
    return path.is_file() and path.suffix not in _BAGS
