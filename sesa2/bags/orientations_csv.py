"""Orientations from a CSV file, shown as a recording: other IMUs, or motion capture in place of perfect ones."""

import csv
import math
import re
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from sesa2.bags.topics import Message, RecordedTopic
from sesa2.errors import Sesa2Error
from sesa2.messages.imu_messages import TYPE, ImuMessages
from sesa2.messages.topic_names import absolute, imu_data
from sesa2.time import NS

_TIME = 'time_s'


class OrientationsCsv:
    """A CSV file, as a part of a recording (`topics.Part`).

    The first line names the columns: `time_s`, then `imu_<id>_x`, `_y`, `_z`, `_w` for every IMU: q_WS, in any order;
    other columns are ignored. Where one of the four is empty or `nan`, the IMU has not measured.

    Parameters
    ----------
    path
        the file, UTF-8, separated by commas.

    Raises
    ------
    Sesa2Error
        a column is missing, or a field is not a number (with its line).
    """

    def __init__(self, path: Path):
        self.problems: list[str] = []
        try:
            with path.open(newline='', encoding='utf-8-sig') as file:
                lines = csv.reader(file)
                header = [cell.strip() for cell in next(lines, [])]
                columns = _columns(header, path)
                table = [
                    _row(cells, header, columns, f'{path}, line {lines.line_num}') for cells in lines if cells
                ]
        except (UnicodeDecodeError, csv.Error) as error:
            raise Sesa2Error(f'{path}: is not a CSV text file: {error}') from None
        rows = np.array(table, dtype=float).reshape(len(table), len(columns))
        self._stamps = np.round(rows[:, 0] * NS).astype(np.int64)
        quaternions = rows[:, 1:].reshape(len(rows), -1, 4)
        self._measured = {absolute(imu_data(i)): quaternions[:, k] for k, i in enumerate(_ids(header))}
        self.topics = {
            name: RecordedTopic(TYPE, int(np.isfinite(q).all(axis=-1).sum()))
            for name, q in self._measured.items()
        }

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Its orientations as sensor_msgs/Imu."""
        wanted = [
            (name, ImuMessages(name.split('/')[1]), q) for name, q in self._measured.items() if name in topics
        ]
        for row in np.argsort(self._stamps, kind='stable').tolist():
            stamp_ns = int(self._stamps[row])
            for name, maker, q in wanted:
                if np.isfinite(q[row]).all():
                    yield Message(name, TYPE, stamp_ns, maker.make(stamp_ns, q[row]))

    def close(self) -> None:
        """Nothing is open."""


def _imu_of(column: str) -> int | None:
    match = re.fullmatch(r'imu_(\d+)_[xyzw]', column)
    return int(match[1]) if match else None


def _ids(header: list[str]) -> list[int]:
    return sorted({i for cell in header if (i := _imu_of(cell)) is not None})


def _columns(header: list[str], path: Path) -> list[int]:
    """Indices of the time and of every IMU's x, y, z, w."""
    ids = _ids(header)
    wanted = [_TIME, *(f'imu_{i}_{axis}' for i in ids for axis in 'xyzw')]
    if not ids or any(header.count(column) != 1 for column in wanted):
        lacking = [column for column in wanted if header.count(column) != 1]
        raise Sesa2Error(
            f'{path}: expected the columns {_TIME} and imu_<id>_x, …_y, …_z, …_w of each IMU, once each; '
            f'wrong: {", ".join(lacking) or "no IMU has any"}'
        )
    return [header.index(column) for column in wanted]


def _row(cells: list[str], header: list[str], columns: list[int], where: str) -> list[float]:
    values: list[float] = []
    for column in columns:
        text = cells[column].strip() if column < len(cells) else ''
        try:
            value = float(text) if text else math.nan
        except ValueError:
            value = math.inf
        if math.isinf(value) or (math.isnan(value) and not values):
            raise Sesa2Error(f'{where}: {header[column]} is {text!r}, expected a number')
        values.append(value)
    return values
