"""TUM's trajectories (also of evo): time tx ty tz qx qy qz qw in s and m, blanks between, comments after #.

Of one body, which is named after the file. Source: the file format page of the TUM RGB-D benchmark.
"""

import numpy as np

from sesa2.mocap.capture import MotionCapture, TrackedBody
from sesa2.mocap.export_file import ExportFile
from sesa2.mocap.number_table import read_numbers
from sesa2.mocap.time_units import in_seconds

KIND = 'TUM trajectory'
_COLUMNS = ('time', 'tx', 'ty', 'tz', 'qx', 'qy', 'qz', 'qw')


def matches(file: ExportFile) -> bool:
    """Whether its first line that is no comment has eight numbers with blanks between."""
    first = next((line for line in file.head if line.strip() and not line.lstrip().startswith('#')), '')
    try:
        return len([float(cell) for cell in first.split()]) == len(_COLUMNS)
    except ValueError:
        return False


def read(file: ExportFile) -> MotionCapture:
    """Read it.

    Raises
    ------
    MocapError
        its numbers are none.
    """
    comments = 0
    while comments < len(file.head) and file.head[comments].lstrip().startswith('#'):
        comments += 1
    data, begin = file.data, file.after(comments)
    if data.find(b'#', begin) >= 0:
        data, begin = b'\n'.join(line.split(b'#')[0] for line in data[begin:].split(b'\n')), 0
    table = read_numbers(
        data, begin, range(8), delimiter=' ', names=_COLUMNS, where=file.name, first_line=comments + 1
    )
    times, notes = in_seconds(table.rows[:, 0], 'time', file.name)
    tracked = TrackedBody(times, np.ascontiguousarray(table.rows[:, 1:4]), table.rows[:, 4:])
    return MotionCapture(KIND, {file.path.stem: tracked}, notes=(*table.notes, *notes))
