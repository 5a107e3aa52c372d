"""Who is answered by the page's server, and who is not."""

import contextlib
import socket

import pytest

from sesa2.errors import Sesa2Error

pytest.importorskip('viser', reason='viser is not installed: pip install sesa2[viewer]')

import viser
import websockets.asyncio.server
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from sesa2.viewer.server import PageServer, address, open_server, refusal


@pytest.fixture(scope='module')
def server():
    one = open_server(port=0)
    yield one
    one.stop()


def open_socket(server, origin=None, host=None):
    """A websocket as a browser would open it."""
    uri = f'ws://{host or "127.0.0.1"}:{server.get_port()}'
    own = socket.create_connection(('127.0.0.1', server.get_port()))
    return connect(uri, sock=own, origin=origin, subprotocols=[f'viser-v{viser.__version__}'])


def get(server, host):
    request = f'GET / HTTP/1.1\r\nHost: {host}\r\n\r\n'.encode()
    with socket.create_connection(('127.0.0.1', server.get_port())) as connection:
        connection.sendall(request)
        return connection.recv(4096).split(b'\r\n')[0].decode()


def test_it_listens_on_this_machine_only(server):
    assert server.get_host() == '127.0.0.1'
    assert address(server) == f'http://127.0.0.1:{server.get_port()}'


def test_its_own_page_is_served(server):
    port = server.get_port()
    with open_socket(server, origin=f'http://127.0.0.1:{port}') as connection:
        assert connection.recv(timeout=30.0)
    with open_socket(server, origin=f'http://localhost:{port}', host='localhost') as connection:
        assert connection.recv(timeout=30.0)
    assert ' 200 ' in get(server, f'127.0.0.1:{port}')


@pytest.mark.parametrize('origin', ['http://evil.example', 'https://127.0.0.1', 'http://127.0.0.1:1', 'null'])
def test_a_foreign_page_is_refused(server, origin):
    with pytest.raises(InvalidStatus) as refused:
        open_socket(server, origin=origin)
    assert refused.value.response.status_code == 403
    assert origin in refused.value.response.body.decode()


def test_a_foreign_name_for_this_machine_is_refused(server):
    port = server.get_port()
    with pytest.raises(InvalidStatus) as refused:
        open_socket(server, origin=f'http://evil.example:{port}', host='evil.example')
    assert refused.value.response.status_code == 403
    assert ' 403 ' in get(server, f'evil.example:{port}')


def test_a_busy_port_is_refused_and_not_replaced(server):
    port = server.get_port()
    with pytest.raises(Sesa2Error, match=f'port {port}: .*in use'):
        open_server(port=port)


def test_an_address_of_another_machine_is_refused():
    with pytest.raises(Sesa2Error, match=r'192\.0\.2\.1'):
        open_server('192.0.2.1', 0)


def test_a_server_that_does_not_ask_the_check_is_not_opened(monkeypatch):
    """As another viser could, which starts its server in a way of its own."""
    started = []
    serve = websockets.asyncio.server.serve

    @contextlib.contextmanager
    def bypassed(host):
        yield

    class Noted(PageServer):
        def __init__(self, **options):
            super().__init__(**options)
            started.append(self.get_port())

    monkeypatch.setattr('sesa2.viewer.server._only_own_pages', bypassed)
    monkeypatch.setattr('sesa2.viewer.server.PageServer', Noted)
    with pytest.raises(Sesa2Error, match=r'open to pages of others.*200.*viser .* does not ask'):
        open_server(port=0)
    assert websockets.asyncio.server.serve is serve
    [port] = started
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(('127.0.0.1', port))


def test_a_check_that_looks_at_names_alone_is_not_enough(monkeypatch):
    def without_origin(headers, names):
        headers = headers.copy()
        headers.pop('Origin', None)
        return refusal(headers, names)

    monkeypatch.setattr('sesa2.viewer.server.refusal', without_origin)
    with pytest.raises(Sesa2Error, match='open to pages of others'):
        open_server(port=0)


def test_it_is_not_shared_with_the_public(server):
    assert server.request_share_url() is None
    assert server._share_tunnel is None
