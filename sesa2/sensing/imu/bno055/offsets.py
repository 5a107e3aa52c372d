"""Calibration offsets of the BNO055, and the file that keeps them while the chips are without power.

The chip has no memory of its own for them (thesis 4.2.4): they are read from its registers 0x55 to 0x6A once its scores
are full, kept here, and written back at every start. Beside them the file may keep the calibration of the chip's
accelerometer, which is applied where the host fuses.
"""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from sesa2.errors import Sesa2Error, shortened, shown
from sesa2.partial_files import write_whole
from sesa2.sensing.imu.accelerometer_calibration import AccelerometerCalibration, AccelerometerError
from sesa2.sensing.imu.bno055.foreign_offsets import (
    KEYS,
    ForeignOffsetsError,
    int16_of,
    words_in_hex,
    words_of,
)
from sesa2.yaml_reading import YamlError, read_small_file, read_yaml

Vector = tuple[int, int, int]

_REGISTERS = struct.Struct('<11h')
_VECTORS, _RADII = KEYS[:3], KEYS[3:]
_ACCELEROMETER = 'accelerometer'


class OffsetsError(Sesa2Error):
    """A calibration file that cannot be read, understood or written."""


@dataclass(frozen=True)
class Offsets:
    """Offsets of one chip in its own units, int16 each.

    Attributes
    ----------
    accel_offset, mag_offset, gyro_offset
        x, y, z in the sensor's frame.
    accel_radius, mag_radius
        Radii of the spheres that the fusion fits to its measurements.
    """

    accel_offset: Vector
    mag_offset: Vector
    gyro_offset: Vector
    accel_radius: int
    mag_radius: int

    @classmethod
    def from_registers(cls, registers: bytes) -> 'Offsets':
        """From the 22 bytes of registers 0x55 to 0x6A."""
        return cls.from_words(_REGISTERS.unpack(registers))

    @classmethod
    def from_words(cls, words: Sequence[int]) -> 'Offsets':
        """From eleven numbers in the order of the registers, int16."""
        x, y, z, mx, my, mz, gx, gy, gz, accel_radius, mag_radius = words
        return cls((x, y, z), (mx, my, mz), (gx, gy, gz), accel_radius, mag_radius)

    def __str__(self) -> str:
        accel, mag, gyro, *radii = astuple(self)
        return f'accel {accel}, mag {mag}, gyro {gyro}, radii {radii[0]} and {radii[1]}'

    def to_registers(self) -> bytes:
        """The 22 bytes of registers 0x55 to 0x6A."""
        accel, mag, gyro, *radii = astuple(self)
        return _REGISTERS.pack(*accel, *mag, *gyro, *radii)


class SavedOffsets(NamedTuple):
    """What a calibration file says about the IMUs that were asked for."""

    offsets: dict[int, Offsets]
    """By IMU id."""
    missing: tuple[int, ...]
    """Ids that the file has no entry for: these IMUs start uncalibrated, which the user is to be told."""


def offsets_are_there(path: Path | str) -> bool:
    """Whether there is anything where a calibration file is expected.

    Raises
    ------
    OffsetsError
        that cannot be known: a link to itself, or a path that no system takes.
    """
    try:
        Path(path).stat()
    except FileNotFoundError:
        return False
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise OffsetsError(f'calibration file {path}: cannot be read: {why}') from None
    return True


def load_offsets(path: Path | str, ids: Iterable[int]) -> SavedOffsets:
    """Read the offsets of some IMUs; entries of others are left unread.

    A file of one chip, as another program wrote it (`foreign_offsets`), will do where one IMU is asked for.

    Raises
    ------
    OffsetsError
        Naming the file and, if it is about one, the IMU, the key and what was expected.
    """
    path, ids = Path(path), tuple(ids)
    document = _read(path)
    if isinstance(document, Offsets):
        if len(ids) != 1:
            raise _of_one_chip(path, document)
        return SavedOffsets({ids[0]: document}, ())
    entries = document['imus']
    found = {
        imu_id: _parse(entries[imu_id], f'{path}: imus.{imu_id}')
        for imu_id in ids
        if imu_id in entries and not _is_accelerometer_alone(entries[imu_id])
    }
    return SavedOffsets(found, tuple(imu_id for imu_id in ids if imu_id not in found))


