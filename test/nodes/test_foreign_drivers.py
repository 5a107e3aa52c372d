"""Drivers of other people, whose publishers are as they are: heard, or it is said what does not match."""

import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from scipy.spatial.transform import Rotation
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


def until_said(graph, publish, part, *words):
    """Publish until something is said about a part of the estimator."""
    diagnosis = graph.diagnosis()

    next_s = 0.0

    def said():
        nonlocal next_s
        if time.monotonic() > next_s:  # as often as an IMU speaks; a flood would drown what is said
            next_s = time.monotonic() + 0.01
            for _ in range(3):  # the graph may wake us no more than ten times a second
                publish()
        latest = diagnosis.latest(f'estimator: {part}')
        return latest and latest[0] == DiagnosticStatus.WARN and all(word in latest[1] for word in words)

    graph.until(said, ' '.join(words))


def test_stamps_in_another_unit_are_told(graph, configured):
    graph.add(EstimatorNode(parameter_overrides=configured(VALUES)))
    publishers = [graph.probe.create_publisher(Imu, topic, BEST_EFFORT) for topic in TOPICS]
    graph.matched(*TOPICS)
    imu = ImuMessages('imu')

    def publish():
        stamps = time.time_ns() // 1000, time.time_ns()  # the first one's are in microseconds
        for publisher, stamp_ns in zip(publishers, stamps, strict=True):
            publisher.publish(imu.make(stamp_ns, Q))

    until_said(graph, publish, 'imu_1', 'its stamps went on by', 'in another unit? imus.stamps: arrival')


def test_conjugated_quaternions_are_told(graph, configured):
    values = {**VALUES, 'imus': {**VALUES['imus'], 'topics': ['a/data', 'b/data']}}
    graph.add(EstimatorNode(parameter_overrides=configured(values)))
    publishers = [graph.probe.create_publisher(Imu, topic, BEST_EFFORT) for topic in ('a/data', 'b/data')]
    graph.matched('a/data', 'b/data')
    imu, k = ImuMessages('imu'), 0

    def publish():
        nonlocal k
        k += 1
        lean = Rotation.from_rotvec([0.0, 0.6 + 0.3 * np.sin(0.1 * k), 0.0])
        up = lean.inv().apply([0.0, 0.0, 9.81])
        for publisher in publishers:
            publisher.publish(imu.make(T0 + k * 10_000_000, lean.inv().as_quat(), up))

    until_said(
        graph, publish, 'orientations', 'IMU 1, 2: its acceleration shows that its quaternions are conjugated'
    )


def test_where_they_cannot_be_heard_it_is_said_why_and_what_to_do(graph, configured):
    logs = graph.listen_to_logs()
    graph.add(EstimatorNode(parameter_overrides=configured({**VALUES, 'run': {'source': 'sim'}})))
    for topic in TOPICS:
        graph.probe.create_publisher(Imu, topic, BEST_EFFORT)
    for topic in TOPICS:
        what = f'{topic}: a publisher is not heard, its RELIABILITY does not match; drivers are heard whatever they'
        graph.until(lambda what=what: [line for line in logs if what in line.msg], what)
