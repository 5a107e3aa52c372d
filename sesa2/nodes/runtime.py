"""Running nodes in a process: started with clear errors, ended cleanly by Ctrl-C or SIGTERM."""

import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from typing import Any

import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from sesa2.configuration import files
from sesa2.errors import Sesa2Error

# The executor hangs for good without a finite timeout, and Python sees a signal only between two waits.
_WAIT_S = 0.1


@contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """An event that SIGINT and SIGTERM set."""
    stop = threading.Event()
    before = {s: signal.signal(s, lambda *_: stop.set()) for s in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for s, handler in before.items():
            signal.signal(s, handler)


@contextmanager
def ros(arguments: Sequence[str] | None = None) -> Iterator[None]:
    """ROS, initialised; shut down at the end.

    Raises
    ------
    Sesa2Error
        ROS cannot be initialised, for example because it cannot read the parameter file.
    """
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        # rcl names neither the key nor the remedy; our own reader of the same file does.
        arguments = sys.argv if arguments is None else arguments
        for flag, path in pairwise(arguments):
            if flag == '--params-file':
                files.load(path)
        raise Sesa2Error(f'ROS cannot start: {str(error).splitlines()[0]}') from None
    try:
        yield
    finally:
        rclpy.try_shutdown()


def spin(nodes: Sequence[Node], until: Callable[[], bool]) -> None:
    """Run nodes until asked to stop, then end them in order.

    Parameters
    ----------
    nodes
        those with a `close` method have it called before they are destroyed.
    until
        asked after every event and at least ten times a second.
    """
    executor = EventsExecutor()
    with ExitStack() as stack:
        stack.callback(executor.shutdown)
        for node in nodes:
            executor.add_node(node)
            stack.callback(node.destroy_node)
        for node in nodes:
            close = getattr(node, 'close', None)
            if close:
                stack.callback(close)
        while not until():
            executor.spin_once(timeout_sec=_WAIT_S)


def run_alone(make: Callable[[], Any]) -> int:
    """Run one node as a program.

    Parameters
    ----------
    make
        makes the node; it may raise Sesa2Error. A node with an attribute `finished` that becomes true ends the program.

    Returns
    -------
    Exit code: 0 when ended by a signal or finished, 1 after a failure, whose message went to standard error.
    """
    with stop_on_signals() as stop:
        try:
            with ros():
                node = make()
                spin([node], lambda: stop.is_set() or getattr(node, 'finished', False))
                failure = getattr(node, 'failure', None)
                if failure:
                    raise failure
        except Sesa2Error as error:
            print(f'error: {error}', file=sys.stderr)
            return 1
    return 0