def save_offsets(path: Path | str, imu_id: int, offsets: Offsets, saved_at: datetime | None = None) -> None:
    """Put one IMU's offsets into the file, which is made if it does not exist; what else it says stays as it is.

    The new file takes the old one's place in one step: whatever happens meanwhile, one of the two is there, whole.

    Parameters
    ----------
    path
        The file. Of a symbolic link, the file that it points to.
    imu_id
        Whose offsets these are.
    offsets
        The offsets.
    saved_at
        Time to note beside them; by default now, UTC.

    Raises
    ------
    OffsetsError
        If the file there is no calibration file (it is not overwritten then), or the new one cannot be written
        (the old one is untouched then).
    """
    entry: dict[str, Any] = {key: list(getattr(offsets, key)) for key in _VECTORS}
    entry |= {key: getattr(offsets, key) for key in _RADII}
    entry['saved_at'] = (saved_at or datetime.now(timezone.utc)).isoformat(timespec='seconds')
    _put(Path(path), imu_id, entry, 'offsets')


def load_accelerometers(path: Path | str, ids: Iterable[int]) -> dict[int, AccelerometerCalibration]:
    """Read the accelerometers' calibrations of those of some IMUs that have one.

    Raises
    ------
    OffsetsError
        As `load_offsets`.
    """
    path = Path(path)
    document = _read(path)
    if isinstance(document, Offsets):  # of one chip, from another program
        return {}
    entries = document['imus']
    kept = {i: entries[i] for i in ids if isinstance(entries.get(i), dict) and _ACCELEROMETER in entries[i]}
    return {
        i: _parse_accelerometer(entry[_ACCELEROMETER], f'{path}: imus.{i}.{_ACCELEROMETER}')
        for i, entry in kept.items()
    }


def save_accelerometer(path: Path | str, imu_id: int, calibration: AccelerometerCalibration) -> None:
    """Put the calibration of one IMU's accelerometer into the file, as `save_offsets` does with offsets.

    Raises
    ------
    OffsetsError
        As `save_offsets`.
    """
    bias, matrix = ([round(v, 9) for v in row] for row in (calibration.bias, sum(calibration.matrix, ())))
    entry = {'bias': bias, 'matrix': [matrix[:3], matrix[3:6], matrix[6:]]}
    _put(Path(path), imu_id, {_ACCELEROMETER: entry}, "accelerometer's calibration")


def _put(path: Path, imu_id: int, entry: dict[str, Any], what: str) -> None:
    document = _read(path) if offsets_are_there(path) else {'imus': {}}
    if isinstance(document, Offsets):
        raise _of_one_chip(path, document)
    path = path.resolve()
    before = document['imus'].get(imu_id)
    document['imus'][imu_id] = {**before, **entry} if isinstance(before, dict) else entry
    text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, allow_unicode=True)
    try:
        write_whole(path, text, overwrite=True)
    except OSError as error:
        raise OffsetsError(f'{path}: {what} of IMU {imu_id} not saved: {error.strerror}') from None


def read_chip_offsets(path: Path | str) -> Offsets:
    """Read a file that holds the offsets of one chip, as another program wrote it.

    Raises
    ------
    OffsetsError
        it cannot be read, or is not of one chip.
    """
    document = _read(Path(path))
    if not isinstance(document, Offsets):
        raise OffsetsError(
            f'{path}: a calibration file of IMUs {_listed(document["imus"])}, expected that of one chip'
        )
    return document


def _of_one_chip(path: Path, offsets: Offsets) -> OffsetsError:
    return OffsetsError(
        f'{path}: offsets of one chip ({offsets}), and it does not say of which IMU; '
        f'`sesa2 offsets ID={path} --out FILE` puts them into a calibration file'
    )


