"""A CSV whose columns say what they hold: time_s, then NAME_x, NAME_y, NAME_z of each marker.

A column of time is `time_s` (or `time`, `timestamp`, `t`), or says its unit: `time_ms`, `time_us`, `time_ns`; or it is
`frame`, with the rate of the frames given. Between a name and its axis may stand `_`, `.`, `-` or a blank; a unit may
follow, as in `M1_x [mm]`. A body with NAME_qx, NAME_qy, NAME_qz, NAME_qw, or with NAME_x, _y, _z and _w, has an
orientation (the latter no position). Other columns are ignored.
"""

import difflib
import re

import numpy as np

from sesa2.mocap.capture import LENGTH_UNITS, MocapError, MotionCapture, TrackedBody
from sesa2.mocap.export_file import ExportFile, delimiter_of
from sesa2.mocap.number_table import NumberTable, read_numbers
from sesa2.mocap.time_units import TIME_UNITS, in_seconds

KIND = 'CSV with named columns'
EXPECTED = (
    'A CSV must have the columns time_s (s) and NAME_x, NAME_y, NAME_z (m) of each marker; '
    'of each IMU imu_<id>_x, _y, _z, _w (a quaternion)'
)
_TIME = re.compile(
    r'(?:time|timestamp|t)(?:\s*[_ (\[]\s*(s|sec|seconds|ms|us|µs|ns)\s*[)\]]?)?', re.IGNORECASE
)
_COMPONENT = re.compile(r'(.+?)[_.\- ](q?)([xyzwXYZW])\s*(?:[_ ]?[(\[]?\s*(mm|cm|m|in|ft)\s*[)\]]?)?')


def matches(file: ExportFile) -> bool:
    """Whether its first line has a time, or a component of anything."""
    cells = file.cells(0, delimiter_of(file.head[0]))
    return any(_TIME.fullmatch(cell) for cell in cells) or any(_COMPONENT.fullmatch(cell) for cell in cells)


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
    delimiter = delimiter_of(file.head[0])
    header = file.cells(0, delimiter)
    time, scale = _time_column(file, header, rate)
    bodies = _bodies(file, header)
    columns = [time, *(c for parts in bodies.values() for c in parts.values())]
    names = [header[c] for c in columns]
    table = read_numbers(
        file.data, file.after(1), columns, delimiter=delimiter, names=names, where=file.name, first_line=2
    )
    times, notes = _times(file, header[time], scale, table)
    of = dict(zip(columns, table.rows.T, strict=True))
    tracked = {}
    for name, parts in bodies.items():
        xyz, xyzw = (np.stack([of[parts[a]] for a in axes if a in parts], axis=-1) if axes[0] in parts else None
                     for axes in (('x', 'y', 'z', 'w'), ('qx', 'qy', 'qz', 'qw')))  # fmt: skip
        if 'w' in parts:
            xyz, xyzw = None, xyz
        unit = _COMPONENT.fullmatch(header[parts.get('x', next(iter(parts.values())))])
        metre = LENGTH_UNITS[unit[4] or 'm'] if unit else 1.0
        tracked[name] = TrackedBody(times, None if xyz is None else metre * xyz, xyzw)
    return MotionCapture(KIND, tracked, notes=(*table.notes, *notes))


def _time_column(file: ExportFile, header: list[str], rate: float | None) -> tuple[int, float | None]:
    """The column of time, and its unit, s; None where that has to be seen in the numbers."""
    found = {i: match for i, cell in enumerate(header) if (match := _TIME.fullmatch(cell))}
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
    raise MocapError(f'{file.name} has no column time_s; the nearest is {near[0]!r}. {EXPECTED}')


def _bodies(file: ExportFile, header: list[str]) -> dict[str, dict[str, int]]:
    """Columns by body and component: x y z (w), qx qy qz qw."""
    bodies: dict[str, dict[str, int]] = {}
    for column, cell in enumerate(header):
        match = _COMPONENT.fullmatch(cell)
        if match and not _TIME.fullmatch(cell):
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
        raise MocapError(f"{file.name}: none of its columns is a marker's or an IMU's: {there}. {EXPECTED}")
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
