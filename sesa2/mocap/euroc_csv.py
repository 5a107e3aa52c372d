"""EuRoC's CSV (also of the ASL and evo): the trajectory of one body, named after the file.

Nanoseconds; position p_…_x, _y, _z in m; quaternion q_…_w, _x, _y, _z. Further columns are ignored.
"""

import re

import numpy as np

from sesa2.mocap.capture import MocapError, MotionCapture, TrackedBody
from sesa2.mocap.export_file import ExportFile
from sesa2.mocap.number_table import read_numbers
from sesa2.mocap.time_units import TIME_UNITS

KIND = 'EuRoC CSV'


def matches(file: ExportFile) -> bool:
    """Whether its first line is EuRoC's."""
    return bool(re.match(r'#\s*time', file.head[0])) and bool(re.search(r'[ ,]p_(\w*_)?x\b', file.head[0]))


def read(file: ExportFile) -> MotionCapture:
    """Read it.

    Raises
    ------
    MocapError
        a column is missing, or its numbers are none.
    """
    header = file.cells(0, ',')
    found = {
        f'{match[1]}{match[2]}': column
        for column, cell in enumerate(header)
        if (match := re.match(r'(p|q)(?:_\w*)?_([wxyz])\b', cell))
    }
    wanted = ['px', 'py', 'pz', 'qx', 'qy', 'qz', 'qw']
    missing = [name for name in wanted if name not in found]
    if missing:
        raise MocapError(
            f'{file.name}: {KIND} without the columns {", ".join(missing)}; it has {file.head[0]}'
        )
    unit = re.search(r'\[(\w+)\]', header[0])
    columns = [0, *(found[name] for name in wanted)]
    table = read_numbers(
        file.data,
        file.after(1),
        columns,
        delimiter=',',
        names=[header[c] for c in columns],
        where=file.name,
        first_line=2,
    )
    times = table.rows[:, 0] * TIME_UNITS.get(unit[1] if unit else 'ns', 1e-9)
    body = TrackedBody(times, np.ascontiguousarray(table.rows[:, 1:4]), table.rows[:, 4:])
    return MotionCapture(KIND, {file.path.stem: body}, notes=table.notes)
