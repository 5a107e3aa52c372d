"""Lengths on a real graph: to the sweeps, into bags and out of them; and what is done when they are bad or end."""

import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from growing_arm import MS, VALUES, imu_messages, length_message, lengths_at, write_growing
from made_bags import T0
from processes import failed_clearly, node
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import Imu, JointState

from sesa2.bags.replay import replay
from sesa2.configuration import files, validate
from sesa2.nodes.estimator import EstimatorNode
from sesa2.nodes.player import Player
from sesa2.nodes.recorder import Recorder
from sesa2.ros.qos import STREAM

LENGTHS = 'estimator: lengths'
TOPIC = 'backbone_lengths'


class Arm:
    """Publishers of the IMUs and of one driver of lengths."""

    def __init__(self, graph):
        self._graph = graph
        self.imus = {i: graph.probe.create_publisher(Imu, f'imu_{i}/data', STREAM) for i in (2, 5)}
        self.lengths = graph.probe.create_publisher(JointState, TOPIC, STREAM)
        graph.matched(TOPIC, *(f'imu_{i}/data' for i in self.imus))

    def sweep(self, t):
        for i, data in imu_messages(t):
            self.imus[i].publish(data)

    def length(self, t, **options):
        self.lengths.publish(length_message(t, **options))


@pytest.fixture
def make(graph, configured):
    def start(**values):
        # The clock of a busy machine is not to close a sweep of two IMUs.
        return graph.add(
            EstimatorNode(parameter_overrides=configured({**VALUES, 'sweep_timeout': 5.0, **values}))
        )

    return start


def stamps_ms(messages):
    return [(m.header.stamp.sec * 10**9 + m.header.stamp.nanosec - T0) / MS for m in messages]


def expected_length(tip_stamp_ms, samples):
    values = [np.interp(tip_stamp_ms, samples, column) for column in lengths_at(samples).T]
    return values[0], 0.5 * (values[1] + values[2])


def test_a_sweep_has_the_length_at_its_stamp(graph, make):
    make(models=['rigid'])
    states = graph.listen(JointState, 'rigid/joint_states', STREAM)
    arm = Arm(graph)
    arm.length(0.0)
    arm.sweep(10.0)
    arm.length(25.0)
    graph.until(lambda: len(states) == 1, 'the first result')
    arm.sweep(30.0)
    arm.length(40.0)
    graph.until(lambda: len(states) == 2, 'the second result')
    for state, t in zip(states, (11.0, 31.0), strict=True):
        first, second = expected_length(t, np.array([0.0, 25.0, 40.0]))
        of = dict(zip(state.name, state.position, strict=True))
        total = sum(value for name, value in of.items() if name.endswith('_l'))
        assert total == pytest.approx(first + second, abs=1e-12)
    assert stamps_ms(states) == [11.0, 31.0]


def test_parts_from_two_drivers_in_any_order(graph, make):
    make(models=['rigid'])
    tips = graph.listen(PoseStamped, 'rigid/tip', STREAM)
    arm = Arm(graph)
    other = graph.probe.create_publisher(JointState, TOPIC, STREAM)
    graph.until(lambda: other.get_subscription_count(), 'a match')
    for t in (0.0, 20.0):
        arm.length(t, names=('tip_r', 'tip_l'))
    arm.sweep(10.0)
    for t in (0.0, 20.0):
        other.publish(length_message(t, names=('axis',)))
    graph.until(lambda: len(tips) == 1, 'a result')


class Clock:
    """Time since it was made, ms."""

    def __init__(self):
        self._began = time.monotonic()
        self.now = 0.0

    def go_on(self, graph):
        """Spin for 10 ms."""
        graph.until(lambda: time.monotonic() - self._began >= (self.now + 10.0) / 1e3)
        self.now = round((time.monotonic() - self._began) * 1e3, 3)
        return self.now


def pumped(graph, arm, clock, until, *, lengths=True):
    """Up to 100 lengths and sweeps a second until something holds."""

    def step():
        t = clock.go_on(graph)
        if lengths:
            arm.length(t)
        arm.sweep(t)
        return until()

    graph.until(step, 'what was to come')


