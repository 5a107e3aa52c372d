"""Frames of the board link: COBS around a body and its CRC-16, ended by 0x00 (firmware/PROTOCOL.md).

Since 0x00 occurs nowhere inside a frame, any loss or damage costs the frames that it touches and no more:
the decoder is in step again at the next 0x00.
"""

from binascii import crc_hqx
from typing import NamedTuple

from cobs import cobs

MAX_BODY = 115
"""Bytes of the longest body, a RAW packet of eight IMUs."""

FRAMING_BYTES = 4
"""What a frame adds to its body: CRC, the one code byte that COBS needs below 254 bytes, and the delimiter."""

_MAX_FRAME = MAX_BODY + FRAMING_BYTES - 1  # without the delimiter


class FrameErrors(NamedTuple):
    """Frames dropped since the decoder was made, by cause."""

    cobs: int = 0
    """Not decodable: a byte was lost, or a code byte damaged."""
    crc: int = 0
    """Decodable, but the CRC differs."""
    length: int = 0
    """Longer than any packet, or too short to hold a CRC."""

    @property
    def total(self) -> int:
        """All of them."""
        return sum(self)


def encode_frame(body: bytes) -> bytes:
    """The bytes on the line for a body: COBS(body, CRC low, CRC high), 0x00."""
    crc = crc_hqx(body, 0xFFFF)
    return cobs.encode(body + crc.to_bytes(2, 'little')) + b'\x00'


class FrameDecoder:
    """Takes the bytes of the line in any portions and gives the bodies of the intact frames.

    What it keeps between two portions is bounded by the longest frame, also in a stream without any 0x00.

    Attributes
    ----------
    errors
        Frames dropped so far. An empty frame (two delimiters in a row) is no error.
    """

    def __init__(self) -> None:
        self.errors = FrameErrors()
        self._rest = b''

    def feed(self, portion: bytes) -> list[bytes]:
        """Bodies, without their CRC, of the intact frames that end in this portion."""
        first, *others = portion.split(b'\x00')
        rest = self._rest + first
        bodies = []
        for following in others:
            if rest and (body := self._decode(rest)):
                bodies.append(body)
            rest = following
        # One byte more than the longest frame is enough to know at its end that it was too long.
        self._rest = rest[: _MAX_FRAME + 1]
        return bodies

    def resynchronise(self) -> None:
        """Forget the beginning of a frame whose end will never come, since the port was opened anew."""
        self._rest = b''

    def _decode(self, frame: bytes) -> bytes:
        if len(frame) > _MAX_FRAME:
            self.errors = self.errors._replace(length=self.errors.length + 1)
            return b''
        try:
            packet = cobs.decode(frame)
        except cobs.DecodeError:
            self.errors = self.errors._replace(cobs=self.errors.cobs + 1)
            return b''
        if len(packet) < 3:
            self.errors = self.errors._replace(length=self.errors.length + 1)
            return b''
        body = packet[:-2]
        if crc_hqx(body, 0xFFFF) != packet[-2] | packet[-1] << 8:
            self.errors = self.errors._replace(crc=self.errors.crc + 1)
            return b''
        return body
