"""A CSV whose columns say what they hold: time_s, then NAME_x, NAME_y, NAME_z of each marker.

Comments after # may stand above, and the columns in the last of them, as numpy's savetxt writes them; below them may
stand a line of units. Between the cells are commas, semicolons, tabs or blanks.
A column of time is `time_s` (or `time`, `timestamp`, `t`, `Zeit` and the like), or says its unit: `time_ms`, `time_us`,
`time_ns`; or it is `frame`, with the rate of the frames given. Between a name and its axis may stand `_`, `.`, `-`, `:`
or a blank; a unit may follow, as in `M1_x [mm]`. A body with NAME_qx, NAME_qy, NAME_qz, NAME_qw, or with NAME_x, _y, _z
and _w, has an orientation (the latter no position). Other columns are told as not used; angles are none that could be,
since nothing says in which order and about which axes they turn.
"""

import difflib
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sesa2.errors import shown
from sesa2.mocap.body_names import listed
from sesa2.mocap.capture import LENGTH_UNITS, MocapError, MotionCapture, TrackedBody, metres_in
from sesa2.mocap.export_file import ExportFile, delimiter_of
from sesa2.mocap.number_table import NumberTable, read_numbers
from sesa2.mocap.time_units import TIME_COLUMN, TIME_UNITS, in_seconds
from sesa2.shape.rotations import FloatArray

KIND = 'CSV with named columns'
EXPECTED = (
    'A CSV must have the columns time_s (s) and NAME_x, NAME_y, NAME_z (m) of each marker; '
    'of each IMU imu_<id>_x, _y, _z, _w (a quaternion)'
)
_UNIT = r'\s*(?:[_ ]?[(\[]?\s*(mm|cm|m|in|ft)\s*[)\]]?)?'
_COMPONENT = re.compile(r'(.+?)[_.\-: ](q?)([xyzwXYZW])\s*(?:[_ ]?[(\[]?\s*(mm|cm|m|in|ft)\s*[)\]]?)?')
_ANGLE = re.compile(r'.*(?:roll|pitch|yaw|euler|heading).*', re.IGNORECASE)
_ANGLES = (
    'roll, pitch and yaw are not read, since nothing says in which order and about which axes they turn: expected '
    "quaternions, which scipy's Rotation.from_euler makes of them"
)
_COUNTS = ('frame', 'frame#', 'index', 'sample', '')


class ColumnHeader(NamedTuple):
    """Where columns are named.

    Attributes
    ----------
    line
        from 0.
    cells
        the names.
    delimiter
        between them, and between the numbers.
    """

    line: int
    cells: list[str]
    delimiter: str


def find_header(file: ExportFile) -> ColumnHeader:
    """The first line that is no comment; where that has numbers alone, the comment above it."""
    line = 0
    while line < len(file.head) - 1 and file.head[line].lstrip()[:1] in ('', '#'):
        line += 1
    found = _split(file, line)
    if line and all(_is_number(cell) for cell in found.cells):
        above = _split(file, line - 1)
        return above._replace(delimiter=found.delimiter) if len(above.cells) == len(found.cells) else found
    return found


def _split(file: ExportFile, line: int) -> ColumnHeader:
    text = file.head[line]
    delimiter = delimiter_of(text)
    if delimiter not in text:
        return ColumnHeader(line, text.lstrip('# ').split(), ' ')
    cells = file.cells(line, delimiter)
    return ColumnHeader(line, [cells[0].lstrip('# '), *cells[1:]], delimiter)


def _is_number(cell: str) -> bool:
    try:
        return cell == '' or bool(float(cell.replace(',', '.')) + 1)
    except ValueError:
        return False


def matches(file: ExportFile) -> bool:
    """Whether its columns are named, and one is a time or a component of anything."""
    cells = find_header(file).cells
    return any(TIME_COLUMN.fullmatch(cell) or _COMPONENT.fullmatch(cell) for cell in cells)


