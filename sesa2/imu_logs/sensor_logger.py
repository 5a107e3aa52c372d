"""Orientation.csv of the app Sensor Logger: time in ns since 1970, seconds_elapsed, qz, qy, qx, qw, and angles.

Source: the app's page on its file formats (github.com/tszheichoi/awesome-sensor-logger).
"""

from sesa2.imu_logs.sensor_log import LogColumns, Quantity, SensorLog, SensorLogError
from sesa2.mocap.export_file import ExportFile
from sesa2.time import NS

KIND = 'Sensor Logger'


def matches(file: ExportFile) -> bool:
    """Whether its columns are the app's."""
    return 'seconds_elapsed' in [cell.lower() for cell in file.cells(0, ',')]


def read(file: ExportFile) -> SensorLog:
    """Read it.

    Raises
    ------
    SensorLogError
        it is another of the app's files.
    """
    columns = LogColumns(file, 0, ',')
    orientations = columns.vector(Quantity(('qx', 'qy', 'qz', 'qw')))
    if orientations is None:
        raise SensorLogError(
            f'{file.name} ({KIND}): no columns qx, qy, qz, qw, which its Orientation.csv has'
        )
    since_1970, elapsed = columns.one('time'), columns.one('seconds_elapsed')
    times = since_1970 / NS if since_1970 is not None else elapsed
    if times is None:
        raise SensorLogError(f'{file.name} ({KIND}): time and seconds_elapsed are empty')
    return columns.log(KIND, times, orientations=orientations)
