"""The formats of logs that are read: recognised by what is in a file, not by its name.

A further one is a module with `KIND`, `matches` and `read`, and a line here.
"""

from pathlib import Path
from typing import Protocol

from sesa2.imu_logs import mt_manager, sensor_logger, trajectory_log, xio_csv, xsens_dot
from sesa2.imu_logs.sensor_log import SensorLog, SensorLogError
from sesa2.mocap.export_file import ExportFile


class LogReader(Protocol):
    """A module that reads one format."""

    KIND: str

    def matches(self, file: ExportFile) -> bool:
        """Whether a file is of this format."""

    def read(self, file: ExportFile) -> SensorLog:
        """Read such a file."""


# MT Manager's is last of Xsens's: a DOT's columns are counted too.
LOG_READERS: tuple[LogReader, ...] = (sensor_logger, xio_csv, xsens_dot, mt_manager, trajectory_log)


def log_reader(file: ExportFile) -> LogReader | None:
    """Who reads a file as the log of one sensor; None where nobody does."""
    return next((reader for reader in LOG_READERS if reader.matches(file)), None)


def read_sensor_log(path: Path) -> SensorLog:
    """Read the log of one sensor.

    Raises
    ------
    Sesa2Error
        it is of no format that is known, or not whole.
    """
    if path.is_dir():
        there = ', '.join(sorted(p.name for p in path.iterdir() if p.suffix.lower() in ('.csv', '.txt')))
        raise SensorLogError(
            f'{path} is a folder, expected the log of one sensor; in it are: {there or "none"}'
        )
    file = ExportFile.load(path)
    reader = log_reader(file)
    if reader is None:
        kinds = ', '.join(one.KIND for one in LOG_READERS)
        raise SensorLogError(
            f'{file.name}: no log of one sensor that is known ({kinds}); it begins with {file.head[0][:60]!r}'
        )
    return reader.read(file)