def read(file: ExportFile, rate: float | None = None) -> MotionCapture:
    """Read it.

    Parameters
    ----------
    file
        the file.
    rate
        of its frames, Hz, where it counts them.

    Raises
    ------
    MocapError
        a column is missing or there twice, a field is not a number (with its line).
    """
    line, header, delimiter = find_header(file)
    below = _units_below(file, line + 1, delimiter, len(header))
    time, scale = _time_column(file, header, rate)
    if below and scale is None:
        scale = TIME_UNITS.get(below[time])
    bodies = _bodies(file, header)
    columns = [time, *(c for parts in bodies.values() for c in parts.values())]
    line += 2 if below else 1
    table = read_numbers(
        file.data,
        file.after(line),
        columns,
        delimiter=delimiter,
        names=[header[c] for c in columns],
        where=file.name,
        first_line=line + 1,
        width=len(header),
    )
    times, notes = _times(file, header[time], scale, table)
    of = dict(zip(columns, table.rows.T, strict=True))
    tracked = {}
    for name, parts in bodies.items():
        xyz, xyzw = (np.stack([of[parts[a]] for a in axes if a in parts], axis=-1) if axes[0] in parts else None
                     for axes in (('x', 'y', 'z', 'w'), ('qx', 'qy', 'qz', 'qw')))  # fmt: skip
        if 'w' in parts:
            xyz, xyzw = None, xyz
        if xyz is not None:
            xyz = xyz * _metres_of(file, name, [parts[axis] for axis in 'xyz'], header, below)
        tracked[name] = TrackedBody(times, xyz, xyzw)
    rest = [
        cell
        for column, cell in enumerate(header)
        if column not in columns and cell.lower() not in _COUNTS and not TIME_COLUMN.fullmatch(cell)
    ]
    return MotionCapture(KIND, tracked, notes=(*table.notes, *notes, *unused_columns(file.name, rest)))


def _units_below(file: ExportFile, line: int, delimiter: str, n: int) -> list[str]:
    """The units in a line below the names, one a column; none where it is no such line."""
    if line >= len(file.head):
        return []
    text = file.head[line]
    cells = text.split() if delimiter == ' ' else file.cells(line, delimiter)
    units = [cell.strip('[]() ').lower() for cell in cells]
    known = {*LENGTH_UNITS, *TIME_UNITS, '', '-'}
    return units if len(units) == n and any(units) and known.issuperset(units) else []


def _metres_of(file: ExportFile, name: str, columns: list[int], header: list[str], below: list[str]) -> float:
    units = set()
    for column in columns:
        match = _COMPONENT.fullmatch(header[column])
        units.add((match and match[4]) or (below[column] if below else '') or 'm')
    if len(units) > 1:
        raise MocapError(f'{file.name}: {name} is in {" and in ".join(sorted(units))}, expected one unit')
    return metres_in(units.pop(), file.name)


class UnusedColumns(str):
    """What has to be said of columns that are not read: a sentence that remembers where they are, and their names."""

    where: str
    names: tuple[str, ...]

    def __new__(cls, where: str, names: Sequence[str]) -> 'UnusedColumns':
        """The sentence."""
        angles = f'; {_ANGLES}' if any(map(_ANGLE.fullmatch, names)) else ''
        note = super().__new__(cls, f'{where}: columns not used: {listed(names)}{angles}')
        note.where, note.names = where, tuple(names)
        return note


def unused_columns(where: str, names: Sequence[str]) -> tuple[UnusedColumns, ...]:
    """What has to be said of the columns that are not read, where there are some."""
    return (UnusedColumns(where, names),) if names else ()


def _time_column(file: ExportFile, header: list[str], rate: float | None) -> tuple[int, float | None]:
    """The column of time, and its unit, s; None where that has to be seen in the numbers."""
    found = {i: match for i, cell in enumerate(header) if (match := TIME_COLUMN.fullmatch(cell))}
    frames = [i for i, cell in enumerate(header) if cell.lower().rstrip('#') == 'frame']
    if rate is not None:
        column = next(iter([*frames, *found]), None)
        if column is not None:
            return column, 1.0 / rate
    for i, match in found.items():
        if header.count(header[i]) > 1:
            raise MocapError(f'{file.name}: {header.count(header[i])} columns are called {header[i]}')
        unit = (match[1] or 's').lower()
        return i, None if unit in ('s', 'sec', 'seconds') else TIME_UNITS[unit]  # seconds are seen to be so
    if frames:
        raise MocapError(f'{file.name} counts frames and has no column time_s: give the rate of the frames')
    near = difflib.get_close_matches('time_s', header, n=1, cutoff=0.0)
    raise MocapError(f'{file.name} has no column time_s; the nearest is {shown(near[0])}. {EXPECTED}')


