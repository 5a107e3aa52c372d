"""An estimator that hears nothing says what it expected and what is there instead."""

import subprocess
import sys

import pytest
import rclpy
from rclpy.context import Context
from sensor_msgs.msg import Imu
from std_msgs.msg import String

from sesa2.messages.imu_messages import ImuMessages
from sesa2.nodes.estimator import EstimatorNode
from sesa2.ros.qos import STREAM

VALUES = {
    'run': {'source': 'external'},
    'arm': {'length': 0.3},
    'imus': {'ids': [2, 5], 'positions': [0.1, 0.3]},
    'models': ['pcc'],
}


def values(**imus):
    return {**VALUES, 'imus': {**VALUES['imus'], **imus}}


@pytest.fixture
def publisher(graph):
    return lambda topic: graph.probe.create_publisher(Imu, topic, STREAM)


@pytest.fixture
def estimator(graph, configured):
    """An estimator, once it knows who publishes."""

    def make(*topics, **imus):
        node = graph.add(EstimatorNode(parameter_overrides=configured(values(**imus))))
        graph.until(lambda: all(node.count_publishers(topic) for topic in topics), 'publishers known')
        return node

    return make


def test_other_names_are_told(publisher, estimator):
    there = [publisher('/imu2/data'), publisher('/bno055/imu')]
    node = estimator(*(p.topic_name for p in there))
    assert node.unheard == (
        'no IMU is heard; expected /imu_2/data, /imu_5/data of sensor_msgs/msg/Imu; '
        'on the graph are of this type: /bno055/imu, /imu2/data; imus.topics says which is whose'
    )


def test_a_namespace_is_named(publisher, estimator):
    there = [publisher('/arm/imu_2/data'), publisher('/arm/imu_5/data')]
    told = estimator(*(p.topic_name for p in there)).unheard
    assert told.endswith('/arm/imu_2/data, /arm/imu_5/data; these IMUs are in the namespace /arm')


def test_nothing_at_all(estimator):
    assert estimator().unheard.endswith('on the graph are of this type: none')


def test_another_type(estimator):
    # One participant of the middleware does not take a topic with two types.
    elsewhere = Context()
    rclpy.init(context=elsewhere)
    other = rclpy.create_node('other', context=elsewhere)
    there = other.create_publisher(String, '/imu_2/data', STREAM)
    try:
        told = estimator(there.topic_name).unheard
    finally:
        other.destroy_node()
        rclpy.shutdown(context=elsewhere)
    assert '/imu_2/data is of std_msgs/msg/String' in told


def test_what_is_heard_is_not_missed(graph, publisher, estimator):
    heard = publisher('/imu_5/data')
    node = estimator('/imu_5/data')
    graph.matched('imu_5/data')
    heard.publish(ImuMessages('imu_5').make(1_700_000_000 * 10**9, [0.0, 0.0, 0.0, 1.0]))
    graph.until(lambda: node.received[5], 'a message')
    assert node.unheard == (
        'not heard: IMU 2; expected /imu_2/data of sensor_msgs/msg/Imu; on the graph are of this type: none'
    )
    # One that is not enabled is not waited for.
    assert estimator(enabled=[False, True]).unheard.startswith('no IMU is heard; expected /imu_5/data of')


def test_it_is_told_after_two_seconds_and_waiting_goes_on(graph, publisher, estimator):
    logs = graph.listen_to_logs()
    node = estimator(publisher('/imu2/data').topic_name)
    [line] = graph.until(lambda: [m.msg for m in logs if 'no IMU is heard' in m.msg], 'a warning')
    assert line.endswith('; waiting for them')
    late = [publisher('/imu_2/data'), publisher('/imu_5/data')]
    graph.matched('imu_2/data', 'imu_5/data')
    stamps = iter(range(1_700_000_000 * 10**9, 1_700_000_100 * 10**9, 10_000_000))

    def estimated():
        stamp = next(stamps)
        for i, one in zip((2, 5), late, strict=True):
            one.publish(ImuMessages(f'imu_{i}').make(stamp, [0.0, 0.0, 0.0, 1.0]))
        return node.n_sweeps

    graph.until(estimated, 'a result')
    assert node.unheard == ''


def test_a_run_that_heard_nothing_fails(tmp_path):
    config = tmp_path / 'arm.yaml'
    config.write_text(
        '/**:\n  ros__parameters:\n    arm: {length: 0.3}\n'
        '    imus: {ids: [2, 5], positions: [0.1, 0.3]}\n    models: [pcc]\n'
    )
    command = [sys.executable, '-m', 'sesa2.cli', 'run', '--config', config, '--source', 'external']
    ended = subprocess.run(
        [*command, '--duration', '0.5'], capture_output=True, text=True, timeout=120, check=False
    )
    assert ended.returncode == 1
    assert 'error: no IMU is heard; expected /imu_2/data, /imu_5/data of sensor_msgs/msg/Imu' in ended.stderr
    assert '0 sweeps estimated' in ended.stdout
