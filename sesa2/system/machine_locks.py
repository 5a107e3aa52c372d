"""Names that one process at a time may hold on this machine; they are free again when it ends, however it does."""

import errno
import hashlib
import os
import socket
import sys
from collections.abc import Iterable


class MachineLocks:
    """Holds names by abstract Unix sockets, which Linux has; elsewhere nothing is held, and nobody is hindered.

    They are those of one ROS domain; of processes that do not share a network they are not the same, as their graphs
    are not.
    """

    def __init__(self) -> None:
        self._held: dict[str, socket.socket] = {}

    def hold(self, names: Iterable[str]) -> str:
        """Hold these names and no others: all of them, or, where another process holds one, none.

        Returns
        -------
        The name that another process holds; empty where all could be had.
        """
        wanted = sorted(
            set(names)
        )  # in the same order in every process: of two that want the same, one gets it
        for name in self._held.keys() - set(wanted):
            self._held.pop(name).close()
        if sys.platform != 'linux' or os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE') == 'OFF':
            return ''
        domain = os.environ.get('ROS_DOMAIN_ID') or '0'
        for name in wanted:
            if name in self._held:
                continue
            lock = socket.socket(socket.AF_UNIX)
            try:
                lock.bind(
                    f'\0sesa2/{domain}/{hashlib.sha256(name.encode()).hexdigest()}'
                )  # 108 bytes at most
            except OSError as error:
                lock.close()
                if error.errno != errno.EADDRINUSE:  # where sockets are forbidden, the graph has to do
                    return ''
                self.release()
                return name
            self._held[name] = lock
        return ''

    def release(self) -> None:
        """Hold nothing."""
        self.hold(())
