"""What a viewer hears of its own arm, and of others on the same graph."""

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.diagnostics import OK, Diagnostics
from sesa2.ros.graph_listening import Listener


@pytest.mark.parametrize(('namespace', 'own'), [('', ''), ('left', 'left/'), ('/lab/left', 'lab/left/')])
def test_only_the_diagnostics_of_its_namespace_are_heard(graph, namespace, own):
    node = graph.add(rclpy.create_node('viewer', namespace=namespace))
    listener = Listener(node, node)
    publisher = graph.probe.create_publisher(DiagnosticArray, '/diagnostics', 10)
    graph.matched('/diagnostics')
    names = ['estimator', 'left/estimator', 'lab/left/estimator', 'right/estimator', 'left_estimator', 'usb']
    statuses = [DiagnosticStatus(name=f'{n}: arm: {n}', message=n) for n in names]
    publisher.publish(DiagnosticArray(status=statuses))
    graph.until(lambda: listener.live.diagnostics, 'what is said')
    assert set(listener.live.heard('estimator')) == {f'arm: {own}estimator'}
    others = {'left_estimator', 'usb', 'estimator'} if not own else {'estimator'}
    assert {name.partition(': ')[0] for name in listener.live.diagnostics} == others


@pytest.mark.parametrize(
    ('namespace', 'name'), [('', 'arm: x'), ('left', 'left/arm: x'), ('/a/b', 'a/b/arm: x')]
)
def test_what_a_node_says_carries_its_namespace(graph, namespace, name):
    diagnosis = graph.diagnosis()
    node = graph.add(ConfinedNode('arm', namespace=namespace))
    node.said = Diagnostics(node, 'h', lambda: [('x', OK, 'well', {})])
    graph.until(lambda: diagnosis.latest(name), name)
