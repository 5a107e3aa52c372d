"""Running nodes in a process."""

import pytest
import rclpy.node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from sesa2.configuration import ConfigurationError
from sesa2.errors import Sesa2Error
from sesa2.ros.qos import STREAM
from sesa2.ros.spinning import Spinner, ros_context, run_alone


class Listener(rclpy.node.Node):
    """Refuses what comes after its end."""

    def __init__(self):
        super().__init__('listener')
        self.heard = []
        self.closed = False
        self.subscription = self.create_subscription(String, 'words', self.take, STREAM)
        self.echo = self.create_publisher(String, 'echo', STREAM)

    def take(self, message):
        assert not self.closed
        self.echo.publish(message)
        self.heard.append(message.data)

    def close(self):
        self.closed = True


def full_queue(graph, listener):
    """A listener's publisher, after more has come for it than it was given time to hear."""
    words = graph.probe.create_publisher(String, 'words', STREAM)
    graph.matched('words')
    words.publish(String(data='first'))
    graph.until(lambda: listener.heard, 'the first')
    for k in range(50):
        words.publish(String(data=str(k)))
    assert words.wait_for_all_acked()
    return words


def test_what_comes_too_late_for_a_node_does_nothing(graph):
    listener = graph.add(Listener())
    full_queue(graph, listener)
    graph.remove(listener)
    assert listener.closed
    # All that stood in the queue is over when this is heard.
    another = graph.listen(String, 'words', STREAM)
    full_queue(graph, type('Heard', (), {'heard': another}))
    assert listener.heard == ['first']


def test_a_node_can_be_ended_by_a_request(graph):
    listener = graph.add(Listener())

    def end(request, response):
        graph.remove(listener)
        return response

    graph.probe.create_service(Trigger, 'end', end)
    full_queue(graph, listener)
    graph.call(Trigger, 'end', Trigger.Request())
    assert listener.closed


def test_a_node_that_cannot_close_is_ended_all_the_same():
    class Stubborn(Listener):
        def close(self):
            raise Sesa2Error('disk full')

    with ros_context([]), Spinner() as spinner:
        spinner.add(node := Stubborn())
        with pytest.raises(Sesa2Error, match='disk full'):
            spinner.remove(node)
        assert 'listener' not in rclpy.create_node('probe').get_node_names()


def test_a_program_ends_with_1_when_its_node_has_failed(capfd):
    class Failed(Listener):
        finished = True
        failure = Sesa2Error('the port is gone')

    assert run_alone(Failed) == 1
    assert capfd.readouterr().err == 'error: the port is gone\n'


def test_ros_says_why_it_cannot_start(tmp_path):
    file = tmp_path / 'arm.yaml'
    arguments = ['--ros-args', '--params-file', str(file)]
    with pytest.raises(ConfigurationError, match='cannot be read: No such file'), ros_context(arguments):
        pass
    file.write_text('/**:\n  ros__parameters:\n    imus: {positions: [0.1, 0, 0.3]}\n')
    with (
        pytest.raises(ConfigurationError, match=r'imus\.positions\[1\]: got the integer 0.*write 0\.0'),
        ros_context(arguments),
    ):
        pass
    with (
        pytest.raises(Sesa2Error, match=r'ROS cannot start: .*bogus'),
        ros_context(['--ros-args', '--bogus']),
    ):
        pass
