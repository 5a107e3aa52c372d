"""What Xsens MT Manager exports of an MTw or MTi: lines after //, then columns between tabs, semicolons or commas.

Samples are counted, and the header tells their rate; the counters of an Awinda station's sensors go together. Without a
rate SampleTimeFine tells the time, in steps of 0.1 ms. Gyroscope in rad/s, accelerometer in m/s², magnetometer in units
of the earth's field, angles in degrees. Mat[r][c] is row r, column c of the rotation from sensor to earth.
Source: MT Manager User Manual, section on export; MT Low-Level Communication Protocol, SampleTimeFine.
"""

import re

from sesa2.imu_logs.sensor_log import (
    DEGREES,
    EARTH_FIELD,
    LogColumns,
    Quantity,
    SensorLog,
    SensorLogError,
    from_rows,
    from_yaw_pitch_roll,
    header_of,
    unwrapped,
)
from sesa2.mocap.export_file import ExportFile

KIND = 'Xsens MT Manager'
_GROUPS = {
    'count': ('counter', 'sampletimefine'),
    'data': ('quat_', 'mat[1][1]', 'roll', 'gyr_x'),
}
_COUNTS = 65536.0
_TICKS = 2.0**32
_TICK = 1e-4  # s
_MATRIX = tuple(f'mat[{row}][{column}]' for row in (1, 2, 3) for column in (1, 2, 3))


def matches(file: ExportFile) -> bool:
    """Whether its columns are counted, and MT Manager's."""
    return header_of(file, _GROUPS) is not None


def read(file: ExportFile) -> SensorLog:
    """Read it.

    Raises
    ------
    SensorLogError
        it has no orientation and nothing to fuse, or no time.
    """
    found = header_of(file, _GROUPS)
    assert found is not None
    columns = LogColumns(file, *found)
    about = '\n'.join(file.head[: found[0]])
    rate = re.search(r'(?:update|sample|output) ?rate\s*[:=,]?\s*([\d.]+)', about, re.IGNORECASE)
    counter = columns.one('packetcounter' if 'packetcounter' in columns else 'counter')
    ticks = columns.one('sampletimefine')
    if counter is not None and rate and float(rate[1]) > 0.0:
        times = unwrapped(counter, _COUNTS) / float(rate[1])
    elif ticks is not None:
        times = unwrapped(ticks, _TICKS) * _TICK
    else:
        raise SensorLogError(
            f'{file.name} ({KIND}): no time: expected a line "// Update Rate: 100.0Hz", or the column SampleTimeFine'
        )
    angles = columns.vector(Quantity(('roll', 'pitch', 'yaw'), DEGREES))
    matrix = columns.vector(Quantity(_MATRIX))
    orientations = columns.vector(
        Quantity(('quat_x', 'quat_y', 'quat_z', 'quat_w')),
        Quantity(('quat_q1', 'quat_q2', 'quat_q3', 'quat_q0')),
    )
    if orientations is None and matrix is not None:
        orientations = from_rows(matrix)
    if orientations is None and angles is not None:
        orientations = from_yaw_pitch_roll(angles)
    return columns.log(
        KIND,
        times,
        orientations=orientations,
        angular_velocities=columns.vector(Quantity(('gyr_x', 'gyr_y', 'gyr_z'))),
        accelerations=columns.vector(Quantity(('acc_x', 'acc_y', 'acc_z'))),
        fields=columns.vector(Quantity(('mag_x', 'mag_y', 'mag_z'), EARTH_FIELD)),
    )
