"""TRC, track row column (Motion Analysis, OpenSim): markers.

Line 2 names what line 3 gives: DataRate, Units and more. Line 4 has Frame#, Time and a marker over each three columns,
line 5 the axes; an empty line may follow. Source: OpenSim documentation, "Marker (.trc) Files".
"""

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
    metre = metres_in(keys['Units'], file.name)
    header = 4 if file.cells(4, '\t')[:1] not in ([], ['']) else 5
    columns = [1, *(c + axis for c in names for axis in range(3))]
    table = read_numbers(
        file.data,
        file.after(header),
        columns,
        delimiter='\t',
        names=['Time', *(f'{name} {axis}' for name in names.values() for axis in 'XYZ')],
        where=file.name,
        first_line=header + 1,
        short_rows=True,
    )
    positions = metre * table.rows[:, 1:].reshape(len(table.rows), len(names), 3)
    bodies = {name: TrackedBody(table.rows[:, 0], positions[:, k]) for k, name in enumerate(names.values())}
    return MotionCapture(KIND, bodies, notes=table.notes)
