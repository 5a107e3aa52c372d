"""What a callback raises: told once, counted, and no more than the request or the node ends."""

import logging

import pytest
from std_msgs.msg import String
from std_srvs.srv import Trigger

from sesa2.errors import Sesa2Error
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.diagnostics import Diagnostics
from sesa2.ros.qos import STREAM
from sesa2.ros.spinning import run_alone


class Fallible(ConfinedNode):
    def __init__(self, error=None):
        super().__init__('fallible')
        self.heard = []
        self.error = error or KeyError('left')
        self.create_subscription(String, 'words', self.take, STREAM)
        self.create_service(Trigger, '~/ask', self.answer)
        self._diagnostics = Diagnostics(self, 'test', list)

    def take(self, message):
        self.heard.append(message.data)
        if message.data == 'bad':
            raise self.error.with_traceback(None)

    def answer(self, request, response):
        raise self.error.with_traceback(None)


class Lasting(Fallible):
    GOES_ON = True


def say(graph, *words):
    publisher = graph.probe.create_publisher(String, 'words', STREAM)
    graph.matched('words')
    for word in words:
        publisher.publish(String(data=word))


def test_after_a_message_it_is_done_for_and_says_where(graph):
    logs = graph.listen_to_logs()
    node = graph.add(Fallible())
    say(graph, 'good', 'bad', 'late')
    graph.until(lambda: node.finished, 'its end')
    assert isinstance(node.failure, Sesa2Error)
    assert str(node.failure).startswith("fallible: KeyError: 'left' (test_confined_node.py, line ")
    assert str(node.failure).endswith(', in take)')
    assert '\n' not in str(node.failure)
    graph.until(lambda: [log for log in logs if log.name == 'fallible'], 'its log')
    [log] = [log for log in logs if log.name == 'fallible']
    assert "KeyError: 'left' (test_confined_node.py" in log.msg
    # The graph goes on, and what comes later is not given to a node in an unknown state.
    say(graph, 'later')
    graph.call(Trigger, 'fallible/ask', Trigger.Request())
    assert node.heard == ['good', 'bad']


def test_what_was_foreseen_is_its_failure_as_it_is(graph):
    foreseen = Sesa2Error('the port is gone')
    node = graph.add(Fallible(foreseen))
    say(graph, 'bad')
    graph.until(lambda: node.finished, 'its end')
    assert node.failure is foreseen


def test_a_node_that_goes_on_tells_once_and_counts(graph):
    logs, diagnosis = graph.listen_to_logs(), graph.diagnosis()
    node = graph.add(Lasting())
    say(graph, 'bad', 'bad', 'bad', 'good')
    graph.until(lambda: node.heard[-1:] == ['good'], 'the last word')
    assert not node.finished
    assert node.failure is None
    graph.until(
        lambda: (diagnosis.latest('fallible: faults') or [0, 0, {}])[2].get('faults') == '3', 'the count'
    )
    assert diagnosis.latest('fallible: faults')[0] == b'\2'
    assert len([log for log in logs if log.name == 'fallible']) == 1


def test_a_request_that_goes_wrong_is_answered_and_ends_nothing(graph):
    node = graph.add(Fallible())
    for n in (1, 2):
        response = graph.call(Trigger, 'fallible/ask', Trigger.Request())
        assert not response.success
        assert "KeyError: 'left' (test_confined_node.py" in response.message
        assert node.n_faults == n
    assert not node.finished


@pytest.mark.parametrize('error', [KeyError('x'), Sesa2Error('no'), RecursionError('deep'), OSError(5, 'io')])
def test_a_program_whose_node_falls_ends_with_1_and_one_line(capfd, error):
    class Falls(ConfinedNode):
        def __init__(self):
            super().__init__('falls')
            self.create_timer(0.01, self.tick)

        def tick(self):
            raise error

    def cannot_be_made():
        raise error

    for make in (Falls, cannot_be_made):
        assert run_alone(make) == 1
        lines = [line for line in capfd.readouterr().err.splitlines() if not line.startswith('[ERROR]')]
        assert len(lines) == 1
        assert lines[0].startswith('error: ')
        assert str(error) in lines[0]


def test_the_traceback_is_there_for_whoever_mends_it(caplog, monkeypatch):
    def cannot_be_made():
        raise KeyError('x')

    log = logging.getLogger('sesa2')
    monkeypatch.setenv('SESA2_DEBUG', '1')
    try:
        assert run_alone(cannot_be_made) == 1
    finally:
        log.setLevel(logging.NOTSET)
    assert 'in cannot_be_made' in caplog.text
