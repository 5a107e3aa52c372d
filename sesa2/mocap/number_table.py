"""The numbers below the header of a text file, fast.

An hour of motion capture has 10 million numbers, for which numpy's readers take seconds. Most of what exports write
is plain decimals: without their points they are integers, which numpy reads at 15 ns each, and the place of the point
says by which power of ten to divide. What is not like that is read line by line, and errors are found there.
"""

import csv
import math
import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sesa2.errors import shown
from sesa2.mocap.capture import MocapError
from sesa2.shape.rotations import FloatArray

_NOT_SEEN = {'', 'nan', 'na', 'n/a', 'null', 'none', '-', '.'}
_GAP = b'-9223372036854775807'
_LARGEST = 9_200_000_000_000_000_000  # beyond it, digits were lost
_POWERS = 10.0 ** np.arange(23)  # as far as they are exact
_BLOCK = 500_000  # bytes at once: all that is made of them stays in the cache


class NumberTable(NamedTuple):
    """Numbers of a file.

    Attributes
    ----------
    rows : (n, k)
        NaN where a cell is empty.
    lines : (n,)
        of the file, from 1.
    notes
        what was left out, one sentence each.
    """

    rows: FloatArray
    lines: np.ndarray
    notes: tuple[str, ...]


def read_numbers(
    data: bytes,
    begin: int,
    columns: Sequence[int],
    *,
    end: int | None = None,
    delimiter: str,
    names: Sequence[str],
    where: str,
    first_line: int,
    short_rows: bool = False,
    width: int | None = None,
) -> NumberTable:
    """Read columns of numbers.

    A decimal comma is understood where cells are not separated by commas, or stand in quotes.

    Parameters
    ----------
    data
        the file.
    begin
        where its first line of numbers begins.
    columns
        to read, counted from 0.
    end
        where the numbers end; with the file where it is None.
    delimiter
        between cells; a blank stands for any number of blanks.
    names
        of the columns, for messages.
    where
        the file, for messages.
    first_line
        number of the first line of numbers, from 1.
    short_rows
        a row may lack cells at its end: they are empty. Otherwise that is an error, but in the last line of a file cut
        short.
    width
        how many cells the header has, where more below are refused: decimal commas between commas.

    Raises
    ------
    MocapError
        a cell is not a number (with its line), a line has too few, or there is none.
    """
    columns, line = list(columns), first_line
    rows: list[FloatArray] = []
    lines: list[np.ndarray] = []
    notes: list[str] = []
    end = len(data) if end is None else end
    if width is not None and delimiter == ',':
        _check_width(data[begin : data.find(b'\n', begin, end) + 1 or end], width, f'{where}, line {line}')
    while begin < end:
        block_end = data.find(b'\n', begin + _BLOCK, end) + 1 or end
        block = data[begin:block_end]
        numbers = _plain_decimals(block, columns, delimiter)
        if numbers is None:
            numbers, at = _any_numbers(
                block, columns, delimiter, names, where, line, short_rows, block_end == end, notes
            )
        else:
            at = np.arange(len(numbers)) + line
        rows.append(numbers)
        lines.append(at)
        line += block.count(b'\n')
        begin = block_end
    if not sum(map(len, rows)):
        raise MocapError(f'{where} has no samples below its header')
    return NumberTable(np.concatenate(rows), np.concatenate(lines), tuple(notes))


def _check_width(line: bytes, width: int, where: str) -> None:
    cells = _cells(line.decode('latin-1').rstrip(), ',')
    if any(cell.strip() for cell in cells[width:]):
        raise MocapError(
            f'{where}: {len(cells)} cells below {width} names: decimal commas between commas? '
            'Expected decimal points, or semicolons between the cells'
        )


def _cells(line: str, delimiter: str | None) -> list[str]:
    """A line's cells; one in quotes may hold the delimiter, which then is a decimal comma."""
    if '"' not in line or delimiter is None:
        return line.replace('"', '').split(delimiter)
    line = line.replace('\0', '\ufffd')  # no number either, but csv stumbles at a NUL until Python 3.11
    return [cell.replace(',', '.') for cell in next(csv.reader([line], delimiter=delimiter))]