def test_when_the_driver_dies_results_end_and_diagnostics_say_so_and_it_resumes(graph, make):
    node_ = make()
    diagnosis = graph.diagnosis()
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    arm, clock = Arm(graph), Clock()

    def says(level, *parts):
        said = diagnosis.latest(LENGTHS)
        return said and said[0] == level and all(part in said[1] for part in parts)

    pumped(graph, arm, clock, lambda: len(tips) > 50 and says(DiagnosticStatus.OK))
    died = clock.now
    graph.probe.destroy_publisher(arm.lengths)
    pumped(
        graph,
        arm,
        clock,
        lambda: says(DiagnosticStatus.ERROR, 'axis is silent for', 'nobody publishes', 'no result without'),
        lengths=False,
    )
    pumped(graph, arm, clock, lambda: node_.assembler.newest_ns > T0 + (died + 3000) * MS, lengths=False)
    assert max(stamps_ms(tips)) <= died + 200.0, 'what held was held for the timeout, and no longer'
    assert max(stamps_ms(tips)) > died
    n = len(tips)
    assert node_._lengths.sweeps.n_without[0] > 20, 'sweeps go on, as for alignment'
    arm.lengths = graph.probe.create_publisher(JointState, TOPIC, STREAM)
    graph.matched(TOPIC)
    pumped(graph, arm, clock, lambda: len(tips) > n + 50 and says(DiagnosticStatus.OK, 'Hz'))
    stamps = stamps_ms(tips)
    assert stamps == sorted(set(stamps))


def test_lengths_that_never_come(graph, make):
    make()
    diagnosis = graph.diagnosis()
    said = graph.until(lambda: diagnosis.latest(LENGTHS), 'diagnostics')
    assert said[0] == DiagnosticStatus.ERROR
    assert said[1].startswith('axis was never heard, tip_l was never heard, tip_r was never heard; nobody')
    assert said[2]['axis: age_s'] == 'never heard'


BAD = [
    (lambda: length_message(500.0)[:70], 'cut short'),
    (lambda: length_message(500.0, names=()), 'without the name of a backbone'),
    (lambda: length_message(500.0, values=[0.1, np.nan, 0.1]), 'no positive number'),
    (lambda: length_message(500.0, values=[0.1, -0.1, 0.1]), 'no positive number'),
]


def test_what_is_bad_is_refused_counted_told_once_and_does_no_harm(graph, make):
    make()
    diagnosis, lines = graph.diagnosis(), graph.listen_to_logs()
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    arm, clock = Arm(graph), Clock()
    pumped(graph, arm, clock, lambda: len(tips) > 20)
    for bad, _ in BAD * 2:
        arm.lengths.publish(bad())
    arm.length(clock.now - 200.0)  # a stamp that goes back
    n = len(tips)
    pumped(graph, arm, clock, lambda: len(tips) > n + 20)

    def told():
        said = diagnosis.latest(LENGTHS)
        return said and said[2].get('axis: dropped: not newer than the last of its backbone') == '1' and said

    _, _, values = graph.until(told, 'the counts')
    warned = [text for level, text, _ in diagnosis.of(LENGTHS) if level == DiagnosticStatus.WARN]
    for _, reason in BAD:
        assert any(reason in text for text in warned)
        assert sum(int(n) for key, n in values.items() if key.startswith('refused: ') and reason in key) in (
            2,
            4,
        )
        assert sum(reason in line.msg for line in lines) == 1
    stamps = stamps_ms(tips)
    assert stamps == sorted(set(stamps))
    n = len(diagnosis.of(LENGTHS))
    pumped(graph, arm, clock, lambda: len(diagnosis.of(LENGTHS)) > n + 1)
    assert diagnosis.latest(LENGTHS)[0] == DiagnosticStatus.OK, 'it is over'


def test_messages_without_a_stamp_have_that_of_their_arrival(graph, make):
    """And a jump is told."""
    make()
    diagnosis = graph.diagnosis()
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    arm = Arm(graph)
    k = [0]

    def step():
        now = (time.time_ns() - T0) / MS
        arm.lengths.publish(
            length_message(-T0 / MS, values=lengths_at(0.0) if k[0] < 50 else lengths_at(0.0) + 0.5)
        )
        arm.sweep(now)
        k[0] += 1
        end = time.monotonic() + 0.005
        graph.until(lambda: time.monotonic() > end)
        said = next((s for s in diagnosis.of(LENGTHS) if 'jumped' in s[1]), None)  # told once
        return len(tips) > 60 and said

    level, text, _ = graph.until(step, 'results and diagnostics')
    assert level == DiagnosticStatus.WARN
    assert any(
        'have no stamp (0); the time of their arrival stands in' in s[1] for s in diagnosis.of(LENGTHS)
    )
    assert 'axis: its length jumped 1 times, faster than 1 m/s' in text


