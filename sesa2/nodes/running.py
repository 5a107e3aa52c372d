"""What `sesa2 run` does: start the system, keep it going, end it."""

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

from sesa2.configuration import Configuration
from sesa2.nodes.runtime import Spinner, ros
from sesa2.nodes.status import Status
from sesa2.nodes.system import System
from sesa2.nodes.system_node import SystemNode

# The link's thread and the executor take turns: Python's 5 ms would be as long as a result may take.
_SWITCH_S = 0.0005


def run(
    configuration: Configuration,
    stop: threading.Event,
    duration: float | None = None,
    *,
    viewer: bool = False,
) -> None:
    """Run until asked to stop, the end of the bag or the given time.

    Parameters
    ----------
    configuration
        says by its source, mode and files which nodes are wanted.
    stop
        set from outside, to end.
    duration
        s; None: no end.
    viewer
        show a page with a control panel; then a failure does not end the run, since it can be mended there.

    Raises
    ------
    Sesa2Error
        a node cannot start, or cannot go on.
    """
    ends = time.monotonic() + duration if duration else float('inf')
    sys.setswitchinterval(_SWITCH_S)
    with ros([]), Spinner() as spinner, ExitStack() as stack:
        system = System(spinner)
        stack.callback(system.stop)
        if not viewer:
            system.start(configuration)
            _spin(spinner, system, lambda: stop.is_set() or system.finished or time.monotonic() > ends)
            if system.failure:
                raise system.failure
            return
        node = SystemNode(system, configuration)
        spinner.add(node)
        stack.enter_context(_viewer_process())
        node.try_to_start()

        def ended() -> bool:
            node.look_after()
            return stop.is_set() or time.monotonic() > ends

        _spin(spinner, system, ended)


def _spin(spinner: Spinner, system: System, ended: Callable[[], bool]) -> None:
    """Spin until ended, with a line a second on the terminal about what runs."""
    status = Status(system)
    while not ended():
        spinner.spin_once()
        status.show_when_due()
    if not system.failure:
        status.show_summary()


@contextmanager
def _viewer_process() -> Iterator[None]:
    """The viewer, in a process of its own so that drawing never holds up a sweep."""
    process = subprocess.Popen([sys.executable, '-m', 'sesa2.nodes.viewer'])
    try:
        yield
    finally:
        process.terminate()
        process.wait()
