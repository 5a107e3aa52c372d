"""Motion capture from a CSV file."""

import csv
import difflib
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from sesa2.evaluation.trajectory import EvaluationError, Trajectory

TIME = 'time_s'


def read_csv(path: str | Path, names: Sequence[str]) -> tuple[Trajectory, tuple[str, ...]]:
    """Read marker positions.

    The first line names the columns: `time_s`, then `<marker>_x`, `<marker>_y`, `<marker>_z` for every marker, in any
    order; other columns are ignored. Metres, seconds from any origin. An empty field or `nan` means not seen. A marker
    without any column, or never seen, is left out.

    Parameters
    ----------
    path
        the file, UTF-8, separated by commas.
    names
        markers to read, as the configuration calls them.

    Returns
    -------
    The markers' trajectory, and what had to be left out, one sentence each.

    Raises
    ------
    EvaluationError
        no such file, a column is missing, a field is not a number (with its line), none of the markers was seen.
    """
    path = Path(path)
    try:
        with path.open(newline='', encoding='utf-8-sig') as file:
            return _parse(csv.reader(file), tuple(names), path.name)
    except OSError as e:
        raise EvaluationError(f'{path}: {e.strerror}') from e
    except (UnicodeDecodeError, csv.Error) as e:
        raise EvaluationError(f'{path.name} is not a CSV text file: {e}') from e


def _parse(
    reader: Iterator[list[str]], names: tuple[str, ...], file: str
) -> tuple[Trajectory, tuple[str, ...]]:
    header = [cell.strip() for cell in next(reader, [])]
    absent = [name for name in names if not {f'{name}_{axis}' for axis in 'xyz'} & set(header)]
    if len(absent) < len(names):  # else the columns are called otherwise, and _columns says how
        names = tuple(name for name in names if name not in absent)
    columns = _columns(header, names, file)
    last = max(columns)

    rows: list[list[float]] = []
    short_line = 0
    late = 0
    for line, cells in enumerate(reader, start=2):
        if not any(cells):
            continue
        if short_line:
            raise EvaluationError(f'{file}, line {short_line}: fewer fields than the {len(header)} columns')
        if len(cells) <= last:
            short_line = line  # forgiven if it is the last one: a file cut short
            continue
        row = [_number(cells[c], header[c], file, line) for c in columns]
        if math.isnan(row[0]):
            raise EvaluationError(f'{file}, line {line}: {TIME} is empty')
        if rows and row[0] <= rows[-1][0]:
            late += 1
            continue
        rows.append(row)

    if not rows:
        raise EvaluationError(f'{file} has no samples below its header')
    table = np.array(rows)
    positions = table[:, 1:].reshape(len(table), len(names), 3)
    nan = np.isnan(positions)
    partial = int((nan.any(axis=2) & ~nan.all(axis=2)).sum())
    positions[nan.any(axis=2)] = np.nan
    truth = Trajectory(table[:, 0], positions, names)
    seen = tuple(name for name, samples in zip(names, truth.seen.T, strict=True) if samples.any())
    if not seen:
        raise EvaluationError(f'{file}: none of {", ".join(names)} was seen in {len(rows)} samples')

    left_out = [
        f'{file}: {name} {why} and is not evaluated'
        for why, which in (
            ('has no columns', absent),
            (f'was never seen in {len(rows)} samples', [name for name in names if name not in seen]),
        )
        for name in which
    ]
    if short_line:
        left_out.append(f'{file} was cut short: its last line, {short_line}, is incomplete and left out')
    if late:
        left_out.append(f'{file}: {late} lines whose {TIME} is not after the line before were left out')
    if partial:
        left_out.append(f'{file}: {partial} marker positions with a missing component count as not seen')
    return truth.select(seen), tuple(left_out)


def _columns(header: list[str], names: tuple[str, ...], file: str) -> list[int]:
    """Indices of the time and of every marker's x, y, z."""
    columns = []
    for wanted in [TIME, *(f'{name}_{axis}' for name in names for axis in 'xyz')]:
        if header.count(wanted) > 1:
            raise EvaluationError(f'{file}: {header.count(wanted)} columns are called {wanted}')
        if wanted not in header:
            near = difflib.get_close_matches(wanted, header, n=1, cutoff=0.0) if any(header) else []
            hint = f'; the nearest is {near[0]!r}' if near else '; the first line is empty'
            if len(header) == 1 and {';', '\t'} & set(header[0]):
                hint = '; the columns must be separated by commas'
            raise EvaluationError(
                f'{file} has no column {wanted}{hint}. Expected: {TIME}, '
                + ', '.join(f'{name}_x, {name}_y, {name}_z' for name in names)
            )
        columns.append(header.index(wanted))
    return columns


def _number(text: str, column: str, file: str, line: int) -> float:
    try:
        value = float(text) if text.strip() else math.nan
    except ValueError:
        value = math.inf
    if math.isinf(value):
        raise EvaluationError(f'{file}, line {line}: {column} is {text.strip()!r}, expected a number')
    return value
