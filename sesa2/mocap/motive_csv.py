"""Motive's CSV (OptiTrack), of versions 1 to 3: markers and rigid bodies.

The first line holds pairs of a key and its value. Below, one line each names the type, the name, (the parent,) the ID,
the quantity and the axis of every column; the last of them begins with `Frame`.
Source: docs.optitrack.com, "Data Export: CSV".
"""

import numpy as np

from sesa2.errors import shown
from sesa2.mocap.body_names import about_namesakes, place_column
from sesa2.mocap.capture import MocapError, MotionCapture, TrackedBody, metres_in
from sesa2.mocap.export_file import ExportFile, delimiter_of
from sesa2.mocap.number_table import read_numbers
from sesa2.shape.rotations import FloatArray

KIND = 'Motive CSV'
# Where two things have one name, the first of these is taken: measured before solved.
_TYPES = ('Rigid Body', 'Marker', 'Rigid Body Marker', 'Bone', 'Bone Marker')
_AXES = "Motive's y axis points up, unless it was exported otherwise"


def matches(file: ExportFile) -> bool:
    """Whether Motive wrote it."""
    return file.head[0].lstrip('"').startswith(('Format Version', 'Take Name')) and any(
        'Frame' in line[:8] for line in file.head
    )


def read(file: ExportFile) -> MotionCapture:
    """Read it.

    Raises
    ------
    MocapError
        its header is not whole, or its numbers are none.
    """
    delimiter = delimiter_of(file.head[0])
    first = file.cells(0, delimiter)
    keys = dict(zip(first[::2], first[1::2], strict=False))
    last = next(i for i, line in enumerate(file.head) if line.lstrip('"').startswith('Frame'))
    header = {
        next(filter(None, cells[:2]), ''): cells
        for cells in (file.cells(i, delimiter) for i in range(1, last))
    }
    quantities, axes = file.cells(last - 1, delimiter), file.cells(last, delimiter)
    try:
        types, names = header['Type'], header['Name']
    except KeyError as lacking:
        raise MocapError(f'{file.name}: {KIND} without the line {lacking} in its header') from None
    by_type: dict[str, dict[str, dict[str, int]]] = {}
    for column in range(2, min(len(names), len(types), len(quantities), len(axes))):
        if quantities[column] in ('Position', 'Rotation') and axes[column] and names[column]:
            part = quantities[column] + axes[column].upper()
            place_column(by_type.setdefault(types[column], {}), names[column], part, column)
    wanted = {(kind, name): cells for kind, own in by_type.items() for name, cells in own.items()}

    for (_, name), cells in wanted.items():
        for quantity in ('Position', 'Rotation'):
            there = {cell[-1] for cell in cells if cell.startswith(quantity)}
            if there and not set('XYZ') <= there:
                raise MocapError(f'{file.name}: {KIND} whose header names {name} {", ".join(cells)} alone')
    if not wanted or len(axes) < 2:
        raise MocapError(f'{file.name}: {KIND} without markers or bodies in its header')

    notes = []
    quaternions = keys.get('Rotation Type', 'Quaternion') == 'Quaternion'
    if not quaternions and any('RotationX' in cells for cells in wanted.values()):
        notes.append(
            f'{file.name}: its rotations are Euler angles and were left out; export them as quaternions'
        )
    if keys.get('Coordinate Space', 'Global') != 'Global':
        notes.append(f'{file.name}: its coordinate space is {keys["Coordinate Space"]}, expected Global')
    columns = [0, 1, *(column for cells in wanted.values() for column in cells.values())]
    table = read_numbers(
        file.data,
        file.after(last + 1),
        columns,
        delimiter=delimiter,
        names=[f'{names[c]} {quantities[c]} {axes[c]}' if c > 1 else axes[c] for c in columns],
        where=file.name,
        first_line=last + 2,
        short_rows=True,
        width=len(axes),
    )
    of = dict(zip(columns, table.rows.T, strict=True))
    times = of[1]
    if not axes[1].lower().startswith('time'):
        rate = keys.get('Export Frame Rate') or keys.get('Capture Frame Rate') or 'no rate'
        times = of[0] / _rate(rate, file.name)
    metre = metres_in(keys.get('Length Units', 'Meters'), file.name)
    bodies: dict[str, TrackedBody] = {}
    rank = {kind: i for i, kind in enumerate(_TYPES)}
    for (_, name), cells in sorted(wanted.items(), key=lambda item: rank.get(item[0][0], len(rank))):
        parts = {part: of[column] for part, column in cells.items()}
        body = TrackedBody(
            times,
            metre * _stacked(parts, 'PositionX', 'PositionY', 'PositionZ') if 'PositionX' in parts else None,
            _stacked(parts, 'RotationX', 'RotationY', 'RotationZ', 'RotationW')
            if quaternions and 'RotationW' in parts
            else None,
        )
        bodies.setdefault(name, body)
    notes += [*table.notes, *about_namesakes(bodies, file.name)]
    return MotionCapture(KIND, bodies, notes=tuple(notes), axes=f'{file.name}: {_AXES}')


def _stacked(parts: dict[str, FloatArray], *names: str) -> FloatArray:
    return np.stack([parts[name] for name in names], axis=-1)


def _rate(text: str, where: str) -> float:
    try:
        return float(text.replace(',', '.'))
    except ValueError:
        raise MocapError(f'{where}: {KIND} with frames at {shown(text)}, expected their rate in Hz') from None
