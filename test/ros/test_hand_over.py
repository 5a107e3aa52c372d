"""Messages from node to node within a process: in order, from any thread, whole, counted where they are too many."""

import threading

import pytest

from sesa2.ros import hand_over as module
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.hand_over import HandOver


@pytest.fixture
def way(graph):
    way, node = HandOver(), graph.add(ConfinedNode('listener', namespace='left'))
    return way, node


def test_messages_of_all_topics_are_taken_in_the_order_of_sending_in_the_executors_thread(graph, way):
    way, node = way
    taken, threads = [], set()

    def take(topic):
        return lambda data: (taken.append((topic, data)), threads.add(threading.get_ident()))

    for topic in ('a', '/b'):
        way.listen(node, topic, take(topic))
    sent = [('/left/a' if k % 3 else '/b', bytes([k % 256])) for k in range(3000)]

    def send():
        for k in range(0, 3000, 8):
            way.send(sent[k : k + 8])

    thread = threading.Thread(target=send)
    thread.start()
    graph.until(lambda: len(taken) == 3000, 'all')
    thread.join()
    assert taken == [('a' if topic == '/left/a' else '/b', data) for topic, data in sent]
    assert threads == {threading.get_ident()}
    assert way.lost == 0


def test_what_nobody_listens_to_is_left_and_a_full_name_is_of_one_namespace(graph, way):
    way, node = way
    taken = []
    way.listen(node, 'a', taken.append)
    way.send([('/right/a', b'1'), ('/a', b'2'), ('/left/a', b'3')])
    graph.until(lambda: taken, 'one')
    assert taken == [b'3']


def test_who_is_too_far_behind_loses_the_oldest_and_it_is_counted(graph, way, monkeypatch):
    way, node = way
    monkeypatch.setattr(module, 'WAITING_MAX', 100)
    taken = []
    way.listen(node, 'a', taken.append)
    for k in range(130):
        way.send([('/left/a', bytes([k]))])
    graph.until(lambda: len(taken) >= 100, 'the rest')
    assert taken == [bytes([k]) for k in range(30, 130)]
    assert way.lost == 30


def test_what_is_sent_while_messages_are_taken_wakes_the_node_again(graph, way):
    way, node = way
    taken = []

    def take(data):
        taken.append(data)
        if len(taken) < 500:
            way.send([('/left/a', data)])

    way.listen(node, 'a', take)
    way.send([('/left/a', b'1')])
    graph.until(lambda: len(taken) == 500, 'what came of it')


def test_what_a_callback_raises_is_confined_to_its_node(graph, way):
    way, node = way
    way.listen(node, 'a', lambda data: data.decode('ascii'))
    way.send([('/left/a', b'\xff'), ('/left/a', b'a')])
    graph.until(lambda: node.failure, 'a failure')
    assert node.n_faults == 1


def test_without_a_node_or_after_it_nothing_is_kept_for_ever(graph, way, monkeypatch):
    way, node = way
    monkeypatch.setattr(module, 'WAITING_MAX', 100)
    HandOver().send([('/left/a', b'1')])
    way.listen(node, 'a', print)
    graph.remove(node)
    for _ in range(1000):
        way.send([('/left/a', b'1')])
    assert len(way._waiting) <= 100
