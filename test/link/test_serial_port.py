import errno
import os
import threading
import tty

import pytest
import serial

from sesa2.link.link_errors import LinkError
from sesa2.link.serial_port import SerialPort

PATIENCE_S = 20


@pytest.fixture
def terminal():
    """Master end, slave end and name of a pseudo-terminal."""
    master, slave = os.openpty()
    tty.setraw(slave)
    ends = {master, slave}
    yield master, slave, os.ttyname(slave), ends
    for end in ends:
        os.close(end)


@pytest.mark.parametrize('baud', [115200, 250000, 500000, 123456])
def test_bytes_go_both_ways_at_any_rate(terminal, baud):
    master, _, name, _ = terminal
    port = SerialPort(name, baud)
    port.write(b'to the board\x00\r\n\x03')
    assert os.read(master, 100) == b'to the board\x00\r\n\x03'
    os.write(master, b'to the PC\x00\r\n\x11\x13')
    got = b''
    while len(got) < 14:
        got += port.read(PATIENCE_S)
    assert got == b'to the PC\x00\r\n\x11\x13'
    port.close()


def test_nothing_to_read(terminal):
    port = SerialPort(terminal[2], 500000)
    assert port.read(0) == b''
    assert port.read(0.01) == b''
    assert port.read(-1) == b''
    port.close()


def test_a_port_that_is_not_there():
    with pytest.raises(LinkError, match=r'/dev/ttyNOWHERE is not there; present: .*/dev/serial/by-id'):
        SerialPort('/dev/ttyNOWHERE', 500000)


def test_a_port_that_is_held(terminal):
    port = SerialPort(terminal[2], 500000)
    with pytest.raises(LinkError, match='held by another program'):
        SerialPort(terminal[2], 500000)
    port.close()
    SerialPort(terminal[2], 500000).close()


def test_a_port_that_is_not_permitted(monkeypatch):
    def refuse(*_, **__):
        raise serial.SerialException(errno.EACCES, 'could not open port')

    monkeypatch.setattr(serial, 'Serial', refuse)
    with pytest.raises(LinkError, match='dialout'):
        SerialPort('/dev/ttyACM0', 500000)


def test_what_is_no_port(tmp_path):
    (tmp_path / 'file').write_text('')
    for path in (tmp_path, tmp_path / 'file', '/dev/null'):
        with pytest.raises(LinkError, match=f'{path} cannot be opened as a serial port'):
            SerialPort(str(path), 500000)


def test_an_impossible_rate(terminal):
    with pytest.raises(LinkError, match='does not take -5 baud'):
        SerialPort(terminal[2], -5)


def test_unplugged_while_reading_and_writing(terminal):
    master, slave, name, ends = terminal
    port = SerialPort(name, 500000)
    caught = []

    def read():
        try:
            port.read(PATIENCE_S)
        except LinkError as error:
            caught.append(str(error))

    reader = threading.Thread(target=read)
    reader.start()
    for end in (slave, master):
        os.close(end)
        ends.discard(end)
    reader.join(PATIENCE_S)
    assert caught
    assert f'{name} was lost' in caught[0]
    with pytest.raises(LinkError, match='was lost'):
        port.write(b'x')
    port.close()


def test_cancelled(terminal):
    port = SerialPort(terminal[2], 500000)
    port.cancel()
    with pytest.raises(LinkError, match='cancelled'):
        port.read(PATIENCE_S)
    port.close()
