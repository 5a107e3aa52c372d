"""Qualisys Track Manager's TSV: markers (3D) or rigid bodies (6D), in mm.

Lines of a key and its values, of which MARKER_NAMES or BODY_NAMES names the columns and FREQUENCY gives the rate; then
frames. Where a line of headings is above them, they may begin with their number and time. What
was not seen is 0 or empty.
A body has X Y Z, three angles, the residual and the rotation matrix column by column (Rot[1] is its second row).
Source: Qualisys, "QTM user manual", TSV file formats.
"""

import numpy as np

from sesa2.mocap.body_names import about_namesakes, told_apart
from sesa2.mocap.capture import MocapError, MotionCapture, TrackedBody
from sesa2.mocap.export_file import ExportFile
from sesa2.mocap.number_table import read_numbers
from sesa2.shape.rotations import FloatArray, from_matrix

KIND = 'Qualisys TSV'
_MM = 1e-3
_COLUMNS_3D, _COLUMNS_6D = 3, 16


def matches(file: ExportFile) -> bool:
    """Whether Qualisys Track Manager wrote it."""
    return file.head[0].startswith('NO_OF_FRAMES')


def read(file: ExportFile) -> MotionCapture:
    """Read it.

    Raises
    ------
    MocapError
        its header is not whole, or its numbers are none.
    """
    keys: dict[str, list[str]] = {}
    lines = 0
    for lines in range(len(file.head)):
        key, *values = file.cells(lines, '\t') or ['']
        if not key or not key.replace('_', '').isalpha() or not key.isupper():
            break
        keys.setdefault(key, [v for v in values if v])
    names = told_apart(keys.get('BODY_NAMES') or keys.get('MARKER_NAMES') or [])
    each = _COLUMNS_6D if 'BODY_NAMES' in keys else _COLUMNS_3D
    try:
        rate = float(keys['FREQUENCY'][0].replace(',', '.'))
    except (KeyError, IndexError, ValueError):
        raise MocapError(f'{file.name}: {KIND} without a FREQUENCY in its header') from None
    if not names or not rate > 0.0:
        raise MocapError(f'{file.name}: {KIND} with {len(names)} names of markers or bodies and {rate:g} Hz')
    headings: list[str] = []
    while lines < len(file.head) and not _is_numbers(file.cells(lines, '\t')):
        headings += file.cells(lines, '\t')
        lines += 1
    leading = [heading.lower() for heading in headings[:2] if heading.lower() in ('frame', 'time')]
    before = len(leading)
    columns = list(range(before + each * len(names)))
    table = read_numbers(
        file.data,
        file.after(lines),
        columns,
        delimiter='\t',
        names=[f'column {c + 1}' for c in columns],
        where=file.name,
        first_line=lines + 1,
        short_rows=True,
    )
    times = np.arange(len(table.rows)) / rate
    if 'time' in leading:
        times = table.rows[:, leading.index('time')]
    elif leading:
        times = (table.rows[:, 0] - 1.0) / rate
    bodies = {}
    for k, name in enumerate(names):
        own = table.rows[:, before + each * k : before + each * (k + 1)]
        bodies[name] = _marker(times, own) if each == _COLUMNS_3D else _body(times, own)
    return MotionCapture(KIND, bodies, notes=(*table.notes, *about_namesakes(names, file.name)))


def _marker(times: FloatArray, own: FloatArray) -> TrackedBody:
    return TrackedBody(times, _MM * own)


def _body(times: FloatArray, own: FloatArray) -> TrackedBody:
    matrix = own[:, 7:].reshape(-1, 3, 3).swapaxes(1, 2)
    seen = np.abs(np.linalg.det(np.nan_to_num(matrix)) - 1.0) < 0.1
    orientation = np.full((len(own), 4), np.nan)
    orientation[seen] = from_matrix(matrix[seen])
    position = np.where(seen[:, None], _MM * own[:, :3], np.nan)
    return TrackedBody(times, position, orientation)


def _is_numbers(cells: list[str]) -> bool:
    try:
        return bool(cells) and bool([float(c.replace(',', '.')) for c in cells if c and c != 'NULL'])
    except ValueError:
        return False
