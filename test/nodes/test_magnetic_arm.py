"""Fields of magnetometers on a real graph: to shapes, into bags and out of them; and what is said when some are bad."""

import time
from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from magnetic_bag import CONFIG, configuration, field_message, motion, of_z, readings, stamp_of, write_fields
from nav_msgs.msg import Path
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState, MagneticField

from sesa2.bags.estimate_arrays import read_estimate
from sesa2.bags.replay import replay
from sesa2.configuration import files
from sesa2.nodes.estimator import EstimatorNode
from sesa2.nodes.field_source import FieldSource
from sesa2.nodes.player import Player
from sesa2.nodes.recorder import Recorder
from sesa2.ros.parameters import overrides
from sesa2.ros.qos import STREAM

pytest.importorskip('magpylib', reason='magpylib is not installed')

N = 40
NOISE = 0.7e-6
IDS = tuple(range(1, 13))


@pytest.fixture(scope='module')
def values():
    return readings(motion(N), noise=NOISE)


class Arm:
    """A driver of each magnetometer."""

    def __init__(self, graph):
        self.publishers = {
            i: graph.probe.create_publisher(MagneticField, f'magnetometer_{i}/field', STREAM) for i in IDS
        }
        graph.matched(*(f'magnetometer_{i}/field' for i in IDS))

    def sweep(self, k, row, *, without=()):
        for place, (i, value) in enumerate(zip(IDS, row, strict=True)):
            if i not in without:
                self.publishers[i].publish(field_message(stamp_of(k, place), of_z(value)))


@pytest.fixture
def make(graph):
    def start(**options):
        c = configuration(**options)
        # The clock of a busy machine is not to close a sweep of twelve.
        return graph.add(EstimatorNode(parameter_overrides=overrides(replace(c, sweep_timeout=5.0))))

    return start


def test_shapes_as_a_replay_gives_them(graph, make, values, tmp_path):
    make(filter='constant_velocity')
    coordinates = graph.listen(JointState, 'magnetic/coordinates', STREAM)
    tips = graph.listen(PoseStamped, 'magnetic/tip', STREAM)
    states = graph.listen(JointState, 'magnetic/joint_states', STREAM)
    arm = Arm(graph)
    for k, row in enumerate(values):
        arm.sweep(k, row)
        graph.until(lambda k=k: len(tips) > k, 'a tip')
    graph.until(lambda: len(coordinates) == len(states) == N, 'all of them')
    replay(write_fields(tmp_path / 'in', values), configuration(), tmp_path / 'out')
    found = read_estimate(tmp_path / 'out')
    replayed = found.models['magnetic']
    np.testing.assert_allclose([m.position for m in coordinates], replayed.coordinates, atol=1e-9)
    np.testing.assert_allclose(
        [[getattr(m.pose.position, a) for a in 'xyz'] for m in tips], replayed.tip, atol=1e-9
    )
    assert tuple(coordinates[0].name) == replayed.coordinate_names
    assert [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in tips] == found.stamps_ns.tolist()
    assert sum(name.endswith('_l') for name in states[0].name) == 63


def pumped(graph, arm, values, says, *, begin=0, **options):
    """Sweeps, again and again, 40 a second of the stamps, until something is said; how many there were."""
    k = begin

    def step():
        nonlocal k
        arm.sweep(k, values(k), **options)
        k += 1
        until = time.monotonic() + 0.02
        graph.until(lambda: time.monotonic() > until)
        return says()

    graph.until(step, 'what was to be said')
    return k


def test_diagnostics_name_who_is_silent_saturated_and_lost(graph, make, values):
    make(filter='constant_velocity')
    diagnosis = graph.diagnosis()
    tips = graph.listen(PoseStamped, 'magnetic/tip', STREAM)
    arm = Arm(graph)

    def row(k):  # to and fro
        return values[abs((k + N - 1) % (2 * N - 2) - (N - 1))]

    def said(part, level, *texts):
        latest = diagnosis.latest(f'estimator: {part}')
        return latest and latest[0] == level and all(text in latest[1] for text in texts)

    OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
    k = pumped(
        graph,
        arm,
        row,
        lambda: said('fields', OK, 'Hz') and said('magnetometer_6', OK) and said('magnetic fields', OK),
    )
    assert not diagnosis.of('estimator: sweeps')  # it has no IMUs

    def saturated(k):
        return np.where(np.array(IDS) == 6, 5e-3, row(k))

    k = pumped(graph, arm, saturated, lambda: said('magnetometer_6', WARN, 'left out, saturated'), begin=k)
    assert said('magnetometer_5', OK)

    def jumping(k):
        return row(k) + np.where(np.array(IDS) == 9, 30e-6, 0.0)

    k = pumped(graph, arm, jumping, lambda: said('magnetometer_9', WARN, 'left out, jumping'), begin=k)
    n = len(tips)
    # For a while none of the second plane is heard: two segments are told by the rest only.
    k = pumped(
        graph,
        arm,
        row,
        lambda: said('magnetometer_7', WARN, 'nothing measured') and len(tips) > n,
        begin=k,
        without=(5, 6, 7, 8),
    )
    k = pumped(
        graph,
        arm,
        row,
        lambda: said('magnetic fields', WARN, 'not told by the magnetometers: segment_'),
        begin=k,
        without=(5, 6, 7, 8),
    )
    k = pumped(
        graph,
        arm,
        lambda k: np.zeros(12),
        lambda: said('fields', ERROR, 'no result: no shape explains') and said('magnetic fields', ERROR),
        begin=k,
    )
    pumped(graph, arm, row, lambda: said('fields', OK) and said('magnetometer_7', OK), begin=k)


