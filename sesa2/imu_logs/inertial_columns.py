"""A CSV of all IMUs: a time, then imu_<id>_gx, _gy, _gz (rad/s), _ax, _ay, _az (m/s², with gravity) of each.

And, where there is a magnetometer, imu_<id>_mx, _my, _mz (T). Another unit stands behind: `imu_2_gx [deg/s]`. A column
of time is one as in `mocap.named_columns`. Orientations imu_<id>_x, _y, _z, _w may stand beside them.
"""

import re

import numpy as np

from sesa2.imu_logs.sensor_log import UNITS_OF, LogColumns, Quantity, SensorLog, SensorLogError
from sesa2.mocap.export_file import ExportFile
from sesa2.mocap.named_columns import find_header, unused_columns
from sesa2.mocap.time_units import TIME_COLUMN, TIME_UNITS, in_seconds
from sesa2.shape.rotations import FloatArray

KIND = 'CSV of IMUs'
_INERTIAL = re.compile(r'(imu_(\d+)_([gam])[xyz])(?:\s*[(\[]\s*(\S+?)\s*[)\]])?')
_ORIENTATION = re.compile(r'imu_\d+_[xyzw]')
_SENSORS = {'g': 'gyroscope', 'a': 'accelerometer', 'm': 'magnetometer'}


def matches(file: ExportFile) -> bool:
    """Whether it has an angular velocity or acceleration of an IMU."""
    found = (_INERTIAL.fullmatch(cell.lower()) for cell in find_header(file).cells)
    return any(match and match[3] != 'm' for match in found)


def read(file: ExportFile) -> dict[int, SensorLog]:
    """Read it: the IMUs by id.

    Raises
    ------
    SensorLogError
        it has no time, or only a part of an IMU, or a unit is not known.
    """
    line, cells, delimiter = find_header(file)
    header = [cell.lower() for cell in cells]
    found = next(((cell, match) for cell in header if (match := TIME_COLUMN.fullmatch(cell))), None)
    if found is None:
        raise SensorLogError(f'{file.name}: no column time_s; its columns: {", ".join(header)}')
    units: dict[tuple[int, str], float] = {}
    for match in filter(None, map(_INERTIAL.fullmatch, header)):
        known = UNITS_OF[_SENSORS[match[3]]]
        if match[4] and match[4] not in known:
            raise SensorLogError(
                f'{file.name}: {match[1]} in {match[4]!r}, expected one of {", ".join(known)}'
            )
        unit = known[match[4]] if match[4] else 1.0
        if units.setdefault((int(match[2]), match[3]), unit) != unit:
            raise SensorLogError(f'{file.name}: IMU {match[2]} has columns of one sensor in several units')
    columns = LogColumns(file, line, delimiter, _called)
    name, timed = found
    time = columns.one(name)
    notes: tuple[str, ...] = ()
    if time is None or np.isnan(time).any():
        raise SensorLogError(f'{file.name}: {name} has empty cells')
    if timed[1] in (None, 's', 'sec', 'seconds'):
        time, notes = in_seconds(time, name, file.name)
    else:
        time = time * TIME_UNITS[timed[1]]
    notes += unused_columns(file.name, [cell for cell in cells if cell and not _called(cell)])
    ids = sorted({imu for imu, letter in units if letter != 'm'})

    def of(imu: int, letter: str) -> FloatArray | None:
        names = [f'imu_{imu}_{letter}{axis}' for axis in 'xyz']
        return columns.vector(Quantity(names, units.get((imu, letter), 1.0)))

    return {
        imu: columns.log(
            KIND,
            time,
            notes if imu == ids[0] else (),
            orientations=columns.vector(Quantity([f'imu_{imu}_{axis}' for axis in 'xyzw'])),
            angular_velocities=of(imu, 'g'),
            accelerations=of(imu, 'a'),
            fields=of(imu, 'm'),
        )
        for imu in ids
    }


def _called(cell: str) -> str:
    """What a column is called, without comment marks and unit; empty if it is not read."""
    name = cell.lower().lstrip('# ')
    match = _INERTIAL.fullmatch(name)
    if match:
        return match[1]
    return name if TIME_COLUMN.fullmatch(name) or _ORIENTATION.fullmatch(name) else ''
