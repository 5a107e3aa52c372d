"""The stamp of a message, which stands first in its header, in the bytes of CDR."""

import struct

from sesa2.errors import Sesa2Error
from sesa2.time import NS


def read_stamp(data: bytes) -> int:
    """The stamp of a message that begins with a std_msgs/Header, ns; 0 where it has none.

    Raises
    ------
    Sesa2Error
        it is too short to have one.
    """
    try:
        seconds, nanoseconds = struct.unpack_from(f'{_order(data)}iI', data, 4)
    except (IndexError, struct.error):
        raise Sesa2Error(f'a message of {len(data)} bytes, expected one that begins with a header') from None
    return seconds * NS + nanoseconds


def with_stamp(data: bytes, stamp_ns: int) -> bytes:
    """The same message, long enough for a stamp, with another one, ns."""
    return b''.join((data[:4], struct.pack(f'{_order(data)}iI', *divmod(stamp_ns, NS)), data[12:]))


def _order(data: bytes) -> str:
    return '<' if data[1] & 1 else '>'
