"""An export in memory: its bytes, and its first lines as text."""

import csv
from functools import cached_property
from pathlib import Path

from sesa2.mocap.capture import MocapError

_HEAD = 200  # lines; the longest header known has some twenty
_HEAD_BYTES = 5_000_000
_DELIMITERS = ',;\t'


class ExportFile:
    r"""A file to be recognised and read.

    Line ends are `\n` whatever they were; a byte order mark is gone, UTF-16 is UTF-8.

    Parameters
    ----------
    path
        of the file.
    data
        its bytes, or those of a part of it.
    """

    def __init__(self, path: Path, data: bytes):
        self.path = path
        self.name = path.name
        self.data = _plain(data)

    @classmethod
    def load(cls, path: str | Path) -> 'ExportFile':
        """Load a file.

        Raises
        ------
        MocapError
            it cannot be read.
        """
        try:
            return cls(Path(path), Path(path).read_bytes())
        except OSError as error:
            raise MocapError(f'{path}: cannot be read: {error.strerror or error}') from None

    @cached_property
    def head(self) -> list[str]:
        """The first lines; Latin-1 where they are no UTF-8."""
        lines = self.data[:_HEAD_BYTES].split(b'\n', _HEAD)[:_HEAD]
        try:
            return [line.decode() for line in lines]
        except UnicodeDecodeError:
            return [line.decode('latin-1') for line in lines]

    def cells(self, line: int, delimiter: str) -> list[str]:
        """A line of the header, from 0, as cells without quotes and blanks around them."""
        if line >= len(self.head):
            return []
        text = self.head[line].replace('\0', '')  # at which csv stumbles until Python 3.11
        return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter), [])]

    def after(self, lines: int) -> int:
        """Where what comes after so many lines begins."""
        begin = 0
        for _ in range(lines):
            end = self.data.find(b'\n', begin)
            if end < 0:
                return len(self.data)
            begin = end + 1
        return begin


def delimiter_of(line: str) -> str:
    """What stands between the cells of a line: the most frequent of comma, semicolon and tab."""
    return max(_DELIMITERS, key=line.count)


def _plain(data: bytes) -> bytes:
    if data[:2] in (b'\xff\xfe', b'\xfe\xff'):
        data = data.decode('utf-16', errors='replace').encode()
    data = data.removeprefix(b'\xef\xbb\xbf')
    if b'\r' in data[:100_000] and b'\0' not in data[:1000]:
        data = data.replace(b'\r\n', b'\n').replace(b'\r', b'\n')
    return data
