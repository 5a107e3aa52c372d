"""Xsens DOT's CSV (also Movella DOT): lines about the sensor, then columns PacketCounter, SampleTimeFine, …

SampleTimeFine in µs, of a clock that synchronised sensors share; Euler angles in degrees; gyroscope in °/s,
accelerometer in m/s², magnetometer in units of the earth's field. The earth frame is east, north, up.
Source: Xsens DOT User Manual, sections on data export and on outputs.
"""

import re

from sesa2.imu_logs.sensor_log import (
    DEGREES,
    EARTH_FIELD,
    LogColumns,
    Quantity,
    SensorLog,
    SensorLogError,
    from_yaw_pitch_roll,
    header_of,
    unwrapped,
)
from sesa2.mocap.export_file import ExportFile

KIND = 'Xsens DOT'
_GROUPS = {
    'count': ('packetcounter',),
    'data': ('quat_w', 'euler_x', 'gyr_x', 'acc_x', 'sampletimefine'),
}
_CLOCK = 2.0**32  # µs, after which SampleTimeFine begins again


def matches(file: ExportFile) -> bool:
    """Whether its columns are a DOT's; lines that begin with // are those of MT Manager."""
    about = any(line.startswith('//') for line in file.head)
    return (
        not about and 'quat_q0' not in '\n'.join(file.head).lower() and header_of(file, _GROUPS) is not None
    )


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
    clock, counter = columns.one('sampletimefine'), columns.one('packetcounter')
    if clock is not None:
        times = unwrapped(clock, _CLOCK) * 1e-6
    else:
        rate = re.search(r'outputrate:?,?\s*([\d.]+)', '\n'.join(file.head[: found[0]]).lower())
        if counter is None or not rate:
            raise SensorLogError(f'{file.name} ({KIND}): no SampleTimeFine, and no OutputRate to count by')
        times = counter / float(rate[1])
    euler = columns.vector(Quantity(('euler_x', 'euler_y', 'euler_z'), DEGREES))
    orientations = columns.vector(Quantity(('quat_x', 'quat_y', 'quat_z', 'quat_w')))
    if orientations is None and euler is not None:
        orientations = from_yaw_pitch_roll(euler)
    return columns.log(
        KIND,
        times,
        orientations=orientations,
        angular_velocities=columns.vector(Quantity(('gyr_x', 'gyr_y', 'gyr_z'), DEGREES)),
        accelerations=columns.vector(Quantity(('acc_x', 'acc_y', 'acc_z'))),
        fields=columns.vector(Quantity(('mag_x', 'mag_y', 'mag_z'), EARTH_FIELD)),
    )
