"""A real ROS graph in the test's own process."""

import time
from collections.abc import Callable
from contextlib import ExitStack, contextmanager
from typing import NamedTuple

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import DurabilityPolicy, QoSProfile

from sesa2.configuration import validate
from sesa2.link.virtual.virtual_board import VirtualBoard
from sesa2.ros.parameters import overrides
from sesa2.ros.spinning import Spinner

# Long enough for a slow machine; reached only by a test that fails.
PATIENCE_S = 60.0
# Logs are latched: a line that was said before the two knew each other is heard too.
LOGS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Line(NamedTuple):
    """A line of a node's log, named as in rcl_interfaces/Log."""

    level: int
    name: str
    msg: str


class Graph:
    """Nodes under test and the test's own node `probe`, run as the programs run theirs."""

    def __init__(self):
        self._spinner = Spinner()
        self._taps = ExitStack()
        self.nodes = []
        self.probe = self.add(rclpy.create_node('probe'))

    def add(self, node):
        self.nodes.append(node)
        self._spinner.add(node)
        return node

    def remove(self, node):
        """End a node."""
        self.nodes.remove(node)
        self._spinner.remove(node)

    def until(self, condition: Callable[[], object], what: str = ''):
        """Spin until the condition holds."""
        deadline = time.monotonic() + PATIENCE_S
        while not (result := condition()):
            assert time.monotonic() < deadline, f'waited {PATIENCE_S:g} s in vain: {what or condition}'
            self._spinner.spin_once()
        return result

    def listen(self, kind, topic, qos, **options):
        """Subscribe, and wait until matched; the list fills while the graph spins."""
        messages = []
        self.probe.create_subscription(kind, topic, messages.append, qos, **options)
        self.matched(topic)
        return messages

    def matched(self, *topics):
        """Wait until every publisher and every subscription of the topics knows of one on the other side.

        Both sides are asked: what a publisher sends to a subscription that does not know it yet is lost.
        """
        names = {self.probe.resolve_topic_name(topic) for topic in topics}

        def all_know():
            ends = [
                end.get_subscription_count()
                if hasattr(end, 'get_subscription_count')
                else end.get_publisher_count()
                for node in self.nodes
                for end in [*node.publishers, *node.subscriptions]
                if end.topic_name in names
            ]
            return ends and all(ends)

        self.until(all_know, f'both sides of {", ".join(topics)}')

    def diagnosis(self):
        """What all nodes say about their parts from now on, those too that are yet to come."""
        messages = []
        self.probe.create_subscription(DiagnosticArray, '/diagnostics', messages.append, 10)
        return Diagnosis(messages)

    def listen_to_logs(self):
        """What nodes of this process log from now on, those too that are yet to come.

        Taken where rclpy hands a line to its own logging: not every line arrives on /rosout on a loaded machine.
        """
        lines, log = [], rclpy_implementation.rclpy_logging_rcutils_log

        def tap(severity, name, message, *where):
            lines.append(Line(int(severity), name, message))
            log(severity, name, message, *where)

        patch = self._taps.enter_context(pytest.MonkeyPatch.context())
        patch.setattr(rclpy_implementation, 'rclpy_logging_rcutils_log', tap)
        return lines

    def listen_to_rosout(self):
        """What nodes of other processes log."""
        messages = []
        self.probe.create_subscription(Log, '/rosout', messages.append, LOGS)
        return messages

    def call(self, kind, name, request):
        client = self.probe.create_client(kind, name)
        self.until(client.service_is_ready, f'service {name}')
        future = client.call_async(request)
        self.until(future.done, f'answer of {name}')
        return future.result()

    def close(self):
        while self.nodes:
            self.remove(self.nodes[-1])
        self._taps.close()
        self._spinner.__exit__()


class Diagnosis:
    """Statuses as they were published."""

    def __init__(self, messages):
        self._messages = messages

    def of(self, name):
        """All of one part so far, as (level, message, values)."""
        return [
            (status.level, status.message, {v.key: v.value for v in status.values})
            for array in self._messages
            for status in array.status
            if status.name == name
        ]

    def latest(self, name):
        """The newest of one part; None before the first."""
        return next(reversed(self.of(name)), None)


@contextmanager
def ros_graph():
    rclpy.init(args=[])
    graph = Graph()
    try:
        yield graph
    finally:
        graph.close()
        rclpy.try_shutdown()


@pytest.fixture
def boards():
    """Makes virtual boards, which end with the test."""
    with ExitStack() as stack:
        yield lambda *arguments, **options: stack.enter_context(VirtualBoard(*arguments, **options))


@pytest.fixture
def graph(boards):
    # After the nodes, so that no bridge loses its board at the end.
    with ros_graph() as one:
        yield one


@pytest.fixture
def configured():
    """A configuration from nested values, as parameter overrides of a node."""

    def configure(values):
        return overrides(validate(values))

    return configure
