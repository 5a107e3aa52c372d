"""The numbers below the header of a text file, fast.

An hour of motion capture has 10 million numbers, for which numpy's readers take seconds. Most of what exports write
is plain decimals: without their points they are integers, which numpy reads at 15 ns each, and the place of the point
says by which power of ten to divide. What is not like that is read line by line, and errors are found there.
"""

import math
import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sesa2.mocap.capture import MocapError
from sesa2.shape.rotations import FloatArray

_NOT_SEEN = {'', 'nan', 'na', 'n/a', 'null', 'none', '-'}
_GAP = b'-9223372036854775807'
_GAP_VALUE = -9223372036854775807
_LARGEST = 9_200_000_000_000_000_000  # beyond it, digits were lost


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
    body: bytes,
    columns: Sequence[int],
    *,
    delimiter: str,
    names: Sequence[str],
    where: str,
    first_line: int,
    short_rows: bool = False,
) -> NumberTable:
    """Read columns of numbers.

    A decimal comma is understood where cells are not separated by commas.

    Parameters
    ----------
    body
        of the file, from its first line of numbers on.
    columns
        to read, counted from 0.
    delimiter
        between cells; a blank stands for any number of blanks.
    names
        of the columns, for messages.
    where
        the file, for messages.
    first_line
        of the body in the file, from 1.
    short_rows
        a row may lack cells at its end: they are empty. Otherwise that is an error, but in the last line of a file cut
        short.

    Raises
    ------
    MocapError
        a cell is not a number (with its line), a line has too few, or there is none.
    """
    table = _fast(body, columns, delimiter, first_line)
    if table is None:
        table = _careful(body, columns, delimiter, names, where, first_line, short_rows)
    if not len(table.rows):
        raise MocapError(f'{where} has no samples below its header')
    return table


def _fast(body: bytes, columns: Sequence[int], delimiter: str, first_line: int) -> NumberTable | None:
    """The columns of a rectangle of plain decimals; None if it is none."""
    body = body.rstrip(b'\n') + b'\n'
    mark = delimiter.encode()
    if b'\n\n' in body or b'"' in body or body == b'\n':
        return None
    if delimiter == ' ' and (b'  ' in body or b' \n' in body or b'\n ' in body or b'\t' in body):
        return None
    point = b',' if delimiter != ',' and b',' in body else b'.'
    for word in (b'NaN', b'nan', b'NAN'):
        if word in body:
            body = body.replace(word, _GAP)
    if mark + mark in body or mark + b'\n' in body or b'\n' + mark in body or body[:1] == mark:
        body = body.replace(mark + mark, mark + _GAP + mark).replace(mark + mark, mark + _GAP + mark)
        body = body.replace(mark + b'\n', mark + _GAP + b'\n').replace(b'\n' + mark, b'\n' + _GAP + mark)
        body = _GAP + body if body[:1] == mark else body
    text = np.frombuffer(body, np.uint8)
    ends = (text == mark[0]) | (text == ord('\n'))
    n_rows = int(np.count_nonzero(text == ord('\n')))
    places = np.flatnonzero(ends | (text == point[0]))
    is_end = ends[places]
    cell_ends = np.flatnonzero(is_end)
    width, left = divmod(len(cell_ends), n_rows)
    if left or max(columns) >= width:
        return None
    at = places[cell_ends]
    if not (text[at[width - 1 :: width]] == ord('\n')).all():
        return None
    digits = body.translate(bytes.maketrans(mark + b'\n', b',,'), point)
    with warnings.catch_warnings():
        warnings.simplefilter('error', DeprecationWarning)
        try:
            integers = np.fromstring(digits, dtype=np.int64, sep=',')
        except (DeprecationWarning, ValueError):  # a cell that is no plain decimal
            return None
    before = np.maximum(cell_ends - 1, 0)
    decimals = np.where(is_end[before], 0, at - places[before] - 1)
    # Each point must be in a cell of its own, and every digit in the integer.
    if len(integers) != len(cell_ends) or len(places) - len(cell_ends) != int(np.sum(~is_end[before])):
        return None
    chosen = np.asarray(columns)
    values = integers.reshape(n_rows, width)[:, chosen]
    gaps = values == _GAP_VALUE
    if (np.abs(np.where(gaps, 0, values)) > _LARGEST).any():
        return None
    rows = values / 10.0 ** decimals.reshape(n_rows, width)[:, chosen]
    rows[gaps] = np.nan
    return NumberTable(rows, first_line + np.arange(n_rows), ())


def _careful(
    body: bytes,
    columns: Sequence[int],
    delimiter: str,
    names: Sequence[str],
    where: str,
    first_line: int,
    short_rows: bool,
) -> NumberTable:
    lines = body.decode('latin-1').split('\n')
    blank = None if delimiter == ' ' else delimiter
    comma = delimiter != ','
    needed = max(columns) + 1
    rows: list[list[float]] = []
    numbers: list[int] = []
    short: list[int] = []
    for number, line in enumerate(lines, start=first_line):
        if not line.strip(f'{delimiter} "'):
            continue
        if short and not short_rows:
            raise MocapError(f'{where}, line {short[0]}: fewer cells than the {needed} expected')
        cells = line.replace('"', '').split(blank)
        if len(cells) < needed:
            short.append(number)  # forgiven if it is the last one: a file cut short
            if not short_rows:
                continue
            cells += [''] * (needed - len(cells))
        row = []
        for column, name in zip(columns, names, strict=True):
            text = cells[column].strip()
            row.append(_number(text.replace(',', '.') if comma else text, f'{where}, line {number}: {name}'))
        rows.append(row)
        numbers.append(number)
    notes: tuple[str, ...] = ()
    if short and not short_rows:
        notes = (f'{where} was cut short: its last line, {short[0]}, is incomplete and left out',)
    return NumberTable(np.array(rows).reshape(len(rows), len(columns)), np.array(numbers), notes)


def _number(text: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan if text.lower() in _NOT_SEEN else math.inf
    if math.isinf(value):
        raise MocapError(f'{what} is {text!r}, expected a number')
    return value
