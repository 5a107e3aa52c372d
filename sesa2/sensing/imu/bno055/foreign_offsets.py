"""Offsets of one BNO055 as other programs keep them: registers in hex, JSON and YAML of several drivers, printed lists.

Adafruit's libraries for Arduino, CircuitPython and Python, Bosch's driver and the ROS driver of flynneva name the same
eleven numbers each in its own way: by sensor, by kind (offset or radius) and by axis, in any order.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from sesa2.errors import Sesa2Error, shown

N_BYTES = 22
N_WORDS = 11
KEYS = ('accel_offset', 'mag_offset', 'gyro_offset', 'accel_radius', 'mag_radius')

_SENSORS = {
    **dict.fromkeys(('acc', 'accel', 'accelerometer', 'acceleration'), 'accel'),
    **dict.fromkeys(('mag', 'magnet', 'magnetometer', 'magnetic'), 'mag'),
    **dict.fromkeys(('gyr', 'gyro', 'gyroscope'), 'gyro'),
}
_OFFSET = frozenset(('offset', 'offsets'))
_RADIUS = frozenset(('radius', 'radii', 'r'))
_AXES = ('x', 'y', 'z')
_WORDS = re.compile(r'[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+')
_HEX = re.compile(r'(?:0x)?([0-9a-f]+)', re.IGNORECASE)
_BETWEEN = re.compile(r'[\s,;:{}\[\]()"\']+')


class ForeignOffsetsError(Sesa2Error):
    """Something that holds no offsets of one chip; says why."""


def int16_of(value: object) -> int:
    """A register's number, given as int16 or as the uint16 of the same bits.

    Raises
    ------
    ForeignOffsetsError
        it is no whole number, or has more than 16 bits.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not -32768 <= value <= 65535:
        raise ForeignOffsetsError(
            f'expected a whole number from -32768 to 32767, or its bits as 0 to 65535, got {shown(value)}'
        )
    return value - 65536 if value > 32767 else value


def words_in_hex(text: str) -> list[int] | None:
    """The eleven words, int16, of a text that has registers 0x55 to 0x6A and nothing else.

    Comments after `#` and `//` are passed over. Bytes stand alone (`E9 FF`, `0xE9, 0xff`, `E9:FF`) or without anything
    between; numbers of 0x and four digits are words.

    Returns
    -------
    None where the text is something else.

    Raises
    ------
    ForeignOffsetsError
        it is hexadecimal and not of 22 bytes, or may be read in two ways.
    """
    bare = re.sub(r'(#|//).*', '', text)
    groups = [group for group in _BETWEEN.split(bare) if group]
    found = [_HEX.fullmatch(group) for group in groups]
    if not groups or not all(found):
        return None
    digits = [match[1] for match in found if match]
    marked = all(group[:2].lower() == '0x' for group in groups)
    if len(digits) == N_WORDS and all(len(d) == 4 for d in digits):
        if marked:
            return [int16_of(int(d, 16)) for d in digits]
        raise ForeignOffsetsError(
            'groups of four digits may be words or pairs of bytes: put 0x before each word, or a blank between bytes'
        )
    joined = ''.join(digits)
    if any(len(d) % 2 for d in digits) or len(joined) != 2 * N_BYTES:
        if marked or re.search('[a-f]', joined, re.IGNORECASE) or len(digits) == 1:
            raise ForeignOffsetsError(
                f'{len(joined)} digits in hexadecimal, expected {2 * N_BYTES}: registers 0x55 to 0x6A'
            )
        return None
    if any(c not in '0123456789' for c in joined) or marked or len(digits) == 1:
        return _words(bytes.fromhex(joined))
    raise ForeignOffsetsError(
        'these may be bytes in hexadecimal or in decimal: put 0x before each in hexadecimal'
    )


def words_of(document: Any) -> list[int]:
    """The eleven words, int16, in the order of the registers, of a document in JSON or YAML.

    Parameters
    ----------
    document
        a mapping whose keys name sensor, kind and axis, at any depth; a list of 22 bytes or 11 words; or a text as
        `words_in_hex` takes it.

    Raises
    ------
    ForeignOffsetsError
        a number is missing, stands twice, or is none.
    """
    if isinstance(document, str):
        if words := words_in_hex(document):
            return words
        raise ForeignOffsetsError(f'expected offsets, got {shown(document)}')
    if isinstance(document, list):
        return _words_of_list(document)
    found: dict[str, int] = {}
    for key, value in _leaves(document, ()):
        if key in found:
            raise ForeignOffsetsError(f'{key} stands there twice')
        try:
            found[key] = int16_of(value)
        except ForeignOffsetsError as error:
            raise ForeignOffsetsError(f'{key}: {error}') from None
    names = [f'{key}[{axis}]' for key in KEYS[:3] for axis in _AXES] + list(KEYS[3:])
    missing = [name for name in names if name not in found]
    if missing:
        raise ForeignOffsetsError(
            f'{", ".join(missing)} missing' if found else 'no offsets of a BNO055 in it'
        )
    return [found[name] for name in names]


def _words_of_list(values: list[Any]) -> list[int]:
    if len(values) == N_BYTES and all(type(v) is int and 0 <= v <= 255 for v in values):
        return _words(bytes(values))
    if len(values) != N_WORDS:
        raise ForeignOffsetsError(
            f'a list of {len(values)}, expected {N_BYTES} bytes or {N_WORDS} whole numbers, as the registers have them'
        )
    return [int16_of(value) for value in values]


def _words(data: bytes) -> list[int]:
    return [int.from_bytes(data[k : k + 2], 'little', signed=True) for k in range(0, N_BYTES, 2)]


def _leaves(value: Any, path: tuple[str, ...]) -> Iterator[tuple[str, object]]:
    """Every number with its name, `accel_offset[x]` or `accel_radius`; what is not about offsets is passed over."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _leaves(inner, (*path, str(key)))
        return
    words = [[word.lower() for word in _WORDS.findall(key)] for key in path]
    known = {*_SENSORS, *_OFFSET, *_RADIUS, *_AXES}
    if not words or not words[-1] or not set(words[-1]) <= known:
        return
    flat = [word for key in words for word in key]
    sensors = [_SENSORS[word] for word in flat if word in _SENSORS]
    axes = [word for word in flat if word in _AXES]
    if not sensors:
        return
    if _RADIUS & set(flat):
        yield f'{sensors[-1]}_radius', _number(value)
        return
    name = f'{sensors[-1]}_offset'
    if axes:
        yield f'{name}[{axes[-1]}]', _number(value)
        return
    numbers = [_number(v) for v in _BETWEEN.split(value.strip())] if isinstance(value, str) else value
    if not isinstance(numbers, list) or len(numbers) not in (3, 4):
        raise ForeignOffsetsError(f'{name}: expected a list of 3 whole numbers [x, y, z], got {shown(value)}')
    yield from ((f'{name}[{axis}]', number) for axis, number in zip(_AXES, numbers, strict=False))
    if len(numbers) == 4:  # x, y, z and the radius, as Bosch's driver has them
        yield f'{sensors[-1]}_radius', numbers[3]


def _number(value: object) -> object:
    """A text that is a whole number, as one."""
    if isinstance(value, str):
        try:
            return int(value, 0)
        except ValueError:
            pass
    return value
