"""IMUs without orientation on a real graph: told, or fused as a replay fuses them."""

import time
from importlib.util import find_spec

import numpy as np
import pytest
from geometry_msgs.msg import PoseArray
from sensor_msgs.msg import Imu, MagneticField
from virtual_arms import arm_of

from sesa2.bags.reading import read_poses
from sesa2.bags.recording import open_recording
from sesa2.bags.replay import replay
from sesa2.bags.writing import new_bag
from sesa2.configuration import validate
from sesa2.link.clock import steady_ns
from sesa2.messages.field_messages import FIELD_TYPE, FieldMessages
from sesa2.messages.imu_messages import TYPE, ImuMessages
from sesa2.nodes.estimator import EstimatorNode
from sesa2.nodes.player import Player
from sesa2.nodes.recorder import Recorder
from sesa2.nodes.serial_bridge import SerialBridge
from sesa2.ros.qos import STREAM
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model

VALUES = {
    'arm': {'length': 0.2},
    'imus': {'ids': [1, 2], 'positions': [0.1, 0.2]},
    'markers': {'names': ['A'], 'positions': [0.1]},
    'models': ['pcc'],
    'sweep_timeout': 30.0,
}
T0 = 1_700_000_000_000_000_000
needs_vqf = pytest.mark.skipif(find_spec('vqf') is None, reason='vqf is not installed (extra raw)')


def values(fusion):
    return {**VALUES, 'imus': {**VALUES['imus'], 'fusion': fusion}}


def leaning(n):
    """Messages (imu, mag) by id of two IMUs that lean about y, to and fro."""
    t = np.arange(n) / 100.0
    stamps = T0 + 10_000_000 * np.arange(n)
    said = {}
    for i in (1, 2):
        lean, zero = 0.3 * i + 0.2 * np.sin(5.0 * t), np.zeros(n)
        rates = np.stack([zero, np.cos(5.0 * t), zero], axis=-1)
        up = 9.81 * np.stack([-np.sin(lean), zero, np.cos(lean)], axis=-1)
        field = 1e-6 * np.stack([40 * np.sin(lean), zero + 20.0, -40 * np.cos(lean)], axis=-1)
        said[i] = (
            [row.tobytes() for row in ImuMessages(f'imu_{i}').make_raw(stamps + i, rates, up)],
            [row.tobytes() for row in FieldMessages(f'imu_{i}').make_fields(stamps + i, field)],
        )
    return said


def write_said(path, said):
    """A recording of such messages."""
    with new_bag(path) as bag:
        kinds = (('data', TYPE), ('mag', FIELD_TYPE))
        topics = {i: [bag.add_topic(f'/imu_{i}/{kind}', name) for kind, name in kinds] for i in (1, 2)}
        for k in range(len(said[1][0])):
            for i in (1, 2):
                for topic, data in zip(topics[i], said[i], strict=True):
                    bag.write(topic, T0 + 10_000_000 * k + i, data[k])


def publish(graph, fields, n=50):
    kinds = [(Imu, 'data'), (MagneticField, 'mag')][: 2 if fields else 1]
    publishers = {(i, kind): graph.probe.create_publisher(cls, f'imu_{i}/{kind}', STREAM)
                  for i in (1, 2) for cls, kind in kinds}  # fmt: skip
    graph.matched(*(f'imu_{i}/{kind}' for i, kind in publishers))
    said = leaning(n)

    def say(k):
        for i in (1, 2):
            for (_, kind), data in zip(kinds, said[i], strict=False):
                publishers[i, kind].publish(data[k])

    return said, say


def test_an_imu_without_orientation_is_told_and_makes_no_straight_arm(graph, configured):
    node = graph.add(EstimatorNode(parameter_overrides=configured(values('none'))))
    diagnosis = graph.diagnosis()
    _, say = publish(graph, fields=False, n=3000)
    k = iter(range(3000))

    def told():
        if (at := next(k, None)) is not None:
            say(at)
        found = diagnosis.latest('estimator: imu_2')
        return found and 'orientation_covariance[0] is −1' in found[1] and found[1]

    assert 'imus.fusion: 6d' in graph.until(told, 'a word about IMU 2')
    assert node.n_sweeps == 0
    assert sum(node.intake.refused[1].values()) > 0