def test_a_clock_that_is_behind_is_named_with_its_lag(graph, make):
    make()
    diagnosis = graph.diagnosis()
    arm = Arm(graph)

    def step():
        now = (time.time_ns() - T0) / MS
        arm.length(now - 3000.0)
        arm.sweep(now)
        end = time.monotonic() + 0.005
        graph.until(lambda: time.monotonic() > end)
        said = diagnosis.latest(LENGTHS)
        return said and 'behind' in said[1] and said[0] == DiagnosticStatus.ERROR and said

    _, text, _ = graph.until(step, 'diagnostics')
    assert 'axis had no length for' in text
    assert 'axis: its stamps are 3.0' in text
    assert 'behind those of the IMUs: separate clocks?' in text


def results_of(path, topic):
    with AnyReader([path]) as reader:
        return {
            m.header.stamp.sec * 10**9 + m.header.stamp.nanosec: [
                m.pose.position.x,
                m.pose.position.y,
                m.pose.position.z,
            ]
            for c, _, d in reader.messages()
            if c.topic == topic
            for m in [reader.deserialize(d, c.msgtype)]
        }


def test_a_replay_of_what_was_recorded_gives_what_live_gave(graph, configured, tmp_path):
    """A bag is played with a gap in its lengths, estimated and recorded; the recording is replayed."""
    sweeps = np.arange(0.0, 4000.0, 10.0)
    samples = [t for t in np.arange(-16.0, 4016.0, 8.0) if not 1500.0 < t < 2500.0]
    bag = write_growing(tmp_path / 'in', sweeps, samples)
    values = {
        **VALUES,
        'sweep_timeout': 1.0,
        'run': {'source': 'bag', 'bag': str(bag)},
        'record': {'file': str(tmp_path / 'live')},
    }
    recorder = graph.add(Recorder(parameter_overrides=configured(values)))
    estimator = graph.add(EstimatorNode(parameter_overrides=configured(values)))
    graph.matched('pcc/tip', 'rigid/tip')
    player = graph.add(Player(parameter_overrides=configured(values)))
    graph.until(lambda: player.finished, 'the end')
    n_without = sum(1496.0 + 200.0 < t + 1 < 2504.0 for t in sweeps)
    graph.until(lambda: estimator.n_sweeps == len(sweeps) - n_without, 'all results')
    end = time.monotonic() + 1.0
    graph.until(lambda: time.monotonic() > end)
    assert player.failure is None
    graph.remove(recorder)
    c = validate(values)
    summary = replay(tmp_path / 'live', c, tmp_path / 'replayed')
    assert summary.sweeps == len(sweeps) - summary.without_lengths
    assert summary.without_lengths == n_without
    for topic in ('/pcc/tip', '/rigid/tip'):
        live, replayed = results_of(tmp_path / 'live', topic), results_of(tmp_path / 'replayed', topic)
        assert live == replayed
    with AnyReader([tmp_path / 'live']) as reader:
        [recorded] = [t.msgcount for name, t in reader.topics.items() if name == '/backbone_lengths']
    assert recorded == len(samples)


def test_a_loop_gives_lengths_to_each_round(graph, configured, tmp_path):
    bag = write_growing(tmp_path / 'in', np.arange(0.0, 2000.0, 40.0), np.arange(0.0, 2000.0, 40.0))
    values = {
        **VALUES,
        'run': {'source': 'bag', 'bag': str(bag), 'loop': True, 'rate': 2.0},
        'sweep_timeout': 1.0,
    }
    estimator = graph.add(EstimatorNode(parameter_overrides=configured(values)))
    player = graph.add(Player(parameter_overrides=configured(values)))
    graph.until(lambda: estimator.assembler.resets >= 3, 'the fourth round')
    assert player.failure is None
    lengths = estimator._lengths.sweeps
    assert estimator.n_sweeps >= 3 * 50
    assert sum(lengths.n_without.values()) <= 3, 'before the first sample of the first round'
    assert not any(track.dropped for track in lengths.tracks)
    assert not lengths.lags


def test_a_bag_without_lengths_is_refused_by_the_program(tmp_path):
    bag = write_growing(tmp_path / 'in', np.arange(0.0, 500.0, 10.0), [])
    c = validate({**VALUES, 'run': {'source': 'bag', 'bag': str(bag)}})
    file = tmp_path / 'c.yaml'
    file.write_text(files.dump(c))
    with node('player', tmp_path, '--ros-args', '--params-file', file) as player:
        assert failed_clearly(player, f'{bag}: no measured length in it, expected a topic /backbone_lengths')
