"""A CSV of all IMUs: a time, then imu_<id>_gx, _gy, _gz (rad/s), _ax, _ay, _az (m/s², with gravity) of each.

And, where there is a magnetometer, imu_<id>_mx, _my, _mz (T). A column of time is one as in `mocap.named_columns`.
Orientations imu_<id>_x, _y, _z, _w may stand beside them.
"""

import re

import numpy as np

from sesa2.imu_logs.sensor_log import LogColumns, Quantity, SensorLog, SensorLogError
from sesa2.mocap.export_file import ExportFile, delimiter_of
from sesa2.mocap.time_units import TIME_UNITS, in_seconds
from sesa2.shape.rotations import FloatArray

KIND = 'CSV of IMUs'
_TIME = re.compile(r'(?:time|timestamp|t)(?:\s*[_ (\[]\s*(s|sec|seconds|ms|us|µs|ns)\s*[)\]]?)?')
_INERTIAL = re.compile(r'imu_(\d+)_[ga][xyz]')


def matches(file: ExportFile) -> bool:
    """Whether it has an angular velocity or acceleration of an IMU."""
    return any(_INERTIAL.fullmatch(cell.lower()) for cell in file.cells(0, delimiter_of(file.head[0])))


def read(file: ExportFile) -> dict[int, SensorLog]:
    """Read it: the IMUs by id.

    Raises
    ------
    SensorLogError
        it has no time, or only a part of an IMU.
    """
    delimiter = delimiter_of(file.head[0])
    header = [cell.lower() for cell in file.cells(0, delimiter)]
    found = next(((cell, match) for cell in header if (match := _TIME.fullmatch(cell))), None)
    if found is None:
        raise SensorLogError(f'{file.name}: no column time_s; its columns: {", ".join(header)}')
    columns = LogColumns(file, 0, delimiter)
    name, match = found
    time = columns.one(name)
    notes: tuple[str, ...] = ()
    if time is None or np.isnan(time).any():
        raise SensorLogError(f'{file.name}: {name} has empty cells')
    if match[1] in (None, 's', 'sec', 'seconds'):
        time, notes = in_seconds(time, name, file.name)
    else:
        time = time * TIME_UNITS[match[1]]
    ids = sorted({int(match[1]) for cell in header if (match := _INERTIAL.fullmatch(cell))})

    def of(imu: int, letter: str) -> FloatArray | None:
        return columns.vector(Quantity([f'imu_{imu}_{letter}{axis}' for axis in 'xyz']))

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
