"""Whether the page's port is free; on its own, so that it can be known before anything else is started."""

import socket

from sesa2.errors import Sesa2Error

LOOPBACK = '127.0.0.1'


def check_port(host: str, port: int) -> None:
    """Refuse an address that cannot be listened on.

    Parameters
    ----------
    host
        address of this machine.
    port
        0: any that is free.

    Raises
    ------
    Sesa2Error
        the address is not this machine's, or the port is taken.
    """
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except (OSError, OverflowError) as error:
        reason = getattr(error, 'strerror', None) or str(error)
        raise Sesa2Error(
            f'the page cannot listen on {host}, port {port}: {reason}; choose another port, or end what uses this one'
        ) from None
