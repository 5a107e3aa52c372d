"""What can go wrong on the way to the board."""

from sesa2.errors import Sesa2Error


class LinkError(Sesa2Error):
    """The board cannot be reached: the port is absent, held, closed or silent; it may be back later."""


class PacketError(LinkError):
    """An intact frame whose contents are no packet of this protocol."""


class ProtocolVersionError(LinkError):
    """The board speaks another protocol version: trying again is of no use, flashing the firmware is."""


class CommandError(LinkError):
    """The board answered that it cannot do what it was asked."""
