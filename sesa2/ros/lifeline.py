"""A socket between a process and its child. When one of them ends, by kill -9 too, the kernel tells the other."""

import os
import signal
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress

_VARIABLE = 'SESA2_LIFELINE'
_PATIENCE_S = 5.0


class Lifeline:
    """The parent's end; it must be closed, also by the parent's end, for the child to end.

    Attributes
    ----------
    descriptor
        of the child's end, which the child inherits; `let_go` closes it here once the child is there.
    environment
        what the child is started with.
    """

    def __init__(self) -> None:
        self._ours, self._theirs = socket.socketpair()
        self._ours.setblocking(False)
        self.descriptor = self._theirs.fileno()
        self.environment = {**os.environ, _VARIABLE: str(self.descriptor)}
        self._started = False

    def let_go(self) -> None:
        """Leave the child's end to the child alone."""
        self._theirs.close()

    @property
    def started(self) -> bool:
        """Whether the child has said that it has started."""
        if not self._started:
            with suppress(OSError):  # nothing has come yet
                self._started = self._ours.recv(1) != b''
        return self._started

    def close(self) -> None:
        """Ask the child to end."""
        self._ours.close()


def end_with_parent() -> Callable[[], None]:
    """In a child that was given a lifeline: end when the parent does, by SIGTERM, and after 5 s without it.

    Returns
    -------
    To be called when the child has started.
    """
    descriptor = os.environ.pop(_VARIABLE, None)
    if descriptor is None:
        return lambda: None
    theirs = socket.socket(fileno=int(descriptor))
    theirs.set_inheritable(False)
    threading.Thread(target=_watch, args=(theirs,), name='lifeline', daemon=True).start()

    def tell() -> None:
        with suppress(OSError):  # the parent has ended; the other thread sees that too
            theirs.send(b'.')

    return tell


def _watch(theirs: socket.socket) -> None:
    with suppress(OSError):
        theirs.recv(1)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_PATIENCE_S)
    os._exit(1)