@needs_vqf
@pytest.mark.parametrize('fusion', ['6d', '9d'])
def test_live_they_are_fused_as_in_a_replay(graph, configured, tmp_path, fusion):
    node = graph.add(EstimatorNode(parameter_overrides=configured(values(fusion))))
    markers = graph.listen(PoseArray, 'pcc/markers', STREAM)
    said, say = publish(graph, fields=fusion == '9d')
    for k in range(50):
        say(k)
        graph.until(lambda n=k + 1: all(node.received[i] == n for i in (1, 2)), 'the samples')
        if fusion == '9d':  # each field waits for the next sample
            graph.until(lambda: all(one._fields for one in node.intake._filters.values()), 'the fields')
    expected = 50 if fusion == '6d' else 49
    graph.until(lambda: len(markers) == expected, 'a result of each sweep')
    write_said(tmp_path / 'raw', said)
    replay(tmp_path / 'raw', node.configuration, tmp_path / 'out')
    replayed = read_poses(tmp_path / 'out', 'pcc/markers').positions[:, 0]
    live = [[m.poses[0].position.x, m.poses[0].position.y, m.poses[0].position.z] for m in markers]
    np.testing.assert_allclose(live, replayed, rtol=0.0, atol=1e-14)
    # An arc whose end leans by what IMU 1 says, about y; 9D knows that y is north.
    lean = 0.3 + 0.2 * np.sin(5.0 * np.arange(50 - expected, 50) / 100.0)
    np.testing.assert_allclose(replayed[:, 0], 0.1 * (1.0 - np.cos(lean)) / lean, atol=5e-4)
    np.testing.assert_allclose(replayed[:, 1], 0.0, atol=5e-4)


@needs_vqf
def test_fields_and_raw_samples_are_recorded_whole(graph, configured, tmp_path):
    recorded = {**values('9d'), 'record': {'file': str(tmp_path / 'bag')}}
    recorder = graph.add(Recorder(parameter_overrides=configured(recorded)))
    said, say = publish(graph, fields=True)
    for k in range(50):
        say(k)
    graph.until(lambda: recorder.n_messages >= 200, 'all messages')
    recorder.close()
    with open_recording(tmp_path / 'bag') as recording:
        written = [m.data for m in recording.messages(['/imu_1/data'])]
        assert written == said[1][0]
        assert [m.data for m in recording.messages(['/imu_1/mag'])] == said[1][1]


def test_fields_are_played_beside_their_samples(graph, configured, tmp_path):
    said = leaning(50)
    write_said(tmp_path / 'bag', said)
    got = {(i, kind): [] for i in (1, 2) for kind in ('data', 'mag')}
    for (i, kind), messages in got.items():
        cls = Imu if kind == 'data' else MagneticField
        graph.probe.create_subscription(cls, f'imu_{i}/{kind}', messages.append, STREAM, raw=True)
    played = {**values('9d'), 'run': {'source': 'bag', 'bag': str(tmp_path / 'bag'), 'loop': True}}
    # Again and again: on a busy machine the two may know each other only after the first round.
    graph.add(Player(parameter_overrides=configured(played)))
    graph.until(lambda: all(got.values()), 'samples and fields')
    for (i, kind), messages in got.items():
        assert set(messages) <= set(said[i][kind == 'mag'])


@needs_vqf
def test_a_board_without_fusion_gives_the_shape_of_its_arm(graph, configured, boards):
    """Gyroscopes, accelerometers and magnetometers over the link, fused here: the markers are where the arm is."""
    given = {
        **values('9d'),
        'imus': {**values('9d')['imus'], 'positions': [0.1, 0.2], 'headings': [0.3, -0.4]},
        'models': ['pcc_exact'],
        'serial': {'fusion': 'RAW'},
    }
    c = validate(given)
    board = boards(arm_of(c))
    given['serial'] = {'fusion': 'RAW', 'port': board.path}
    graph.add(EstimatorNode(parameter_overrides=configured(given)))
    markers = graph.listen(PoseArray, 'pcc_exact/markers', STREAM)
    graph.add(SerialBridge(parameter_overrides=configured(given)))
    graph.until(lambda: len(markers) >= 900, '9 s of shapes')  # it holds still for 3, then moves
    to_steady_ns = time.time_ns() - steady_ns()
    errors, travel = [], []
    for message in markers[-400:]:
        stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        links = board.truth(board.motion_time(stamp_ns - to_steady_ns))
        true = create_model('pcc_exact', c.layout).fit(Measured(links, c.base)).positions([0.1])[0]
        p = message.poses[0].position
        errors.append(np.linalg.norm([p.x, p.y, p.z] - true))
        travel.append(true)
    assert np.ptp(travel, axis=0).max() > 0.02
    assert np.median(errors) < 0.004