def test_played_estimated_and_recorded(graph, values, tmp_path):
    bag = write_fields(tmp_path / 'in', values)
    c = configuration()
    c = replace(
        c,
        run=replace(c.run, source='bag', bag=str(bag)),
        record=replace(c.record, file=str(tmp_path / 'out')),
    )
    given = overrides(c)
    recorder = graph.add(Recorder(parameter_overrides=given))
    graph.add(EstimatorNode(parameter_overrides=given))
    player = graph.add(Player(parameter_overrides=given))
    graph.until(lambda: player.finished, 'the end of the bag')
    assert player.failure is None
    assert player.n_played == 12 * N
    graph.until(lambda: recorder.n_messages >= 12 * N + 5 * N, 'everything recorded')
    graph.remove(recorder)
    with AnyReader([tmp_path / 'out']) as reader:
        counts = {one.topic: one.msgcount for one in reader.connections}
    assert counts['/magnetometer_12/field'] == counts['/magnetic/coordinates'] == N
    replay(tmp_path / 'out', files.load(CONFIG), tmp_path / 'again')
    live, again = (read_estimate(tmp_path / name) for name in ('out', 'again'))
    np.testing.assert_array_equal(live.stamps_ns, again.stamps_ns)
    np.testing.assert_allclose(
        live.models['magnetic'].coordinates, again.models['magnetic'].coordinates, atol=1e-9
    )


def test_a_magnetometer_without_stamps(graph, make, values):
    node = make(filter='none')
    lines = graph.listen_to_logs()
    tips = graph.listen(PoseStamped, 'magnetic/tip', STREAM)
    arm = Arm(graph)
    graph.until(lambda: True)
    for i, value in zip(IDS, values[0], strict=True):
        arm.publishers[i].publish(field_message(0, of_z(value)))
    graph.until(lambda: tips, 'a tip')
    assert sum('have no stamp (0)' in line.msg for line in lines) == 12
    assert node.fields.n_sweeps == 1


def test_a_simulated_arm_its_shape_and_the_truth(graph):
    c = configuration()
    c = replace(c, field_source=replace(c.field_source, build_errors=0.0, rate=20.0))
    lines = graph.listen_to_logs()
    given = overrides(c)
    graph.add(EstimatorNode(parameter_overrides=given))
    graph.add(FieldSource(parameter_overrides=given))
    tips = graph.listen(PoseStamped, 'magnetic/tip', STREAM)
    truth = graph.listen(PoseStamped, 'truth/tip', STREAM)
    true_coordinates = graph.listen(JointState, 'truth/coordinates', STREAM)
    shapes = graph.listen(Path, 'truth/shape', STREAM)
    coordinates = graph.listen(JointState, 'magnetic/coordinates', STREAM)
    graph.until(lambda: len(tips) >= 20 and len(coordinates) >= 20, 'results')

    def of(messages, values):
        return {(m.header.stamp.sec, m.header.stamp.nanosec): np.array(values(m)) for m in messages}

    def position(m):
        return [m.pose.position.x, m.pose.position.y, m.pose.position.z]

    ours, theirs = of(tips, position), of(truth, position)
    common = sorted(ours.keys() & theirs.keys())
    assert len(common) >= 10
    assert max(np.linalg.norm(ours[k] - theirs[k]) for k in common) < 0.02
    ours, theirs = (of(m, lambda m: m.position) for m in (coordinates, true_coordinates))
    common = sorted(ours.keys() & theirs.keys())
    assert max(np.abs(ours[k] - theirs[k]).max() for k in common) < 0.1
    assert coordinates[0].name == true_coordinates[0].name
    assert len(shapes[0].poses) == 64
    assert any('uncalibrated' in line.msg for line in lines)
