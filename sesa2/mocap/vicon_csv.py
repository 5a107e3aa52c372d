"""Vicon's CSV (Nexus and Tracker): sections, of which those with positions are read.

A section begins with a line of its name and one of its rate, in Hz. Then come a line with the names of what was
tracked, one with `Frame`, `Sub Frame` and the axes, and one with the units. Frame 1 is at time 0.
Source: exports described in the documentation of Nexus ("Export ASCII") and in public readers of them.
"""

import re

import numpy as np

from sesa2.errors import shown
from sesa2.mocap.body_names import about_namesakes, place_column
from sesa2.mocap.capture import LENGTH_UNITS, MocapError, MotionCapture, TrackedBody
from sesa2.mocap.export_file import ExportFile, delimiter_of
from sesa2.mocap.number_table import read_numbers

KIND = 'Vicon CSV'
_SECTIONS = b'Trajectories|Objects|Segments|Model Outputs|Devices|Joints|Events'
# With the end of the line before it, which is found fast.
_HEADING = re.compile(rb'\n"?(' + _SECTIONS + rb')"?[,;\t ]*(?=\n)')
# A section ends where a line has no cell with anything in it.
_BLANK = re.compile(rb'\n[,;\t ]*\n')
_TRACKED = ('Trajectories', 'Objects', 'Segments')
_HEADER = 5  # lines of a section
_LONGEST_HEADER = 5_000_000  # bytes


def matches(file: ExportFile) -> bool:
    """Whether Vicon wrote it."""
    return any(line.lstrip('" ').startswith('Frame') and 'Sub Frame' in line for line in file.head) or bool(
        _headings(file.data[:1000])
    )


def read(file: ExportFile) -> MotionCapture:
    """Read it.

    Raises
    ------
    MocapError
        no section has positions, or its numbers are none.
    """
    headings = _headings(file.data)
    bodies: dict[str, TrackedBody] = {}
    notes: list[str] = []
    ends = [*(begin for begin, _ in headings[1:]), len(file.data)]
    for (begin, section), end in zip(headings, ends, strict=False):
        if section in _TRACKED:
            for name, body in _section(file, begin, end, notes).items():
                bodies.setdefault(name, body)
    if not bodies:
        there = ', '.join(section for _, section in headings) or 'none'
        raise MocapError(
            f'{file.name}: {KIND} with the sections {there}; expected {" or ".join(_TRACKED)} with positions'
        )
    return MotionCapture(KIND, bodies, notes=tuple(notes))


def _headings(data: bytes) -> list[tuple[int, str]]:
    """Where each section begins, and its name."""
    first = _HEADING.match(b'\n' + data[:1000])
    found = [(0, first[1].decode())] if first else []
    return found + [(match.start() + 1, match[1].decode()) for match in _HEADING.finditer(data)]


def _section(file: ExportFile, begin: int, end: int, notes: list[str]) -> dict[str, TrackedBody]:
    part = ExportFile(file.path, file.data[begin : min(end, begin + _LONGEST_HEADER)])
    first_line = file.data.count(b'\n', 0, begin) + 1
    delimiter = delimiter_of(part.head[3]) if len(part.head) > _HEADER else ','
    rate_text = next(iter(part.cells(1, delimiter)), '')
    try:
        rate = float(rate_text.replace(',', '.'))
    except ValueError:
        rate = 0.0
    if not rate > 0.0:
        raise MocapError(f'{file.name}, line {first_line + 1}: {shown(rate_text)}, expected the rate in Hz')
    names, axes, units = (part.cells(line, delimiter) for line in (2, 3, 4))
    names += [''] * (len(axes) - len(names))
    units += [''] * (len(axes) - len(units))
    wanted: dict[str, dict[str, int]] = {}
    of = ''
    for column in range(2, len(axes)):
        of = names[column] or of
        # Tracker writes what the rotation is given as, then subject and segment, which for an object are the same.
        name = re.sub(r'^Global Angle.*?\) ', '', of)
        subject, colon, segment = name.partition(':')
        name = subject if colon and subject == segment else name
        axis = axes[column].upper()
        place_column(wanted, name, axis if len(axis) > 1 else f'T{axis}', column)
    wanted = {
        name: cells for name, cells in wanted.items() if {'TX', 'TY', 'TZ'} <= set(cells) or 'RW' in cells
    }
    if not wanted:
        return {}
    columns = [
        0,
        *(
            c
            for cells in wanted.values()
            for axis, c in cells.items()
            if axis in ('TX', 'TY', 'TZ', 'RX', 'RY', 'RZ', 'RW')
        ),
    ]
    numbers = begin + part.after(_HEADER)
    blank = _BLANK.search(file.data, numbers - 1, end)
    table = read_numbers(
        file.data,
        numbers,
        columns,
        end=blank.start() + 1 if blank else end,
        delimiter=delimiter,
        names=['Frame', *(f'{_above(names, c)} {axes[c]}' for c in columns[1:])],
        where=file.name,
        first_line=first_line + _HEADER,
        short_rows=True,
        width=len(axes),
    )
    of_column = dict(zip(columns, table.rows.T, strict=True))
    times = (of_column[0] - 1.0) / rate
    bodies = {}
    for name, cells in wanted.items():
        position = orientation = None
        if {'TX', 'TY', 'TZ'} <= set(cells):
            unit = units[cells['TX']].lower() or 'mm'
            if unit not in LENGTH_UNITS:  # a velocity, or a force
                continue
            position = LENGTH_UNITS[unit] * np.stack([of_column[cells[f'T{a}']] for a in 'XYZ'], axis=-1)
        if {'RX', 'RY', 'RZ', 'RW'} <= set(cells):
            orientation = np.stack([of_column[cells[f'R{a}']] for a in 'XYZW'], axis=-1)
        elif 'RX' in cells:
            note = f'{file.name}: rotations without RW are no quaternions and were left out; export them as quaternions'
            if note not in notes:
                notes.append(note)
        bodies[name] = TrackedBody(times, position, orientation)
    notes.extend([*table.notes, *about_namesakes(bodies, file.name)])
    return bodies


def _above(names: list[str], column: int) -> str:
    return next((name for name in names[column::-1] if name), '')
