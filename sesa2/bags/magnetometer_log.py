"""What magnetometers read, one by one, for their calibration: from a bag or from a CSV.

A CSV has a column of time and, of each magnetometer, magnetometer_<id>_x, _y, _z, or magnetometer_<id> alone of one
that measures along its z; tesla, or with a unit behind the name: [mT], [uT], [nT], [G].
"""

import re
from collections import defaultdict
from collections.abc import Collection, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sesa2.bags.recording import open_recording
from sesa2.errors import Sesa2Error
from sesa2.messages.field_messages import FIELD_TYPE, read_field
from sesa2.mocap.export_file import ExportFile
from sesa2.mocap.named_columns import find_header
from sesa2.mocap.number_table import read_numbers
from sesa2.mocap.time_units import TIME_COLUMN, TIME_UNITS, in_seconds
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

_BAGS = ('.mcap', '.db3', '.bag')
_TOPIC = re.compile(r'(.*/)magnetometer_([1-9][0-9]*)/field')
_COLUMN = re.compile(
    r'magnetometer_([1-9][0-9]*)(?:[_. ]([xyz]))?\s*(?:[_ ]?[(\[]?\s*(T|mT|uT|µT|nT|G)\s*[)\]]?)?'
)
_TESLA = {None: 1.0, 'T': 1.0, 'mT': 1e-3, 'uT': 1e-6, 'µT': 1e-6, 'nT': 1e-9, 'G': 1e-4}
_BLOCK = 4096  # messages
_GAP = 3.0  # usual steps from one reading to the next
EXPECTED = (
    f'expected topics magnetometer_<id>/field of {FIELD_TYPE}, or a CSV with columns time_s and, of each, '
    'magnetometer_<id>_x, _y, _z (T), or magnetometer_<id> where it measures along z alone'
)


class MagnetometerLog(NamedTuple):
    """What magnetometers read.

    Attributes
    ----------
    times
        by id: (n,), s, increasing; of a bag the stamps.
    fields
        by id: (n, 3), T, in the sensor's axes; NaN on axes that are not there.
    problems
        what was not as it should be, for people.
    """

    times: dict[int, FloatArray]
    fields: dict[int, FloatArray]
    problems: tuple[str, ...]

    @property
    def start(self) -> float:
        """Of the first reading, s."""
        return float(min(t[0] for t in self.times.values()))

    def part(self, begin: float, duration: float) -> 'MagnetometerLog':
        """From a time, s from the first reading, on, and so long.

        Raises
        ------
        Sesa2Error
            nothing was read then.
        """
        low = self.start + begin
        which = {i: (t >= low) & (t < low + duration) for i, t in self.times.items()}
        some = [i for i, own in which.items() if own.any()]
        if not some:
            last = max(t[-1] for t in self.times.values()) - self.start
            raise Sesa2Error(f'no reading from {begin:g} s on; there are {last:.1f} s of them')
        return self._replace(
            times={i: self.times[i][which[i]] for i in some},
            fields={i: self.fields[i][which[i]] for i in some},
        )

    def at(self, times: FloatArray, ids: Sequence[int]) -> FloatArray:
        """Fields at other times, interpolated, (n, n_ids, 3), T; NaN beyond a sensor's readings and in its gaps."""
        out = np.full((len(times), len(ids), 3), np.nan)
        for k, sensor in enumerate(ids):
            t = self.times.get(sensor)
            if t is None or len(t) < 2:
                continue
            after = np.clip(np.searchsorted(t, times, side='right'), 1, len(t) - 1)
            step = t[after] - t[after - 1]
            weight = ((times - t[after - 1]) / step)[:, None]
            near = (times >= t[0]) & (times <= t[-1]) & (step <= _GAP * np.median(np.diff(t)))
            between = (1.0 - weight) * self.fields[sensor][after - 1] + weight * self.fields[sensor][after]
            out[near, k] = between[near]
        return out


