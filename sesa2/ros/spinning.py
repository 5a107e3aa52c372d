"""Running nodes in a process: started with clear errors, ended cleanly by Ctrl-C or SIGTERM."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise

import rclpy
from rclpy.exceptions import InvalidHandle
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from sesa2.configuration import ConfigurationError, Mistake, files
from sesa2.errors import Sesa2Error
from sesa2.faults import fault_line, log_tracebacks
from sesa2.regular_files import why_no_regular_file
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.signals import stop_on_signals

# The executor hangs for good without a finite timeout, and Python sees a signal only between two waits.
_WAIT_S = 0.1


@contextmanager
def ros_context(arguments: Sequence[str] | None = None) -> Iterator[None]:
    """ROS, initialised; shut down at the end.

    Raises
    ------
    Sesa2Error
        ROS cannot be initialised, for example because it cannot read the parameter file.
    """
    arguments = sys.argv if arguments is None else arguments
    parameter_files = [path for flag, path in pairwise(arguments) if flag == '--params-file']
    for path in parameter_files:
        if why := why_no_regular_file(path):  # rcl would wait for a pipe without end
            raise ConfigurationError([Mistake('', why)], path)
    try:
        rclpy.init(
            args=None if arguments is None else list(arguments),
            signal_handler_options=SignalHandlerOptions.NO,
        )
    except Exception as error:
        # rcl names neither the key nor the remedy; our own reader of the same file does.
        for path in parameter_files:
            files.load(path)
        raise Sesa2Error(f'ROS cannot start: {str(error).splitlines()[0]}') from None
    try:
        yield
    finally:
        rclpy.try_shutdown()


class Spinner:
    """Runs nodes; a context manager that ends them all."""

    def __init__(self) -> None:
        self._executor = EventsExecutor()
        self._nodes: list[Node] = []

    def add(self, node: Node) -> None:
        """Run a node too."""
        self._executor.add_node(node)
        self._nodes.append(node)

    def remove(self, node: Node) -> None:
        """End a node: what stands in its queue is let go, then its own `close`, where it has one, then the node."""
        self._nodes.remove(node)
        self._executor.remove_node(node)
        _silence(node)
        try:
            if hasattr(node, 'close'):
                node.close()
        finally:
            node.destroy_node()

    def spin_once(self) -> None:
        """Do what is to be done; waits a tenth of a second at most."""
        # A message may be on its way to a node that a callback has just ended.
        with suppress(InvalidHandle):
            self._executor.spin_once(timeout_sec=_WAIT_S)

    def __enter__(self) -> 'Spinner':
        return self

    def __exit__(self, *_: object) -> None:
        while self._nodes:
            self.remove(self._nodes[-1])
        self._executor.shutdown()


def _silence(node: Node) -> None:
    """Let nothing happen that still stands in the executor's queue: it would be called after the node is gone."""
    for subscription in node.subscriptions:
        subscription.callback = lambda _: None
    for timer in node.timers:
        timer.callback = lambda: None
    for service in node.services:
        service.callback = lambda _, response: response


def run_alone(make: Callable[[], ConfinedNode]) -> int:
    """Run one node as a program.

    Parameters
    ----------
    make
        makes the node; it may raise Sesa2Error. The program ends when the node is `finished`.

    Returns
    -------
    Exit code: 0 when ended by a signal or finished, 1 after a failure, whose message went to standard error.
    """
    log_tracebacks()
    with stop_on_signals() as stop:
        try:
            with ros_context(), Spinner() as spinner:
                node = make()
                spinner.add(node)
                while not (stop.is_set() or node.finished):
                    spinner.spin_once()
                why = str(node.failure or '')  # before it is closed: what that breaks off is no failure
        except Sesa2Error as error:
            why = str(error)
        except Exception as error:
            why = fault_line(error)
    if why:
        print(f'error: {why}', file=sys.stderr)
    return 1 if why else 0
