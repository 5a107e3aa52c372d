"""TRC, track row column (Motion Analysis, OpenSim): markers.

Line 2 names what line 3 gives: DataRate, Units and more. Line 4 has Frame#, Time and a marker over each three columns,
line 5 the axes; an empty line may follow. Without times frame 1 is at 0, and DataRate tells the others.
Source: OpenSim documentation, "Marker (.trc) Files".
"""

import numpy as np

from sesa2.errors import shown
from sesa2.mocap.body_names import about_namesakes, told_apart
from sesa2.mocap.capture import MocapError, MotionCapture, TrackedBody, metres_in
from sesa2.mocap.export_file import ExportFile
from sesa2.mocap.number_table import read_numbers

KIND = 'TRC'


def matches(file: ExportFile) -> bool:
    """Whether it is a TRC file."""
    return file.head[0].startswith('PathFileType')


def read(file: ExportFile) -> MotionCapture:
    """Read it.

    Raises
    ------
    MocapError
        its header is not whole, or its numbers are none.
    """
    keys = dict(zip(file.cells(1, '\t'), file.cells(2, '\t'), strict=False))
    names = {column: name for column, name in enumerate(file.cells(3, '\t')) if column > 1 and name}
    if not names or 'Units' not in keys:
        raise MocapError(f'{file.name}: {KIND} without Units in line 3, or without markers in line 4')
    if len(names) > 2 and all(n.lower().endswith(('_x', '_y', '_z')) for n in names.values()):
        names = {column: name[:-2] for column, name in names.items() if name.lower().endswith('_x')}
    names = dict(zip(names, told_apart(list(names.values())), strict=True))
    metre = metres_in(keys['Units'], file.name)
    header = 4 if file.cells(4, '\t')[:1] not in ([], ['']) else 5
    columns = [0, 1, *(c + axis for c in names for axis in range(3))]
    table = read_numbers(
        file.data,
        file.after(header),
        columns,
        delimiter='\t',
        names=['Frame#', 'Time', *(f'{name} {axis}' for name in names.values() for axis in 'XYZ')],
        where=file.name,
        first_line=header + 1,
        short_rows=True,
    )
    times = table.rows[:, 1]
    if np.isnan(times).all():
        times = (table.rows[:, 0] - 1.0) / _rate(keys.get('DataRate', ''), file.name)
    positions = metre * table.rows[:, 2:].reshape(len(table.rows), len(names), 3)
    bodies = {name: TrackedBody(times, positions[:, k]) for k, name in enumerate(names.values())}
    return MotionCapture(KIND, bodies, notes=(*table.notes, *about_namesakes(bodies, file.name)))


def _rate(text: str, where: str) -> float:
    try:
        rate = float(text.replace(',', '.'))
    except ValueError:
        rate = 0.0
    if not rate > 0.0:
        raise MocapError(f'{where}: {KIND} without times, and with a DataRate of {shown(text)}, expected Hz')
    return rate
