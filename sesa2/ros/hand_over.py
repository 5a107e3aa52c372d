"""Messages from node to node within a process, past the middleware, which costs more than what is done with them."""

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from sesa2.ros.confined_node import ConfinedNode

# As many as DDS keeps of eight topics for 100 Hz and 12 s; who is that far behind will not catch up.
WAITING_MAX = 10_000


class HandOver:
    """Hands messages, in the bytes in which they are published, to one node, in the order in which they are sent.

    None is lost on the way while the node keeps up. They may be sent from any thread; the node takes them in that of
    its executor, and is woken once for all that are sent together.

    Attributes
    ----------
    lost
        number of messages that nobody took, since the node was too far behind.
    """

    def __init__(self) -> None:
        self._node: ConfinedNode | None = None
        self._callbacks: dict[str, Callable[[bytes], None]] = {}
        self._waiting: deque[tuple[str, bytes]] = deque()
        self._woken = False
        self.lost = 0

    def listen(self, node: ConfinedNode, topic: str, callback: Callable[[bytes], Any]) -> None:
        """Have a callback called with each message of a topic; it is confined as the node's others are."""
        self._node = node
        self._callbacks[node.resolve_topic_name(topic)] = node.confined(callback)

    def send(self, messages: Sequence[tuple[str, bytes]]) -> None:
        """Hand over messages, each with the full name of its topic, of which some that nobody listens to."""
        self._waiting.extend(message for message in messages if message[0] in self._callbacks)
        while len(self._waiting) > WAITING_MAX:
            self._waiting.popleft()
            self.lost += 1
        if not self._woken:
            self._wake()

    def _wake(self) -> None:
        executor = self._node.executor if self._node else None
        if executor:  # else the node has ended, or its time has not come
            self._woken = True
            executor.create_task(self._deliver)

    def _deliver(self) -> None:
        self._woken = False  # before anything is taken: what comes from now on wakes the node again
        with suppress(IndexError):  # of messages that were too many and have gone
            for _ in range(len(self._waiting)):
                topic, data = self._waiting.popleft()
                self._callbacks[topic](data)
