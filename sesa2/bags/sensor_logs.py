"""Logs of one file a sensor, merged and shown as a recording."""

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from sesa2.bags.topics import Message, RecordedTopic
from sesa2.errors import Sesa2Error
from sesa2.imu_logs import inertial_columns, trajectory_log
from sesa2.imu_logs.log_formats import log_reader, read_sensor_log
from sesa2.imu_logs.sensor_log import SensorLog
from sesa2.messages.field_messages import FIELD_TYPE, FieldMessages
from sesa2.messages.imu_messages import TYPE, ImuMessages
from sesa2.messages.topic_names import absolute, imu_data, imu_field, imu_name
from sesa2.mocap.export_file import ExportFile
from sesa2.time import NS

_HEAD = 100_000  # bytes that tell the format
_CALLED = re.compile(r'(?:.*[^a-z])?imu[_\- ]?(\d+)', re.IGNORECASE)  # a log that says whose it is
_SINCE_1970 = 1e9  # s; such clocks tell the time of day


class SensorLogs:
    """Logs of IMUs, as a part of a recording (`topics.Part`).

    Their clocks are taken to be one where at least half of the shortest log overlaps with all others: synchronised
    Xsens sensors, phones. Where they do not overlap, each is taken to begin at the same moment, and `problems` says so.
    Clocks that tell the time of day are never shifted.

    Parameters
    ----------
    logs
        by id.
    where
        the files, for messages.

    Raises
    ------
    Sesa2Error
        logs with the time of day do not overlap.
    """

    def __init__(self, logs: Mapping[int, SensorLog], where: str):
        self.problems: list[str] = [note for log in logs.values() for note in log.notes]
        self._series: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.topics: dict[str, RecordedTopic] = {}
        shifts = self._common_time(logs, where)
        for imu, log in logs.items():
            stamps = np.round((log.times + shifts[imu]) * NS).astype(np.int64)
            order = np.argsort(stamps, kind='stable')
            if (np.diff(stamps) < 0).any():
                self.problems.append(f'{where}: the log of IMU {imu} is not in order of time, and was sorted')
            self._add(imu, log, stamps, order)

    def _common_time(self, logs: Mapping[int, SensorLog], where: str) -> dict[int, float]:
        """What is added to the times of each log, s."""
        first = {imu: float(log.times.min()) for imu, log in logs.items()}
        last = {imu: float(log.times.max()) for imu, log in logs.items()}
        overlap = min(last.values()) - max(first.values())
        shortest = min(last[imu] - first[imu] for imu in logs)
        shifts = dict.fromkeys(logs, 0.0)
        if len(logs) > 1 and overlap < 0.5 * shortest:
            begins = ', '.join(f'IMU {imu} {begin:.3f} s' for imu, begin in first.items())
            if min(first.values()) > _SINCE_1970:
                raise Sesa2Error(
                    f'{where}: the logs were not made at the same time, {overlap:.1f} s of them overlap: {begins}'
                )
            begin = next(iter(first.values()))
            shifts = {imu: begin - own for imu, own in first.items()}
            self.problems.append(
                f'{where}: the clocks of the logs are not one (they begin at {begins}): '
                f'each log is taken to begin at the same moment'
            )
        earliest = min(first[imu] + shifts[imu] for imu in logs)
        if earliest < 0.0:  # a bag knows no time before 0
            whole = math.floor(-earliest) + 1
            self.problems.append(f'{where}: its time begins at {earliest:g} s: moved by {whole} s')
            shifts = {imu: shift + whole for imu, shift in shifts.items()}
        return shifts

    def _add(self, imu: int, log: SensorLog, stamps: np.ndarray, order: np.ndarray) -> None:
        parts = [log.orientations, log.angular_velocities, log.accelerations]
        there = np.all([np.isfinite(part).all(axis=1) for part in parts if part is not None], axis=0)
        rows = order[there[order]]
        missing = len(order) - len(rows)
        if missing:
            self.problems.append(f'IMU {imu}: {missing} of {len(order)} rows of its log have empty cells')
        maker = ImuMessages(imu_name(imu))
        q, gyr, acc = (None if part is None else part[rows] for part in parts)
        if gyr is None or acc is None:
            assert q is not None
            made = maker.make_many(stamps[rows], q)
        else:
            made = maker.make_raw(stamps[rows], gyr, acc, q)
        self._take(imu_data(imu), TYPE, stamps[rows], made)
        if log.fields is not None:
            rows = order[np.isfinite(log.fields).all(axis=1)[order]]
            made = FieldMessages(imu_name(imu)).make_fields(stamps[rows], log.fields[rows])
            self._take(imu_field(imu), FIELD_TYPE, stamps[rows], made)

    def _take(self, name: str, type_name: str, stamps: np.ndarray, made: np.ndarray) -> None:
        self._series[absolute(name)] = stamps, made
        self.topics[absolute(name)] = RecordedTopic(type_name, len(stamps))

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Messages of all logs in order of time; of one instant, in order of the IMUs."""
        wanted = [name for name in self._series if name in topics]
        if not wanted:
            return
        stamps = np.concatenate([self._series[name][0] for name in wanted])
        whose = np.repeat(np.arange(len(wanted)), [len(self._series[name][0]) for name in wanted])
        row = np.concatenate([np.arange(len(self._series[name][0])) for name in wanted])
        for k in np.argsort(stamps, kind='stable').tolist():
            name = wanted[whose[k]]
            yield Message(
                name, self.topics[name].type, int(stamps[k]), self._series[name][1][row[k]].tobytes()
            )

    def close(self) -> None:
        """Nothing is open."""


def open_sensor_logs(files: Mapping[int, Path]) -> SensorLogs:
    """Read the log of each IMU.

    Raises
    ------
    Sesa2Error
        one cannot be read, or they were not made at the same time.
    """
    return SensorLogs(
        {imu: read_sensor_log(path) for imu, path in files.items()}, listed_files(files.values())
    )


def open_inertial_columns(path: Path) -> SensorLogs | None:
    """A file of all IMUs with angular velocities and accelerations; None where it is none.

    Raises
    ------
    Sesa2Error
        it is one, and not whole; or it is the log of one sensor.
    """
    head = _head(path)
    if (reader := log_reader(head)) and reader is not trajectory_log:  # which may be named after its IMU
        raise Sesa2Error(
            f'{path} is the log of one sensor ({reader.KIND}): give the log of each IMU, '
            f'in the order of imus.ids or as ID=FILE'
        )
    if not inertial_columns.matches(head):
        return None
    return SensorLogs(inertial_columns.read(ExportFile.load(path)), path.name)


def assign_logs(arguments: Sequence[str], ids: Sequence[int]) -> Path | dict[int, Path]:
    """Whose log each file is.

    Parameters
    ----------
    arguments
        a recording; or logs in the order of the ids, or as ID=FILE.
    ids
        of the IMUs along the arm, base to tip, then that on the base if there is one.

    Returns
    -------
    The recording, or the file of each IMU.

    Raises
    ------
    Sesa2Error
        a file too few or too many, or an ID that is not there or there twice.
    """
    given: dict[int, Path] = {}
    plain: list[Path] = []
    for text in arguments:
        number, equals, name = text.partition('=')
        if not equals or not number.strip().isdecimal() or Path(text).exists():
            plain.append(Path(text))
            continue
        if int(number) not in ids:
            raise Sesa2Error(f'{text}: no IMU {number}, expected one of {_ids(ids)}')
        if int(number) in given:
            raise Sesa2Error(f'{text}: IMU {number} has a log already, {given[int(number)]}')
        given[int(number)] = Path(name)
    if len(plain) == 1 and not given and not _is_log(plain[0]):
        return plain[0]
    if plain and given:
        raise Sesa2Error(f'{plain[0]}: of which IMU? Expected ID=FILE for all logs, or for none')
    if plain:
        if len(plain) != len(ids):
            kind = f'are {len(plain)} logs of one sensor each'
            if len(plain) == 1:
                log = read_sensor_log(plain[0])
                kind = f'is the log of one sensor ({log.kind})'
                if log.orientations is None:
                    kind += ' without orientations, which imus.fusion: 6d makes of it'
            raise Sesa2Error(
                f'{listed_files(plain)} {kind}; the configuration has {len(ids)} IMUs: give the log of each '
                f'in the order {_ids(ids)}, or name those that there are as ID=FILE'
            )
        given = dict(zip(ids, plain, strict=True))
        for imu, path in given.items():
            if (called := _CALLED.fullmatch(path.stem)) and int(called[1]) in ids and int(called[1]) != imu:
                raise Sesa2Error(
                    f'{path} comes in the place of IMU {imu} in the order {_ids(ids)}: give all as ID=FILE'
                )
    twice = [path for path in given.values() if list(given.values()).count(path) > 1]
    if twice:
        raise Sesa2Error(f'{twice[0]}: given for several IMUs')
    return given


def listed_files(paths: Collection[Path]) -> str:
    """Files for a message; with their folders where some have one name."""
    alike = len({path.name for path in paths}) < len(paths)
    return ', '.join(f'{path.parent.name}/{path.name}' if alike else path.name for path in paths)


def _ids(ids: Sequence[int]) -> str:
    return ', '.join(map(str, ids))


def _is_log(path: Path) -> bool:
    return (
        path.is_file()
        and path.suffix not in ('.mcap', '.db3', '.bag')
        and log_reader(_head(path)) is not None
    )


def _head(path: Path) -> ExportFile:
    try:
        with path.open('rb') as file:
            return ExportFile(path, file.read(_HEAD))
    except OSError as error:
        raise Sesa2Error(f'{path}: cannot be read: {error.strerror or error}') from None
