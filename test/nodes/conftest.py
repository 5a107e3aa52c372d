"""A real ROS graph in the test's own process."""

import time
from collections.abc import Callable
from contextlib import contextmanager

import pytest
import rclpy
from rclpy.experimental.events_executor import EventsExecutor

from sesa2.configuration import validate
from sesa2.nodes.parameters import overrides

# Long enough for a slow machine; reached only by a test that fails.
PATIENCE_S = 60.0


class Graph:
    """Nodes under test and the test's own node `probe`, on one executor."""

    def __init__(self):
        self.executor = EventsExecutor()
        self.nodes = []
        self.probe = self.add(rclpy.create_node('probe'))

    def add(self, node):
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def until(self, condition: Callable[[], object], what: str = ''):
        """Spin until the condition holds."""
        deadline = time.monotonic() + PATIENCE_S
        while not (result := condition()):
            assert time.monotonic() < deadline, f'waited {PATIENCE_S:g} s in vain: {what or condition}'
            self.executor.spin_once(timeout_sec=0.05)
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

    def call(self, kind, name, request):
        client = self.probe.create_client(kind, name)
        self.until(client.service_is_ready, f'service {name}')
        future = client.call_async(request)
        self.until(future.done, f'answer of {name}')
        return future.result()

    def close(self):
        for node in reversed(self.nodes):
            if hasattr(node, 'close'):
                node.close()
            node.destroy_node()
        self.executor.shutdown()


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
def graph():
    with ros_graph() as one:
        yield one


@pytest.fixture
def configured():
    """A configuration from nested values, as parameter overrides of a node."""

    def configure(values):
        return overrides(validate(values))

    return configure