def _plain_decimals(block: bytes, columns: list[int], delimiter: str) -> FloatArray | None:
    """The columns of lines of equally many plain decimals or empty cells; None if the lines are not like that."""
    mark = delimiter.encode()
    if b'N' in block or b'n' in block:
        for word in (b'NaN', b'nan', b'NAN'):
            block = block.replace(word, b'')
    point = b',' if delimiter != ',' and b',' in block else b'.'
    block = block if block.endswith(b'\n') else block + b'\n'
    text = np.frombuffer(block, np.uint8)
    new_lines = text == ord('\n')
    n_rows = int(np.count_nonzero(new_lines))
    is_end = new_lines | (text == mark[0])
    places = np.flatnonzero(is_end | (text == point[0]))
    alike = _lines_alike(text, places, n_rows, block, mark, point, columns)
    if alike is not None:
        return alike
    is_end = is_end[places]
    cells = np.flatnonzero(is_end)
    ends = places[cells]
    empty = np.diff(ends, prepend=-1) == 1
    gaps = empty.any()
    last = text[ends - 1]
    if not _digits(last[~empty] if gaps else last) or not _digits(text[places[~is_end] + 1]):
        return None
    if gaps:
        if delimiter == ' ':  # several blanks are one
            return None
        # An empty cell gets a number of its own, which shifts none of the points.
        block = block.replace(mark + mark, mark + _GAP + mark).replace(mark + mark, mark + _GAP + mark)
        block = block.replace(mark + b'\n', mark + _GAP + b'\n').replace(b'\n' + mark, b'\n' + _GAP + mark)
        block = _GAP + block if block[:1] == mark else block
    width, left = divmod(len(cells), n_rows)
    if left or max(columns) >= width or not new_lines[ends[width - 1 :: width]].all():
        return None
    integers = _integers(block, mark, point, len(cells))
    if integers is None:
        return None
    before = cells - 1
    pointed = ~is_end[before]
    pointed[0] = cells[0] > 0
    decimals = np.where(pointed, ends - places[before] - 1, 0)
    # Each point must be in a cell of its own.
    if len(places) - len(cells) != np.count_nonzero(pointed):
        return None
    decimals = decimals.reshape(n_rows, width)[:, columns]
    values = integers.reshape(n_rows, width)[:, columns]
    if gaps:
        empty = empty.reshape(n_rows, width)[:, columns]
        values[empty] = 0
    if values.max() > _LARGEST or values.min() < -_LARGEST or decimals.max() >= len(_POWERS):
        return None
    rows = values / _POWERS[decimals]
    if gaps:
        rows[empty] = np.nan
    return rows


def _lines_alike(
    text: np.ndarray,
    places: np.ndarray,
    n_rows: int,
    block: bytes,
    mark: bytes,
    point: bytes,
    columns: list[int],
) -> FloatArray | None:
    """The same, of lines that have marks and points in the same order, and columns with decimals of their own."""
    each, left = divmod(len(places), n_rows)
    if left:
        return None
    kinds = text[places].reshape(n_rows, each)
    first = kinds[0]
    if first[-1] != ord('\n') or (kinds != first).any():
        return None
    ends = np.flatnonzero(first != point[0])
    before = ends - 1
    pointed = np.isin(before, np.flatnonzero(first == point[0]))
    if np.count_nonzero(pointed) != each - len(ends) or max(columns) >= len(ends):
        return None
    steps = np.diff(places, prepend=-1).reshape(n_rows, each)[:, ends]
    decimals = np.where(pointed, steps[0] - 1, 0)
    if (steps[:, pointed] != steps[0, pointed]).any() or (steps[:, ~pointed] == 1).any():
        return None
    of_lines = places.reshape(n_rows, each)
    if not _digits(text[of_lines[:, ends] - 1]) or not _digits(text[of_lines[:, before[pointed]] + 1]):
        return None
    integers = _integers(block, mark, point, n_rows * len(ends))
    if (
        integers is None
        or integers.max() > _LARGEST
        or integers.min() < -_LARGEST
        or decimals.max() >= len(_POWERS)
    ):
        return None
    return integers.reshape(n_rows, len(ends))[:, columns] / _POWERS[decimals[columns]]


def _digits(characters: np.ndarray) -> bool:
    """Whether all are digits: at the end of each cell and behind each point, so that no sign or blank passes for 0."""
    return bool((characters - np.uint8(ord('0')) < 10).all())


def _integers(block: bytes, mark: bytes, point: bytes, n: int) -> np.ndarray | None:
    """Its n cells as if there were no points; None if one is not a number."""
    # One more at the end, so that the last cell is known to end where its number does.
    digits = block.translate(bytes.maketrans(mark + b'\n', b',,'), point) + b'0'
    with warnings.catch_warnings():
        warnings.simplefilter('error', DeprecationWarning)
        try:
            return np.fromstring(digits, dtype=np.int64, count=n + 1, sep=',')[:-1]
        except (DeprecationWarning, ValueError):
            return None


def _any_numbers(
    block: bytes,
    columns: list[int],
    delimiter: str,
    names: Sequence[str],
    where: str,
    first_line: int,
    short_rows: bool,
    is_last: bool,
    notes: list[str],
) -> tuple[FloatArray, np.ndarray]:
    """The columns of lines of any kind, and the numbers of the lines."""
    text = block.decode('latin-1').removesuffix('\n')
    blank = None if delimiter == ' ' else delimiter
    comma = delimiter != ','
    needed = max(columns) + 1
    rows: list[list[float]] = []
    numbers: list[int] = []
    short = 0
    for number, line in enumerate(text.split('\n'), start=first_line):
        if not line.strip(f'{delimiter} "'):
            continue
        if short:
            break
        cells = _cells(line, blank)
        if len(cells) < needed:
            if not short_rows:
                short = number  # forgiven if it is the last one: a file cut short
                continue
            cells += [''] * (needed - len(cells))
        row = []
        for column, name in zip(columns, names, strict=True):
            cell = cells[column].strip()
            row.append(_number(cell.replace(',', '.') if comma else cell, f'{where}, line {number}: {name}'))
        rows.append(row)
        numbers.append(number)
    else:
        if short and is_last:
            notes.append(f'{where} was cut short: its last line, {short}, is incomplete and left out')
            short = 0
    if short:
        raise MocapError(f'{where}, line {short}: fewer cells than the {needed} expected')
    return np.array(rows).reshape(len(rows), len(columns)), np.array(numbers, dtype=int)


def _number(text: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan if text.lower() in _NOT_SEEN else math.inf
    if math.isinf(value):
        raise MocapError(f'{what} is {shown(text)}, expected a number')
    return value
