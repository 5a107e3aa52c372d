"""The player on a real graph: a recording's IMUs as topics again."""

import time

import numpy as np
import pytest
from made_bags import T0, cut, stamps_of, write_bag
from processes import failed_clearly, node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu

from sesa2.bags.writing import new_bag
from sesa2.configuration import ConfigurationError, files, validate
from sesa2.errors import Sesa2Error
from sesa2.nodes.estimator import EstimatorNode
from sesa2.nodes.player import Player


def values(bag, **run):
    return {
        'run': {'source': 'bag', 'bag': str(bag), **run},
        'arm': {'length': 0.3},
        'imus': {'ids': [2, 5], 'positions': [0.1, 0.3]},
        'models': ['pcc'],
    }


@pytest.fixture
def play(graph, configured):
    """Starts the player."""
    return lambda bag, **run: graph.add(Player(parameter_overrides=configured(values(bag, **run))))


@pytest.fixture
def bag(tmp_path):
    """1.5 s of both IMUs."""
    return write_bag(tmp_path / 'bag', (2, 5), stamps_of(1.5))


def stamps(messages):
    return np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in messages])


# A fast player on a busy machine is ahead of its listener by more than the nodes' depth.
DEEP = QoSProfile(depth=10_000)


def heard_by(graph):
    """What two IMUs say from now on."""
    messages = {2: [], 5: []}
    for i in messages:
        graph.probe.create_subscription(Imu, f'imu_{i}/data', messages[i].append, DEEP)
    return messages


def test_all_is_played_with_its_own_stamps_and_then_it_ends(graph, play, bag):
    heard = heard_by(graph)
    began = time.monotonic()
    player = play(bag)
    graph.until(lambda: player.finished, 'the end')
    assert time.monotonic() - began > 1.49, 'no faster than it was measured'
    assert player.failure is None
    for place, i in enumerate((2, 5)):
        np.testing.assert_array_equal(stamps(heard[i]), stamps_of(1.5) + 500_000 * place)
        assert {m.header.frame_id for m in heard[i]} == {f'imu_{i}'}


@pytest.mark.parametrize('rate', [0.5, 2.0])
def test_the_rate_is_kept(graph, play, bag, rate):
    """Never faster than asked, and faster than at another rate where it was asked to be."""
    heard_by(graph)
    began = time.monotonic()
    player = play(bag, rate=rate)
    graph.until(lambda: player.n_played >= 200, 'two thirds')
    assert time.monotonic() - began > 0.99 / rate
    graph.until(lambda: player.finished, 'the end')


def test_a_high_rate_is_quick(graph, play, tmp_path):
    heard_by(graph)
    minute = write_bag(tmp_path / 'minute', (2, 5), stamps_of(60.0))
    began = time.monotonic()
    player = play(minute, rate=100.0)
    graph.until(lambda: player.finished, 'the end')
    assert player.n_played == 12_000
    assert time.monotonic() - began < 50.0


def test_it_starts_where_asked(graph, play, bag):
    heard = heard_by(graph)
    player = play(bag, rate=10.0, start=1.0)
    graph.until(lambda: player.finished, 'the end')
    np.testing.assert_array_equal(stamps(heard[2]), stamps_of(1.5)[100:])


def test_a_start_beyond_the_end_is_a_failure(graph, play, bag):
    heard_by(graph)
    player = play(bag, start=2.0)
    graph.until(lambda: player.finished, 'the end')
    assert str(player.failure) == f'{bag}: nothing to play after 2 s'


def test_a_loop_begins_anew_and_the_estimator_with_it(graph, play, configured, bag):
    estimator = graph.add(EstimatorNode(parameter_overrides=configured(values(bag))))
    heard = heard_by(graph)
    player = play(bag, rate=2.0, loop=True)
    graph.until(lambda: estimator.assembler.resets >= 2, 'the third round')
    assert not player.finished
    steps = np.diff(stamps(heard[2]))
    assert set(steps) == {10_000_000, T0 - stamps_of(1.5)[-1]}
    assert not estimator.assembler.dropped
    # Each round gives all its sweeps.
    assert estimator.n_sweeps >= 2 * 149


def test_a_recording_in_which_time_jumps_back_keeps_its_pace(graph, play, tmp_path):
    twice = np.concatenate([stamps_of(1.5), stamps_of(1.5)])
    heard = heard_by(graph)
    began = time.monotonic()
    player = play(write_bag(tmp_path / 'bag', (2, 5), twice), rate=2.0)
    graph.until(lambda: player.n_played == 600, 'the last sample')
    assert time.monotonic() - began > 2 * 1.49 / 2.0
    graph.until(lambda: player.finished, 'the end')
    np.testing.assert_array_equal(stamps(heard[2]), twice)


