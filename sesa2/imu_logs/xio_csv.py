"""CSV of x-io Technologies' x-IMU3 and NGIMU: columns that say their unit, as in `Gyroscope X (deg/s)`.

Quaternions are in files of their own, W, X, Y, Z with or without `Quaternion` in front, and of the sensor in the earth
frame, whose z is up. Source: the user manuals of the x-IMU3 and of the NGIMU.
"""

import re

import numpy as np

from sesa2.imu_logs.sensor_log import (
    DEGREES,
    EARTH_FIELD,
    GRAVITY,
    LogColumns,
    Quantity,
    SensorLog,
    SensorLogError,
)
from sesa2.mocap.export_file import ExportFile, delimiter_of
from sesa2.mocap.time_units import TIME_UNITS

KIND = 'x-io CSV'
_TIME = re.compile(r'time(?:stamp)?\s*\(\s*(s|ms|us|µs|μs|ns)\s*\)')
_COMPONENT = re.compile(
    r'(?:(gyroscope|accelerometer|magnetometer|quaternion)\s*(?:element)?\s*)?([wxyz])(?:\s*\(\s*([^)]*?)\s*\))?'
)
_UNITS = {
    'gyroscope': {'deg/s': DEGREES, '°/s': DEGREES, 'dps': DEGREES, 'rad/s': 1.0},
    'accelerometer': {'g': GRAVITY, 'm/s^2': 1.0, 'm/s²': 1.0, 'm/s/s': 1.0, 'm/s2': 1.0},
    'magnetometer': {
        'ut': 1e-6,
        'µt': 1e-6,
        'μt': 1e-6,
        'g': 1e-4,
        'gauss': 1e-4,
        'a.u.': EARTH_FIELD,
        't': 1.0,
    },
}


def matches(file: ExportFile) -> bool:
    """Whether its first column is a time with its unit, and others are those of such an IMU."""
    cells = [cell.lower() for cell in file.cells(0, delimiter_of(file.head[0]))]
    timed = bool(cells) and _TIME.fullmatch(cells[0]) is not None
    return timed and any(_COMPONENT.fullmatch(cell) for cell in cells[1:])


def read(file: ExportFile) -> SensorLog:
    """Read it.

    Raises
    ------
    SensorLogError
        a unit is not known, or it has no orientation and nothing to fuse.
    """
    delimiter = delimiter_of(file.head[0])
    units: dict[str, str] = {}

    def rename(cell: str) -> str:
        if _TIME.fullmatch(cell.lower()):
            return 'time'
        match = _COMPONENT.fullmatch(cell.lower())
        if not match:
            return ''
        sensor = match[1] or 'quaternion'
        units.setdefault(sensor, match[3] or '')
        return f'{sensor} {match[2]}'

    columns = LogColumns(file, 0, delimiter, rename)
    unit = _TIME.fullmatch(file.cells(0, delimiter)[0].lower())
    assert unit is not None
    time = columns.one('time')
    times = (np.full(1, np.nan) if time is None else time) * TIME_UNITS[unit[1].replace('μ', 'µ')]

    def quantity(sensor: str) -> Quantity:
        known = _UNITS[sensor]
        if sensor in units and units[sensor] not in known:
            raise SensorLogError(
                f'{file.name}: {sensor} in {units[sensor] or "no unit"!r}, expected one of {", ".join(known)}'
            )
        return Quantity([f'{sensor} {axis}' for axis in 'xyz'], known.get(units.get(sensor, ''), 1.0))

    return columns.log(
        KIND,
        times,
        orientations=columns.vector(Quantity([f'quaternion {axis}' for axis in 'xyzw'])),
        angular_velocities=columns.vector(quantity('gyroscope')),
        accelerations=columns.vector(quantity('accelerometer')),
        fields=columns.vector(quantity('magnetometer')),
    )
