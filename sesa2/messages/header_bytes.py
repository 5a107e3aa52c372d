"""The header that a message begins with, std_msgs/Header, in the bytes of CDR: its stamp, and where it ends."""

import struct
from typing import NamedTuple

from sesa2.errors import Sesa2Error
from sesa2.time import NS


class HeaderBytes(NamedTuple):
    """What the bytes of a message begin with.

    Attributes
    ----------
    order
        byte order of the message, as `struct` writes it.
    stamp_ns
        ns; 0 where it has none.
    doubles_at
        where the first double behind the header is.
    """

    order: str
    stamp_ns: int
    doubles_at: int


def read_header(data: bytes) -> HeaderBytes:
    """Read the header of a message, either byte order.

    Raises
    ------
    IndexError, struct.error
        it is too short to have one; whoever knows its type says so.
    """
    order = '<' if data[1] & 1 else '>'
    seconds, nanoseconds, length = struct.unpack_from(f'{order}iII', data, 4)
    # Behind four bytes of CDR's own: the stamp, the length of the frame's name and the name, up to a multiple of eight.
    return HeaderBytes(order, seconds * NS + nanoseconds, 4 + (12 + length + 7) // 8 * 8)


def read_stamp(data: bytes) -> int:
    """The stamp of a message that begins with a header, ns; 0 where it has none.

    Raises
    ------
    Sesa2Error
        it is too short to have one.
    """
    try:
        return read_header(data).stamp_ns
    except (IndexError, struct.error):
        raise Sesa2Error(f'a message of {len(data)} bytes, expected one that begins with a header') from None


def with_stamp(data: bytes, stamp_ns: int) -> bytes:
    """The same message, long enough for a stamp, with another one, ns."""
    order = '<' if data[1] & 1 else '>'
    return b''.join((data[:4], struct.pack(f'{order}iI', *divmod(stamp_ns, NS)), data[12:]))