def test_the_clock_is_published_on_demand(graph, play, bag):
    clocks = []
    graph.probe.create_subscription(Clock, '/clock', clocks.append, 10)
    heard_by(graph)
    player = play(bag, rate=10.0)
    graph.until(lambda: player.finished, 'the end')
    assert player.n_played == 300
    assert not clocks
    graph.remove(player)
    player = play(bag, rate=2.0, clock=True)
    graph.until(lambda: player.finished and clocks, 'the end')
    times = np.array([c.clock.sec * 10**9 + c.clock.nanosec for c in clocks])
    assert (np.diff(times) > 0).all()
    assert T0 <= times[0] < times[-1] <= stamps_of(1.5)[-1] + 500_000
    assert np.isin(times, [*stamps_of(1.5), *stamps_of(1.5) + 500_000]).all()


def test_imus_that_the_configuration_does_not_have_are_warned_about(graph, play, tmp_path):
    logs = graph.listen_to_logs()
    heard_by(graph)
    player = play(write_bag(tmp_path / 'bag', (2, 7), stamps_of(0.1)))
    graph.until(lambda: [m for m in logs if 'IMU 7: 10 messages not used: not in imus.ids' in m.msg])
    graph.until(lambda: player.finished, 'the end')
    assert player.failure is None


def test_a_bag_cut_short_is_played_as_far_as_it_goes(graph, play, tmp_path):
    heard = heard_by(graph)
    logs = graph.listen_to_logs()
    player = play(cut(write_bag(tmp_path / 'bag', (2, 5), stamps_of(60.0)), 0.5), rate=100.0)
    graph.until(lambda: player.finished, 'the end')
    assert player.failure is None
    assert 500 < len(heard[2]) < 6000
    graph.until(lambda: [m for m in logs if 'is cut short' in m.msg], 'a warning')


def test_what_cannot_be_played_is_refused(graph, play, tmp_path):
    with pytest.raises(Sesa2Error, match='nothing: '):
        play(tmp_path / 'nothing')
    with pytest.raises(ConfigurationError, match=r'run\.bag: is empty'):
        play('')
    with new_bag(tmp_path / 'texts') as bag:
        bag.add_topic('/configuration', 'std_msgs/msg/String')
    with pytest.raises(Sesa2Error, match=r'expected topics imu_<id>/data .*; its topics: /configuration'):
        play(tmp_path / 'texts')
    (tmp_path / 'noise.mcap').write_bytes(bytes(range(256)))
    with pytest.raises(Sesa2Error, match=r'noise\.mcap'):
        play(tmp_path / 'noise.mcap')


def test_as_a_program_it_ends_by_itself_and_fails_clearly(tmp_path, bag):
    for name, path in (('good', bag), ('bad', tmp_path / 'nothing')):
        (tmp_path / f'{name}.yaml').write_text(files.dump(validate(values(path, rate=10.0))))
    arguments = ('--ros-args', '--params-file')
    with (
        node('player', tmp_path, *arguments, tmp_path / 'good.yaml') as good,
        node('player', tmp_path, *arguments, tmp_path / 'bad.yaml') as bad,
    ):
        assert good.ended() == 0, good.errors
        assert failed_clearly(bad, f'{tmp_path}/nothing: ')


def test_the_predecessors_bag_is_played(graph, configured, recordings):
    bag = recordings / 'sesa/freshly_recorded_data.bag'
    wanted = configured({'run': {'source': 'bag', 'bag': str(bag), 'rate': 4.0}, **authors()})
    estimator = graph.add(EstimatorNode(parameter_overrides=wanted))
    player = graph.add(Player(parameter_overrides=wanted))
    graph.until(lambda: player.finished, 'the end')
    assert player.failure is None
    assert set(estimator.received) == set(range(1, 9))
    # 16 s at a sweep of 28.7 ms; four of its samples jump, as an offline replay says too.
    assert estimator.n_sweeps > 500
    assert estimator.assembler.dropped == {'turned faster than the sensor can': 4}


def authors():
    return {
        'arm': {'length': 0.66},
        'imus': {'ids': list(range(1, 9)), 'positions': [0.0622 + 0.08 * k for k in range(8)]},
    }