def read_magnetometers(path: str | Path, ids: Collection[int]) -> MagnetometerLog:
    """Read those of these ids.

    Raises
    ------
    Sesa2Error
        the file cannot be read, holds those of several arms, or none of these.
    """
    path = Path(path)
    is_bag = path.is_dir() or path.suffix.lower() in _BAGS
    times, fields, problems = _of_bag(path) if is_bag else _of_columns(path)
    if not set(times) & set(ids):
        there = f'it has those of {", ".join(map(str, sorted(times)))}' if times else EXPECTED
        raise Sesa2Error(f'{path}: no reading of the magnetometers {", ".join(map(str, ids))}; {there}')
    problems += [
        f'magnetometer {i}: not in magnetometers.ids, not used' for i in sorted(set(times) - set(ids))
    ]
    problems += [f'magnetometer {i}: no reading' for i in sorted(set(ids) - set(times))]
    kept_times, kept_fields = {}, {}
    for i in sorted(set(times) & set(ids)):
        t, first = np.unique(times[i], return_index=True)
        if len(t) < len(times[i]):
            problems.append(
                f'magnetometer {i}: {len(times[i]) - len(t)} readings with the time of another left out'
            )
        kept_times[i], kept_fields[i] = t, fields[i][first]
    return MagnetometerLog(kept_times, kept_fields, tuple(problems))


_Read = tuple[dict[int, FloatArray], dict[int, FloatArray], list[str]]


def _of_bag(path: Path) -> _Read:
    stamps: defaultdict[int, list[np.ndarray]] = defaultdict(list)
    fields: defaultdict[int, list[FloatArray]] = defaultdict(list)
    damaged: defaultdict[int, int] = defaultdict(int)
    with open_recording(path) as recording:
        found = {
            name: match
            for name, topic in recording.topics.items()
            if topic.type == FIELD_TYPE and topic.count and (match := _TOPIC.fullmatch(name))
        }
        arms = sorted({match[1] for match in found.values()})
        if len(arms) > 1:
            raise Sesa2Error(
                f'{path}: magnetometers in the namespaces {" and ".join(arms)}, expected those of one arm'
            )
        messages = recording.messages(found) if found else iter(())
        while block := list(islice(messages, _BLOCK)):
            rows: defaultdict[int, list[tuple[int, FloatArray]]] = defaultdict(list)
            for message in block:
                sensor = int(found[message.topic][2])
                try:
                    stamp, field = read_field(message.data)
                except Sesa2Error:
                    damaged[sensor] += 1
                    continue
                rows[sensor].append((stamp or message.log_ns, field))
            for sensor, own in rows.items():
                stamps[sensor].append(np.array([stamp for stamp, _ in own], dtype=np.int64))
                fields[sensor].append(np.array([field for _, field in own]))
        problems = list(recording.problems)
    problems += [f'magnetometer {i}: {n} messages not used: damaged' for i, n in sorted(damaged.items())]
    times = {i: np.concatenate(own) / NS for i, own in stamps.items()}
    return times, {i: np.concatenate(own) for i, own in fields.items()}, problems


def _of_columns(path: Path) -> _Read:
    file = ExportFile.load(path)
    line, header, delimiter = find_header(file)
    clock = [(k, match) for k, cell in enumerate(header) if (match := TIME_COLUMN.fullmatch(cell))]
    columns = [(k, match) for k, cell in enumerate(header) if (match := _COLUMN.fullmatch(cell))]
    if len(clock) != 1 or not columns:
        raise Sesa2Error(
            f'{path}: {len(clock)} columns of time and {len(columns)} of magnetometers; {EXPECTED}'
        )
    which = [clock[0][0], *(k for k, _ in columns)]
    table = read_numbers(
        file.data,
        file.after(line + 1),
        which,
        delimiter=delimiter,
        names=[header[k] for k in which],
        where=file.name,
        first_line=line + 2,
        width=len(header),
    )
    unit, notes = clock[0][1][1], list(table.notes)
    times = table.rows[:, 0] * TIME_UNITS[unit] if unit and unit in TIME_UNITS else table.rows[:, 0]
    if unit in (None, 's'):
        times, said = in_seconds(times, header[which[0]], file.name)
        notes += said
    fields: dict[int, FloatArray] = {}
    for k, (column, match) in enumerate(columns):
        own = fields.setdefault(int(match[1]), np.full((len(times), 3), np.nan))
        axis = 'xyz'.index(match[2] or 'z')
        if np.isfinite(own[:, axis]).any():
            raise Sesa2Error(f'{path}: {header[column]} is there a second time')
        own[:, axis] = _TESLA[match[3]] * table.rows[:, 1 + k]
    there = {i: np.isfinite(own).any(axis=1) & np.isfinite(times) for i, own in fields.items()}
    some = [i for i, has in there.items() if has.any()]
    return {i: times[there[i]] for i in some}, {i: fields[i][there[i]] for i in some}, notes