def _bodies(file: ExportFile, header: list[str]) -> dict[str, dict[str, int]]:
    """Columns by body and component: x y z (w), qx qy qz qw."""
    bodies: dict[str, dict[str, int]] = {}
    for column, cell in enumerate(header):
        match = _COMPONENT.fullmatch(cell)
        if match and not TIME_COLUMN.fullmatch(cell):
            part = f'{match[2]}{match[3].lower()}'
            if part in bodies.setdefault(match[1], {}):
                raise MocapError(f'{file.name}: {header.count(cell)} columns are called {cell}')
            bodies[match[1]][part] = column
    for name, parts in bodies.items():
        for group in (('x', 'y', 'z'), ('qx', 'qy', 'qz', 'qw')):
            have = [part for part in group if part in parts] + (
                ['w'] if group[0] == 'x' and 'w' in parts else []
            )
            lacking = [part for part in group if part not in parts]
            if have and lacking:
                raise MocapError(
                    f'{file.name} has no column {name}_{lacking[0]}, but {header[parts[have[0]]]}. {EXPECTED}'
                )
    if not bodies:
        there = ', '.join(header)
        angles = f'{_ANGLES}. ' if any(map(_ANGLE.fullmatch, header)) else ''
        raise MocapError(
            f"{file.name}: none of its columns is a marker's or an IMU's: {there}. {angles}{EXPECTED}"
        )
    return bodies


def _times(
    file: ExportFile, column: str, scale: float | None, table: NumberTable
) -> tuple[np.ndarray, tuple[str, ...]]:
    times = table.rows[:, 0]
    if np.isnan(times).any():
        raise MocapError(f'{file.name}, line {table.lines[np.argmax(np.isnan(times))]}: {column} is empty')
    if scale is None:
        return in_seconds(times, column, file.name)
    return times * scale, ()


class Scalars(NamedTuple):
    """Columns of single lengths.

    Attributes
    ----------
    times : (n,)
        s.
    values
        by name, (n,), m; NaN where a cell is empty.
    cells
        what the columns are called in the file.
    """

    times: FloatArray
    values: dict[str, FloatArray]
    cells: tuple[str, ...]


def read_scalars(file: ExportFile, names: Sequence[str]) -> Scalars:
    """Columns of single lengths, each called by a name, after which a unit may follow, as in `b1 [mm]`.

    Parameters
    ----------
    file
        the file.
    names
        to look for; those that are there are read.

    Raises
    ------
    MocapError
        there is no time, two columns have one name, or a field is not a number.
    """
    line, header, delimiter = find_header(file)
    below = _units_below(file, line + 1, delimiter, len(header))
    found: dict[str, int] = {}
    metres: dict[str, float] = {}
    for name in names:
        for column, cell in enumerate(header):
            if match := re.fullmatch(rf'{re.escape(name)}{_UNIT}', cell):
                if name in found:
                    raise MocapError(f'{file.name}: {header[found[name]]} and {cell} are both {name}')
                unit = match[1] or (below[column] if below else '') or 'm'
                found[name], metres[name] = column, metres_in(unit, file.name)
    if not found:
        return Scalars(np.zeros(0), {}, ())
    time, scale = _time_column(file, header, None)
    if below and scale is None:
        scale = TIME_UNITS.get(below[time])
    columns = [time, *found.values()]
    line += 2 if below else 1
    table = read_numbers(
        file.data,
        file.after(line),
        columns,
        delimiter=delimiter,
        names=[header[c] for c in columns],
        where=file.name,
        first_line=line + 1,
        width=len(header),
    )
    times, _ = _times(file, header[time], scale, table)
    values = {name: metres[name] * table.rows[:, 1 + k] for k, name in enumerate(found)}
    return Scalars(times, values, tuple(header[c] for c in found.values()))
