"""Drivers of other people, whose publishers are as they are: heard, or it is said what does not match."""

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu

from sesa2.bags.reading import ImuRecording
from sesa2.bags.recording import open_recording
from sesa2.messages.imu_messages import ImuMessages
from sesa2.nodes.estimator import EstimatorNode
from sesa2.nodes.recorder import Recorder

VALUES = {
    'arm': {'length': 0.2},
    'imus': {'ids': [1, 2], 'positions': [0.1, 0.2], 'topics': ['/left/imu', 'right/data_raw']},
    'models': ['pcc'],
    'run': {'source': 'external'},
    'sweep_timeout': 30.0,
}
TOPICS = ('/left/imu', '/right/data_raw')
T0 = 1_700_000_000_000_000_000
Q = (0.0, 0.1, 0.0, 0.995)
BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
QOS = {
    'best effort': BEST_EFFORT,
    'latched': QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    'reliable': QoSProfile(depth=1),
    'best effort and latched': QoSProfile(
        depth=1, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.TRANSIENT_LOCAL
    ),
}


@pytest.mark.parametrize('qos', QOS.values(), ids=QOS)
def test_they_are_heard_and_recorded(graph, configured, tmp_path, qos):
    values = configured({**VALUES, 'record': {'file': str(tmp_path / 'bag')}})
    estimator = graph.add(EstimatorNode(parameter_overrides=values))
    recorder = graph.add(Recorder(parameter_overrides=values))
    publishers = [graph.probe.create_publisher(Imu, topic, qos) for topic in TOPICS]
    graph.matched(*TOPICS)
    imu = ImuMessages('')  # no frame_id, as some have none
    k = 0

    def sweeps():
        nonlocal k
        k += 1
        for publisher in publishers:
            publisher.publish(imu.make(T0 + k * 10_000_000, Q))
        return estimator.n_sweeps >= 5 and recorder.n_messages > 10

    graph.until(sweeps, 'sweeps')
    graph.remove(recorder)
    with open_recording(tmp_path / 'bag') as recording:
        counts = ImuRecording(recording, estimator.configuration).counts
    assert min(counts.values()) >= 5


def test_where_they_cannot_be_heard_it_is_said_why_and_what_to_do(graph, configured):
    logs = graph.listen_to_logs()
    graph.add(EstimatorNode(parameter_overrides=configured({**VALUES, 'run': {'source': 'sim'}})))
    for topic in TOPICS:
        graph.probe.create_publisher(Imu, topic, BEST_EFFORT)
    for topic in TOPICS:
        what = f'{topic}: a publisher is not heard, its RELIABILITY does not match; drivers are heard whatever they'
        graph.until(lambda what=what: [line for line in logs if what in line.msg], what)
