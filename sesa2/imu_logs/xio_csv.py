"""CSV of x-io Technologies' x-IMU3 and NGIMU: columns that say their unit, as in `Gyroscope X (deg/s)`.

Quaternions are in files of their own, W, X, Y, Z with or without `Quaternion` in front, and of the sensor in the earth
frame, whose z is up. An x-IMU3 logs its magnetometer apart too, into the Magnetometer.csv beside its Inertial.csv, with
the columns X (a.u.), formerly X Axis (a.u.), … at a lower rate: each field is taken with the sample nearest in time.
Source: the user manuals of the x-IMU3 and of the NGIMU; the logs in github.com/xioTechnologies/x-IMU3-CSV.
"""

import re
from pathlib import Path

import numpy as np

from sesa2.imu_logs.sensor_log import (
    UNITS_OF,
    LogColumns,
    Quantity,
    SensorLog,
    SensorLogError,
)
from sesa2.mocap.export_file import ExportFile, delimiter_of
from sesa2.mocap.time_units import TIME_UNITS
from sesa2.shape.rotations import FloatArray

KIND = 'x-io CSV'
_TIME = re.compile(r'time(?:stamp)?\s*\(\s*(s|ms|us|µs|μs|ns)\s*\)')
_COMPONENT = re.compile(
    r'(?:(gyroscope|accelerometer|magnetometer|quaternion)\s*(?:element)?\s*)?([wxyz])(?:\s*axis)?(?:\s*\(\s*([^)]*?)\s*\))?'
)
# Units that tell that it is a magnetic field where no sensor is named; g is also that of accelerations.
_OF_FIELDS_ALONE = {unit for unit in UNITS_OF['magnetometer'] if unit != 'g'}
_NEAR = 2.0  # samples' periods: what was measured in a gap has no sample


def matches(file: ExportFile) -> bool:
    """Whether its first column is a time with its unit, and others are those of such an IMU."""
    cells = [cell.lower() for cell in file.cells(0, delimiter_of(file.head[0]))]
    timed = bool(cells) and _TIME.fullmatch(cells[0]) is not None
    return timed and any(_COMPONENT.fullmatch(cell) for cell in cells[1:])


def read(file: ExportFile) -> SensorLog:
    """Read it, and the magnetic field beside it.

    Raises
    ------
    SensorLogError
        a unit is not known, or it has no orientation and nothing to fuse.
    """
    found = _XioColumns(file)
    fields = found.vector('magnetometer')
    notes: tuple[str, ...] = ()
    if fields is None and found.has('gyroscope') and (beside := _magnetometer_beside(file.path)):
        fields, notes = _field_at(found.times, beside)
    return found.columns.log(
        KIND,
        found.times,
        notes,
        orientations=found.columns.vector(Quantity([f'quaternion {axis}' for axis in 'xyzw'])),
        angular_velocities=found.vector('gyroscope'),
        accelerations=found.vector('accelerometer'),
        fields=fields,
    )


class _XioColumns:
    """The columns of a file, called `<sensor> <axis>`, and its times, s."""

    def __init__(self, file: ExportFile):
        delimiter = delimiter_of(file.head[0])
        self._name = file.name
        self._units: dict[str, str] = {}
        self.columns = LogColumns(file, 0, delimiter, self._called)
        unit = _TIME.fullmatch(file.cells(0, delimiter)[0].lower())
        assert unit is not None
        time = self.columns.one('time')
        self.times = (np.full(1, np.nan) if time is None else time) * TIME_UNITS[unit[1].replace('μ', 'µ')]

    def _called(self, cell: str) -> str:
        low = cell.lower()
        if _TIME.fullmatch(low):
            return 'time'
        match = _COMPONENT.fullmatch(low)
        if not match:
            return ''
        unit = match[3] or ''
        sensor = match[1] or (
            'quaternion' if not unit else 'magnetometer' if unit in _OF_FIELDS_ALONE else ''
        )
        if not sensor:  # an acceleration without gravity, or of the high-g accelerometer
            return ''
        self._units.setdefault(sensor, unit)
        return f'{sensor} {match[2]}'

    def has(self, sensor: str) -> bool:
        """Whether a sensor has a column."""
        return sensor in self._units

    def vector(self, sensor: str) -> FloatArray | None:
        """What a sensor measured, (n, 3), in SI; None where it is not there."""
        known, unit = UNITS_OF[sensor], self._units.get(sensor, '')
        if self.has(sensor) and unit not in known:
            raise SensorLogError(
                f'{self._name}: {sensor} in {unit or "no unit"!r}, expected one of {", ".join(known)}'
            )
        return self.columns.vector(Quantity([f'{sensor} {axis}' for axis in 'xyz'], known.get(unit, 1.0)))


def _magnetometer_beside(path: Path) -> Path | None:
    return next(
        (p for p in sorted(path.parent.glob('*')) if p.name.lower() == 'magnetometer.csv' and p != path), None
    )


def _field_at(times: FloatArray, path: Path) -> tuple[FloatArray, tuple[str, ...]]:
    """The fields of a file at the samples nearest in time, NaN at others; and what has to be said."""
    beside = _XioColumns(ExportFile.load(path))
    measured = beside.vector('magnetometer')
    fields = np.full((len(times), 3), np.nan)
    if measured is None or len(times) < 2:
        return fields, (f'{path}: no magnetic field in it',)
    order = np.argsort(times, kind='stable')
    after = np.clip(np.searchsorted(times[order], beside.times), 1, len(times) - 1)
    before = order[after - 1]
    nearest = np.where(
        beside.times - times[before] < times[order[after]] - beside.times, before, order[after]
    )
    near = np.abs(times[nearest] - beside.times) <= _NEAR * float(np.median(np.diff(times[order])))
    fields[nearest[near]] = measured[near]
    lost = int((~near).sum())
    notes = [f'{path}: {lost} of {len(near)} magnetic fields are of a time without samples'] if lost else []
    return fields, (*beside.columns.notes, *notes)
