"""Joint states, from the bytes in which they arrive to arrays."""

import struct
from typing import NamedTuple

import numpy as np

from sesa2.errors import Sesa2Error
from sesa2.messages.cdr import LITTLE_ENDIAN
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

_STAMP = slice(len(LITTLE_ENDIAN), len(LITTLE_ENDIAN) + 8)
_ORDERS = {LITTLE_ENDIAN[:2]: '<', b'\0\0': '>'}


class JointStateLayout(NamedTuple):
    """Where the positions are in sensor_msgs/JointState of these joints: their names are read once.

    Attributes
    ----------
    names
        of the joints.
    before
        what stands between the stamp and the positions, the same in every message.
    order
        byte order, as `struct` writes it.
    """

    names: tuple[str, ...]
    before: bytes
    order: str

    @classmethod
    def of(cls, data: bytes) -> 'JointStateLayout':
        """The layout of one message, either byte order.

        Raises
        ------
        Sesa2Error
            the bytes are not one.
        """
        if data[:2] not in _ORDERS:
            raise Sesa2Error('a JointState that is not plain CDR')
        order = _ORDERS[data[:2]]
        try:
            _, at = _read_string(data, _STAMP.stop, order)  # the frame
            n, at = _read_count(data, at, order)
            names = []
            for _ in range(n):
                name, at = _read_string(data, at, order)
                names.append(name)
            positions, at = _read_count(data, at, order)
        except (struct.error, UnicodeDecodeError):
            raise Sesa2Error(f'a JointState of {len(data)} bytes is not whole') from None
        if positions != n:
            raise Sesa2Error(f'a JointState with {positions} positions of {n} joints')
        if n:
            at += (len(LITTLE_ENDIAN) - at) % 8
        return cls(tuple(names), data[_STAMP.stop : at], order)

    @property
    def positions_at(self) -> int:
        """Where the positions begin in a message."""
        return _STAMP.stop + len(self.before)

    def fits(self, data: bytes) -> bool:
        """Whether a message is of these joints, and whole."""
        first = self.positions_at
        return (
            data[_STAMP.stop : first] == self.before
            and _ORDERS.get(data[:2]) == self.order
            and len(data) >= first + 8 * len(self.names)
        )

    def read(self, data: bytes) -> tuple[int, FloatArray]:
        """Read a message.

        Returns
        -------
        Its stamp, ns, and the positions, (n_joints,), rad or m.

        Raises
        ------
        Sesa2Error
            it is cut short, or of other joints.
        """
        first = self.positions_at
        if not self.fits(data):
            raise Sesa2Error(f'a JointState of {len(data)} bytes that is not of the joints before it')
        seconds, nanoseconds = struct.unpack_from(f'{self.order}iI', data, _STAMP.start)
        return seconds * NS + nanoseconds, np.frombuffer(data, f'{self.order}f8', len(self.names), first)

    def velocities(self, data: bytes) -> FloatArray:
        """Velocities in a message that `read` has read; (n_joints,), rad/s or m/s, nan where it says none."""
        n = len(self.names)
        at = self.positions_at + 8 * n
        try:
            said, at = _read_count(data, at, self.order)
            at += (len(LITTLE_ENDIAN) - at) % 8
            return np.frombuffer(data, f'{self.order}f8', n, at) if said == n else np.full(n, np.nan)
        except (struct.error, ValueError):
            raise Sesa2Error(f'a JointState of {len(data)} bytes is not whole') from None


def _read_count(data: bytes, at: int, order: str) -> tuple[int, int]:
    at += (len(LITTLE_ENDIAN) - at) % 4
    return struct.unpack_from(f'{order}I', data, at)[0], at + 4


def _read_string(data: bytes, at: int, order: str) -> tuple[str, int]:
    n, at = _read_count(data, at, order)
    if at + n > len(data):
        raise struct.error
    return data[at : at + n].rstrip(b'\0').decode(), at + n
