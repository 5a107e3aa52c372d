"""The web server of the page, kept to this machine: where it listens, and whose requests it answers.

The panel starts and stops things, so a page of somebody else in the same browser must not reach it. A browser says in
`Origin` whose page asks, and viser does not look; a foreign name that resolves to this machine shows in `Host`.
"""

import contextlib
import http
import http.client
import io
import ipaddress
import socket
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import urlsplit

import viser
import websockets.asyncio.server
from websockets import Headers
from websockets.http11 import Request, Response

from sesa2.errors import Sesa2Error, shown
from sesa2.viewer.web_port import LOOPBACK, check_port

_ANSWER_S = 10.0


class PageServer(viser.ViserServer):
    """A viser server that is never shared with the public."""

    def request_share_url(self, verbose: bool = True) -> None:
        """Any client can ask for a tunnel through a public server; none gets one."""
        del verbose

    def stop(self) -> None:
        """Stop listening, without a word on the terminal."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()


def open_server(host: str = LOOPBACK, port: int = 8080) -> PageServer:
    """Listen on a port.

    Parameters
    ----------
    host
        address to listen on; anything but 127.0.0.1 lets others steer the arm.
    port
        0: any that is free.

    Raises
    ------
    Sesa2Error
        the address is not this machine's, or the port is taken; viser itself would silently take the next one.
    """
    check_port(host, port)
    # viser announces itself in a box; our own line says the address.
    with _only_own_pages(host), contextlib.redirect_stdout(io.StringIO()):
        server = PageServer(host=host, port=port, label='sesa2', verbose=False)
    if port and server.get_port() != port:
        server.stop()
        raise Sesa2Error(f'the page cannot listen on {host}, port {port}: it was taken a moment ago')
    try:
        _require_refusals(server)
    except Sesa2Error:
        server.stop()
        raise
    return server


def address(server: viser.ViserServer) -> str:
    """What to type into the browser."""
    host = server.get_host()
    return f'http://{LOOPBACK if host in ("", "0.0.0.0", "::") else host}:{server.get_port()}'


def refusal(headers: Headers, names: frozenset[str]) -> str | None:
    """Why a request is refused; None: it is not.

    Parameters
    ----------
    headers
        of the request.
    names
        host names, besides plain addresses, by which this machine may be called.
    """
    hosts, origins = headers.get_all('Host'), headers.get_all('Origin')
    if len(hosts) != 1 or len(origins) > 1:
        return 'expected one Host and at most one Origin'
    name = urlsplit(f'//{hosts[0]}').hostname or ''
    if name not in names and not _is_address(name):
        return f'this machine is not called {name}'
    # Programs outside a browser send no Origin, and need no browser to do harm.
    if origins and origins[0] != f'http://{hosts[0]}':
        return f'a page of {origins[0]} may not use this one'
    return None


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _require_refusals(server: PageServer) -> None:
    """Ask as a foreign page would: with another viser the check may never be called, and then nobody may be served.

    Raises
    ------
    Sesa2Error
        it is answered by anything but a refusal.
    """
    host = server.get_host()
    own = {'': LOOPBACK, '0.0.0.0': LOOPBACK, '::': '::1'}.get(host, host)
    port = server.get_port()
    socket_headers = {
        'Connection': 'Upgrade',
        'Upgrade': 'websocket',
        'Sec-WebSocket-Version': '13',
        'Sec-WebSocket-Key': 'AAAAAAAAAAAAAAAAAAAAAA==',
        'Sec-WebSocket-Protocol': f'viser-v{viser.__version__}',
    }
    for headers in (
        {'Host': f'foreign.invalid:{port}'},
        {'Host': f'{LOOPBACK}:{port}', 'Origin': 'http://foreign.invalid', **socket_headers},
    ):
        connection = http.client.HTTPConnection(own, port, timeout=_ANSWER_S)
        try:
            connection.request('GET', '/', headers=headers)
            status: object = connection.getresponse().status
        except (OSError, http.client.HTTPException) as error:
            status = error
        finally:
            connection.close()
        if status != http.HTTPStatus.FORBIDDEN:
            raise Sesa2Error(
                f'the page would be open to pages of others: one was answered {shown(status)}, expected a refusal, '
                f'403; viser {viser.__version__} does not ask the check of sesa2'
            )


@contextlib.contextmanager
def _only_own_pages(host: str) -> Iterator[None]:
    """Have the server that viser starts meanwhile check every request first; viser itself has no place for that."""
    serve = websockets.asyncio.server.serve
    names = frozenset({'localhost', host.lower(), socket.gethostname().lower()})

    def guarded(*arguments: Any, process_request: Callable[..., Any], **options: Any) -> Any:
        def check(connection: websockets.asyncio.server.ServerConnection, request: Request) -> Any:
            reason = refusal(request.headers, names)
            if reason:
                body = f'refused: {reason}\n'.encode()
                headers = Headers({'Content-Type': 'text/plain', 'Content-Length': str(len(body))})
                return Response(http.HTTPStatus.FORBIDDEN.value, 'Forbidden', headers, body)
            return process_request(connection, request)

        return serve(*arguments, process_request=check, **options)

    websockets.asyncio.server.serve = guarded  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
