"""Trajectories of one body, TUM's and EuRoC's, for their orientations: motion capture of one IMU a file."""

from sesa2.imu_logs.sensor_log import SensorLog
from sesa2.mocap import euroc_csv, tum_file
from sesa2.mocap.export_file import ExportFile

KIND = 'trajectory (TUM, EuRoC)'


def matches(file: ExportFile) -> bool:
    """Whether it is one."""
    return euroc_csv.matches(file) or tum_file.matches(file)


def read(file: ExportFile) -> SensorLog:
    """Read it.

    Raises
    ------
    MocapError
        a column is missing, or its numbers are none.
    """
    capture = (euroc_csv if euroc_csv.matches(file) else tum_file).read(file)
    (body,) = capture.bodies.values()
    return SensorLog(KIND, body.times, body.orientations, notes=capture.notes)