def _listed(ids: Iterable[int]) -> str:
    return ', '.join(map(str, ids)) or 'none'


def _read(path: Path) -> dict[str, Any] | Offsets:
    """The document of a calibration file, or what a file of one chip says."""
    try:
        content = read_small_file(path)
        words = words_in_hex(content.decode('utf-8-sig', 'replace'))
        if words:
            return Offsets.from_words(words)
        document = read_yaml(content)
    except YamlError as error:
        place = f'{path}, {error.place}' if error.place else f'calibration file {path}'
        raise OffsetsError(f'{place}: {error.problem}') from None
    except ForeignOffsetsError as error:
        raise OffsetsError(f'{path}: {error}') from None
    if not isinstance(document, dict) or not isinstance(document.get('imus'), dict):
        try:
            return Offsets.from_words(words_of(document))
        except ForeignOffsetsError as error:
            raise OffsetsError(
                f'{path}: no calibration file ({error}), expected a mapping '
                '"imus: {1: {accel_offset: [x, y, z], mag_offset: …, gyro_offset: …, accel_radius: …, mag_radius: …}}"'
            ) from None
    for imu_id in document['imus']:
        if isinstance(imu_id, bool) or not isinstance(imu_id, int):
            raise OffsetsError(
                f'{path}: imus.{shortened(str(imu_id))}: an IMU is named by its id, a whole number'
            )
    return document


def _parse(entry: object, place: str) -> Offsets:
    if not isinstance(entry, dict):
        raise OffsetsError(f'{place}: expected a mapping of offsets, got {shown(entry)}')
    if not set(entry) & {*KEYS}:  # as another program names them
        try:
            return Offsets.from_words(words_of(entry))
        except ForeignOffsetsError as error:
            raise OffsetsError(f'{place}: {error}') from None
    for key in (*_VECTORS, *_RADII):
        if key not in entry:
            raise OffsetsError(f'{place}: key {key} is missing')
    accel, mag, gyro = (_vector(entry[key], f'{place}.{key}') for key in _VECTORS)
    accel_radius, mag_radius = (_int16(entry[key], f'{place}.{key}') for key in _RADII)
    return Offsets(accel, mag, gyro, accel_radius, mag_radius)


def _is_accelerometer_alone(entry: object) -> bool:
    return isinstance(entry, dict) and set(entry) == {_ACCELEROMETER}


def _parse_accelerometer(entry: object, place: str) -> AccelerometerCalibration:
    if not isinstance(entry, dict) or not {'bias', 'matrix'} <= set(entry):
        raise OffsetsError(
            f'{place}: expected a mapping {{bias: [x, y, z], matrix: [[…], […], […]]}}, got {shown(entry)}'
        )
    bias, matrix = entry['bias'], entry['matrix']
    rows = matrix if isinstance(matrix, list) and len(matrix) == 3 else [None]
    for value, key in ((bias, 'bias'), *((row, f'matrix[{k}]') for k, row in enumerate(rows))):
        number = isinstance(value, list) and len(value) == 3 and all(type(v) in (int, float) for v in value)
        if not number:
            raise OffsetsError(f'{place}.{key}: expected a list of 3 numbers, got {shown(value)}')
    try:
        return AccelerometerCalibration(
            tuple(map(float, bias)), tuple(tuple(map(float, row)) for row in matrix)
        )
    except AccelerometerError as error:
        raise OffsetsError(f'{place}: {error}') from None


def _vector(value: object, place: str) -> Vector:
    if not isinstance(value, list) or len(value) != 3:
        raise OffsetsError(f'{place}: expected a list of 3 whole numbers [x, y, z], got {shown(value)}')
    x, y, z = (_int16(number, f'{place}[{k}]') for k, number in enumerate(value))
    return x, y, z


def _int16(value: object, place: str) -> int:
    try:
        return int16_of(value)
    except ForeignOffsetsError as error:
        raise OffsetsError(f'{place}: {error}') from None
