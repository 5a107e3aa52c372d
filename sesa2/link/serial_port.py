"""The serial port: opened with errors that tell a user what to do, read in whatever portions arrive."""

import errno
import os
import select

import serial
from serial.tools import list_ports

from sesa2.link.link_errors import LinkError

_PORTION = 4096


class SerialPort:
    """An open serial port, held exclusively.

    Parameters
    ----------
    path
        Device, best by its stable name in /dev/serial/by-id. Opening it resets an Arduino Mega.
    baud
        Bits per second; 8N1. A pseudo-terminal takes any.

    Raises
    ------
    LinkError
        If the port is not there, not permitted, held by another program or no serial port.
    """

    def __init__(self, path: str, baud: int) -> None:
        self.path = path
        self.baud = baud
        try:
            self._serial = serial.Serial(path, baud, timeout=0, write_timeout=1, exclusive=True)
        except (OSError, ValueError) as error:
            raise LinkError(_why_not_opened(path, baud, error)) from None
        # pyserial's read() gathers until a size or a time is reached; a link wants what is there, at once.
        self._fd = self._serial.fileno()
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)
        self._cancelled = False

    def read(self, timeout_s: float) -> bytes:
        """What has arrived, waiting up to a time for the first byte; empty if none came.

        Raises
        ------
        LinkError
            If the port was unplugged or closed, or reading was cancelled.
        """
        if self._cancelled:
            raise LinkError(f'serial port {self.path}: reading was cancelled')
        if not self._poll.poll(max(0.0, timeout_s) * 1000):
            return b''
        try:
            portion = os.read(self._fd, _PORTION)
        except BlockingIOError:
            return b''
        except OSError as error:
            raise self._lost(error) from None
        if not portion:  # readable without bytes: the other end is gone
            raise self._lost('the device is gone')
        return portion

    def write(self, frame: bytes) -> None:
        """Hand the bytes to the line.

        Raises
        ------
        LinkError
            If the port was unplugged or closed, or takes no bytes for a second.
        """
        try:
            self._serial.write(frame)
        except OSError as error:
            raise self._lost(error) from None

    def cancel(self) -> None:
        """From any thread: make the next `read` raise a LinkError, so that whoever waits for the board gives up."""
        self._cancelled = True

    def close(self) -> None:
        """Give the port free."""
        self._serial.close()

    def _lost(self, why: object) -> LinkError:
        return LinkError(f'serial port {self.path} was lost: {why}')


def _why_not_opened(path: str, baud: int, error: OSError | ValueError) -> str:
    code = getattr(error, 'errno', None)
    if code == errno.ENOENT:
        present = ', '.join(sorted(port.device for port in list_ports.comports())) or 'none'
        return (
            f'serial port {path} is not there; present: {present}. '
            'A board keeps its name under /dev/serial/by-id, whichever socket it is plugged into'
        )
    if code in (errno.EAGAIN, errno.EBUSY):
        return f'serial port {path} is held by another program; close it there, or give another port'
    if code in (errno.EACCES, errno.EPERM):
        return (
            f'serial port {path} may not be opened by this user; '
            'add the user to the group of serial ports (sudo adduser $USER dialout) and log in again'
        )
    if isinstance(error, ValueError):
        return f'serial port {path} does not take {baud} baud: {error}'
    return f'{path} cannot be opened as a serial port: {error}'
