"""Messages of a fixed layout in CDR, the format of ROS 2 on the wire and in bags.

A message whose texts and list lengths stay the same has its numbers at the same places every time. `CdrLayout` writes
such a message once and notes where its stamps and doubles are; `Template` then makes any number of them at once.

CDR (OMG DDS-XTypes, plain CDR version 1): four bytes that say little endian, then each field aligned to its own size
counted from there; a text is its length with the closing NUL, then its bytes; a list is its length, then its entries.
"""

import struct
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from sesa2.time import NS

# So many runs of doubles are copied one by one.
_FEW = 4

LITTLE_ENDIAN = b'\x00\x01\x00\x00'


class CdrLayout:
    """Writes one message, field by field in the order of its definition."""

    def __init__(self) -> None:
        self._body = bytearray()
        self._stamps: list[int] = []
        self._doubles: list[int] = []

    def _put(self, size: int, packed: bytes) -> 'CdrLayout':
        self._body += bytes(-len(self._body) % size) + packed
        return self

    def uint8(self, value: int) -> 'CdrLayout':
        """A uint8 or bool."""
        return self._put(1, struct.pack('<B', value))

    def uint32(self, value: int) -> 'CdrLayout':
        """A uint32 or int32 that is not negative, or the length of a list."""
        return self._put(4, struct.pack('<I', value))

    def float32(self, *values: float) -> 'CdrLayout':
        """One or more float32 that stay the same."""
        return self._put(4, struct.pack(f'<{len(values)}f', *values))

    def string(self, text: str) -> 'CdrLayout':
        """A text."""
        data = text.encode() + b'\0'
        self.uint32(len(data))
        self._body += data
        return self

    def strings(self, texts: Iterable[str]) -> 'CdrLayout':
        """A list of texts."""
        texts = list(texts)
        self.uint32(len(texts))
        for text in texts:
            self.string(text)
        return self

    def header(self, frame_id: str) -> 'CdrLayout':
        """A std_msgs/Header; its stamp will be filled in."""
        self._put(4, b'')
        self._stamps.append(len(self._body))
        self._body += bytes(8)
        return self.string(frame_id)

    def doubles(self, n: int) -> 'CdrLayout':
        """Doubles that will be filled in."""
        if n:
            self._put(8, b'')
            self._doubles += range(len(self._body), len(self._body) + 8 * n, 8)
            self._body += bytes(8 * n)
        return self

    def constants(self, *values: float) -> 'CdrLayout':
        """Doubles that stay the same."""
        return self._put(8, struct.pack(f'<{len(values)}d', *values))

    def template(self) -> 'Template':
        """The message, ready to be made."""
        return Template(bytes(self._body), self._stamps, self._doubles)


class Template:
    """Makes messages of one layout.

    Attributes
    ----------
    n_doubles
        how many numbers a message takes.
    """

    # In memory a row begins four bytes before the message, so that its doubles stand at multiples of eight.
    _LEAD = 4

    def __init__(self, body: bytes, stamps: list[int], doubles: list[int]):
        self._size = len(LITTLE_ENDIAN) + len(body)
        row = bytes(self._LEAD) + LITTLE_ENDIAN + body
        self._row = np.frombuffer(row + bytes(-len(row) % 8), dtype=np.uint8)
        start = self._LEAD + len(LITTLE_ENDIAN)
        seconds = (np.array(stamps, dtype=np.intp) + start) // 4
        self._seconds, self._nanoseconds = _places(seconds), _places(seconds + 1)
        at = (np.array(doubles, dtype=np.intp) + start) // 8
        self.n_doubles = len(doubles)
        # Where doubles stand together, and which of the values they are. A few runs are copied faster than they are
        # indexed; a path has one for every pose.
        first = np.flatnonzero(np.diff(at, prepend=-1) != 1).tolist()
        runs = [slice(a, b) for a, b in pairwise([*first, len(at)])]
        self._runs: list[tuple[slice | np.ndarray, slice]] = [
            (slice(int(at[run][0]), int(at[run][-1]) + 1), run) for run in runs
        ]
        if len(runs) > _FEW:
            self._runs = [(at, slice(None))]

    def make(self, stamps_ns: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Make messages.

        Parameters
        ----------
        stamps_ns : (n,)
            time of each message, ns, int64.
        values : (n, n_doubles)
            the numbers, in the order of the message's definition.

        Returns
        -------
        (n, size), uint8: a message a row; `row.tobytes()` is what ROS publishes and a bag holds.
        """
        rows = np.empty((len(stamps_ns), len(self._row)), dtype=np.uint8)
        rows[:] = self._row
        doubles = rows.view('<f8')
        for at, run in self._runs:
            doubles[:, at] = values[:, run]
        words = rows.view('<i4')
        seconds, nanoseconds = np.divmod(stamps_ns, NS)
        words[:, self._seconds] = seconds[:, None]
        words[:, self._nanoseconds] = nanoseconds[:, None]
        return rows[:, self._LEAD : self._LEAD + self._size]


def _places(indices: np.ndarray) -> np.ndarray | slice:
    """Indices, as a slice where they follow each other: numpy is faster with it."""
    first = int(indices[0]) if len(indices) else 0
    return slice(first, first + len(indices)) if (np.diff(indices) == 1).all() else indices
