"""What one IMU recorded, whatever wrote it, and how it is read from columns of numbers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sesa2.errors import Sesa2Error
from sesa2.mocap.export_file import ExportFile
from sesa2.mocap.number_table import read_numbers
from sesa2.shape.rotations import FloatArray, from_matrix, from_rotation_vector, multiply

GRAVITY = 9.80665  # m/s² in one g
DEGREES = float(np.pi / 180.0)
# Magnetometers that are scaled to the earth's field at the place of their calibration say 1 for about so much.
EARTH_FIELD = 5e-5  # T
# Units by what is measured, in SI.
UNITS_OF: Mapping[str, Mapping[str, float]] = {
    'gyroscope': {'deg/s': DEGREES, '°/s': DEGREES, 'dps': DEGREES, 'rad/s': 1.0},
    'accelerometer': {
        'g': GRAVITY,
        'mg': 1e-3 * GRAVITY,
        'm/s^2': 1.0,
        'm/s²': 1.0,
        'm/s/s': 1.0,
        'm/s2': 1.0,
    },
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


class SensorLogError(Sesa2Error):
    """A log that cannot be read."""


@dataclass(frozen=True, eq=False)
class SensorLog:
    """A log.

    Attributes
    ----------
    kind
        what wrote it, e.g. `Xsens DOT`.
    times : (n,)
        s, of the log's own clock.
    orientations : (n, 4)
        q_WS, x y z w; NaN where there is none. None of a log without.
    angular_velocities, accelerations : (n, 3)
        rad/s and, with gravity, m/s², in the sensor's axes; None of a log without.
    fields : (n, 3)
        magnetic field, T, in the sensor's axes; None of a log without.
    notes
        what a reader has to know, one sentence each.
    """

    kind: str
    times: FloatArray
    orientations: FloatArray | None = None
    angular_velocities: FloatArray | None = None
    accelerations: FloatArray | None = None
    fields: FloatArray | None = None
    notes: tuple[str, ...] = ()


class Quantity(NamedTuple):
    """Names of the columns of a vector, and what its unit is in SI."""

    names: Sequence[str]
    unit: float = 1.0


class LogColumns:
    """The columns of a log below its header.

    Parameters
    ----------
    file
        the log.
    header_line
        where the columns are named, from 0.
    delimiter
        between them.
    rename
        what a column is called here; its name in lower case where it is None.
    """

    def __init__(
        self,
        file: ExportFile,
        header_line: int,
        delimiter: str,
        rename: Callable[[str], str] | None = None,
    ):
        self._file = file
        header = [(rename or str.lower)(cell) for cell in file.cells(header_line, delimiter)]
        self._at = {name: k for k, name in reversed(list(enumerate(header))) if name}
        columns = sorted(self._at.values())
        table = read_numbers(
            file.data,
            file.after(header_line + 1),
            columns,
            delimiter=delimiter,
            names=[header[c] for c in columns],
            where=file.name,
            first_line=header_line + 2,
            short_rows=True,
            width=len(header),
        )
        self.notes = table.notes
        self._column = {name: table.rows[:, columns.index(k)] for name, k in self._at.items()}

    def __contains__(self, name: str) -> bool:
        return name in self._column

    def one(self, name: str) -> FloatArray | None:
        """A column, (n,); None where it is not there, or empty."""
        column = self._column.get(name)
        return None if column is None or np.isnan(column).all() else column

    def vector(self, *choices: Quantity) -> FloatArray | None:
        """The first quantity that is there, (n, k), in SI; None where none is.

        Raises
        ------
        SensorLogError
            only a part of it is there.
        """
        for names, unit in choices:
            there = [name for name in names if name in self]
            if there and len(there) < len(names):
                missing = next(name for name in names if name not in self)
                raise SensorLogError(f'{self._file.name}: has a column {there[0]}, but none {missing}')
            if there:
                return unit * np.stack([self._column[name] for name in names], axis=-1)
        return None

    def log(
        self, kind: str, times: FloatArray, notes: Sequence[str] = (), **vectors: FloatArray | None
    ) -> SensorLog:
        """The log of these.

        Raises
        ------
        SensorLogError
            it has neither orientations nor what they are fused from, or a sample without time.
        """
        if np.isnan(times).any():
            raise SensorLogError(
                f'{self._file.name}: sample {int(np.argmax(np.isnan(times))) + 1} has no time'
            )
        whole = vectors.get('orientations') is not None or (
            vectors.get('angular_velocities') is not None and vectors.get('accelerations') is not None
        )
        if not whole:
            raise SensorLogError(
                f'{self._file.name} ({kind}): no quaternion, and not both gyroscope and accelerometer; '
                f'its columns: {", ".join(self._at)}'
            )
        return SensorLog(kind, times, notes=(*self.notes, *notes), **vectors)


def unwrapped(counter: FloatArray, size: float) -> FloatArray:
    """A counter that begins again at 0 after `size`, without its steps back."""
    steps = np.diff(counter)
    return counter + size * np.concatenate([[0], np.cumsum(steps < -0.5 * size)])


def from_yaw_pitch_roll(angles: FloatArray) -> FloatArray:
    """Q = Rz(yaw) Ry(pitch) Rx(roll), (n, 4), x y z w, of roll, pitch, yaw, (n, 3), rad."""
    roll, pitch, yaw = (from_rotation_vector(angles[:, [k]] * np.eye(3)[k]) for k in range(3))
    return multiply(multiply(yaw, pitch), roll)


def from_rows(entries: FloatArray) -> FloatArray:
    """Quaternions (n, 4), x y z w, of rotation matrices whose entries stand row by row, (n, 9)."""
    return from_matrix(entries.reshape(-1, 3, 3))


def header_of(file: ExportFile, wanted: Mapping[str, Sequence[str]]) -> tuple[int, str] | None:
    """The first line of a file that names any column of each of some groups, and what stands between its cells."""
    for line, text in enumerate(file.head):
        low = text.lower()
        if all(any(name in low for name in names) for names in wanted.values()):
            return line, max(',;\t', key=text.count)
    return None
