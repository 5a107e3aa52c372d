"""The recorder: what is on the graph is in the bag, whatever ends it; and a replay of it gives what live gave."""

import resource
import signal
import time

import numpy as np
import pytest
from processes import command, failed_clearly, node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu
from sesa2_msgs.msg import ImuCalibration
from virtual_arms import arm_of

from sesa2.bags.definitions import STRING, typestore
from sesa2.bags.reading import ImuRecording
from sesa2.bags.recording import open_recording
from sesa2.bags.replay import replay
from sesa2.configuration import ConfigurationError, files, validate
from sesa2.errors import Sesa2Error
from sesa2.messages.imu_messages import ImuMessages
from sesa2.nodes.estimator import EstimatorNode
from sesa2.nodes.recorder import Recorder
from sesa2.nodes.serial_bridge import SerialBridge
from sesa2.ros.qos import LATCHED, STREAM

KINDS = ('joint_states', 'markers', 'tip', 'shape')
TOPICS = [f'{model}/{kind}' for model in ('rigid', 'pcc_delta') for kind in KINDS] + ['pcc_delta/coordinates']


def values(bag, port='', models=('rigid', 'pcc_delta'), **record):
    return {
        'arm': {'length': 0.3, 'base_orientation': [0.6, 0.0, 0.0, 0.8]},
        'imus': {'ids': [2, 3, 5], 'positions': [0.1, 0.2, 0.3], 'headings': [0.5, -1.0, 2.0]},
        'markers': {'names': ['A'], 'positions': [0.15]},
        'models': list(models),
        'links': 8,
        'serial': {'port': port},
        'record': {'file': str(bag), **record},
        # On a busy machine the clock may find a sweep overdue that has but to be taken from the queue.
        'sweep_timeout': 0.5,
    }


@pytest.fixture
def live(graph, configured, boards):
    """Starts recorder, estimator and bridge on a board with a moving arm; the board's port and the nodes."""

    def start(bag, **record):
        board = boards(arm_of(validate(values(bag))), calibration_s=1.0)
        overrides = configured(values(bag, board.path, **record))
        recorder = graph.add(Recorder(parameter_overrides=overrides))
        estimator = graph.add(EstimatorNode(parameter_overrides=overrides))
        if record.get('results', True):
            graph.matched(*TOPICS)
        bridge = graph.add(SerialBridge(parameter_overrides=overrides))
        return recorder, estimator, bridge

    return start


def test_raw_measurements_are_recorded_whole(graph, configured, boards, tmp_path):
    """Acceleration, which is left out beside orientations, is half of them."""
    given = values(tmp_path / 'raw')
    board = boards(arm_of(validate(given)))
    given['serial'], given['imus']['fusion'] = {'port': board.path, 'fusion': 'RAW'}, '9d'
    recorder = graph.add(Recorder(parameter_overrides=configured(given)))
    graph.add(SerialBridge(parameter_overrides=configured(given)))
    graph.until(lambda: recorder.n_messages > 100, 'messages')
    recorder.close()
    types = {'imu_3/data': 'sensor_msgs/msg/Imu', 'imu_3/mag': 'sensor_msgs/msg/MagneticField'}
    found = messages_by_topic(recorder.path)
    for name, kind in types.items():
        [topic] = [topic for topic in found if topic.endswith(name)]
        message = typestore().deserialize_cdr(found[topic][-1].data, kind)
        if kind.endswith('Imu'):
            a = message.linear_acceleration
            assert np.linalg.norm([a.x, a.y, a.z]) > 9.0
            assert message.linear_acceleration_covariance[0] == 0.0
        else:
            assert abs(message.magnetic_field.z) > 1e-7


def messages_by_topic(bag):
    """All messages of a bag, in order."""
    found = {}
    with open_recording(bag) as recording:
        for message in recording.messages():
            found.setdefault(message.topic, []).append(message)
    return found


def stamp_ns(message):
    """Stamp of the header, with which all but texts begin."""
    seconds, nanoseconds = np.frombuffer(message.data[4:12], np.uint32).tolist()
    return seconds * 10**9 + nanoseconds


def test_what_a_queue_could_not_hold_is_told(graph, configured, tmp_path):
    """2000 messages come while nothing is taken from the queue, which holds 1000."""
    recorder = graph.add(Recorder(parameter_overrides=configured(values(tmp_path / 'bag', results=False))))
    diagnosis = graph.diagnosis()
    logs = graph.listen_to_logs()
    publisher = graph.probe.create_publisher(Imu, 'imu_3/data', QoSProfile(depth=3000))
    graph.matched('imu_3/data')
    messages = ImuMessages('imu_3')
    data = [messages.make(10**18 + 10**7 * k, np.array([0.0, 0.0, 0.0, 1.0])) for k in range(2101)]
    for k in range(100):
        publisher.publish(data[k])
        graph.until(lambda k=k: recorder.n_messages > k, 'it is recorded')
    for message in data[100:]:
        publisher.publish(message)
    graph.until(lambda: recorder.lack, 'a gap')
    graph.until(lambda: recorder.n_messages > 1000, 'what was left')
    said = 'missing by the stamps: imu_3/data'
    graph.until(lambda: (d := diagnosis.latest('recorder: bag')) and said in d[1], 'a warning')
    n = recorder.n_messages
    graph.remove(recorder)
    [line] = [line.msg for line in logs if 'missing by the stamps' in line.msg]
    assert int(line.rpartition(' ')[2]) == 2101 - (n - 1)  # the configuration is one of its messages


# A whole bag


def test_the_bag_holds_what_was_on_the_graph_and_explains_itself(graph, live, tmp_path):
    recorder, estimator, bridge = live(tmp_path / 'bag')
    graph.until(lambda: estimator.n_sweeps >= 100, 'a second')
    graph.remove(bridge)
    graph.remove(estimator)
    graph.until(lambda: not recorder_is_behind(recorder, estimator), 'the recorder has all')
    c = recorder.configuration
    assert recorder.path == tmp_path / 'bag'
    graph.remove(recorder)
    n = recorder.n_messages
    with open_recording(tmp_path / 'bag') as recording:
        assert not recording.problems
        first = next(recording.messages())
        assert (first.topic, first.type) == ('/configuration', STRING)
        text = typestore().deserialize_cdr(first.data, STRING).data
        assert files.parse(text, 'bag') == c
        assert sum(topic.count for topic in recording.topics.values()) == n
        expected = {f'/{topic}' for topic in TOPICS}
        expected |= {f'/imu_{i}/{topic}' for i in (2, 3, 5) for topic in ('data', 'calibration')}
        assert set(recording.topics) == expected | {'/configuration'}
        assert all(recording.topics[name].count for name in expected)
        assert recording.topics['/configuration'].latched
        assert recording.topics['/imu_2/calibration'].latched
        assert recording.topics['/rigid/tip'].count == estimator.n_sweeps


@pytest.mark.parametrize('part', ['imu', 'results'])
def test_what_is_not_wanted_is_not_recorded(graph, live, tmp_path, part):
    recorder, _, _ = live(tmp_path / 'bag', **{part: False})
    graph.until(lambda: recorder.n_messages >= 50, 'messages')
    graph.close()
    topics = set(messages_by_topic(tmp_path / 'bag'))
    assert ('/imu_2/data' in topics) == (part != 'imu')
    assert ('/rigid/tip' in topics) == (part != 'results')


def test_a_name_that_is_taken_gets_a_number(graph, configured, tmp_path):
    for expected in ('bag', 'bag_2', 'bag_3'):
        recorder = graph.add(Recorder(parameter_overrides=configured(values(tmp_path / 'bag'))))
        assert recorder.path == tmp_path / expected
        graph.remove(recorder)
        assert list(messages_by_topic(recorder.path)) == ['/configuration']


def test_what_cannot_be_written_is_refused(graph, configured, tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(Sesa2Error, match=r'file/bag: cannot be written: .*file is a file, expected a folder'):
        Recorder(parameter_overrides=configured(values(tmp_path / 'file/bag')))
    with pytest.raises(ConfigurationError, match=r'record\.file: is empty'):
        Recorder(parameter_overrides=configured(values('')))


# Replay


def test_a_replay_gives_what_live_gave(graph, live, tmp_path):
    recorder, estimator, bridge = live(tmp_path / 'bag')
    graph.until(lambda: estimator.n_sweeps >= 150, '1.5 s')
    c = recorder.configuration
    graph.remove(bridge)
    graph.remove(estimator)
    graph.until(lambda: not recorder_is_behind(recorder, estimator), 'the recorder has all')
    graph.remove(recorder)
    summary = replay(tmp_path / 'bag', c, tmp_path / 'again')
    assert not summary.problems
    assert not summary.dropped
    live_bag, offline = messages_by_topic(tmp_path / 'bag'), messages_by_topic(tmp_path / 'again')
    for i in (2, 3, 5):
        assert [m.data for m in offline[f'/imu_{i}/data']] == [m.data for m in live_bag[f'/imu_{i}/data']]
    for topic in TOPICS:
        given = {stamp_ns(m): m.data for m in live_bag[f'/{topic}']}
        replayed = {stamp_ns(m): m.data for m in offline[f'/{topic}']}
        # Just after discovery the two may hear another first sample of each IMU; and the end of the recording
        # closes a sweep that live was still waiting for.
        settled = sorted(given)[20:]
        assert len(settled) > 100
        assert settled == [s for s in sorted(replayed) if settled[0] <= s <= settled[-1]]
        differing = [s for s in settled if not same_numbers(given[s], replayed[s])]
        assert not differing, f'{topic}: {len(differing)} of {len(settled)}'


def recorder_is_behind(recorder, estimator):
    counts, channels = recorder._bag.counts, recorder._bag._channels
    return any(
        counts[n] < estimator.n_sweeps
        for n, c in channels.items()
        if c.name.endswith((*KINDS, 'coordinates'))
    )


def same_numbers(one, other):
    """Equal but for rounding: numpy's order of operations differs between one sweep and many."""
    if len(one) != len(other):
        return False
    if one == other:
        return True
    n = (len(one) - 4) // 8
    a, b = (np.frombuffer(data, np.float64, count=n, offset=4) for data in (one, other))
    return np.allclose(a, b, rtol=0, atol=1e-12, equal_nan=True)


# Ends that are none


def write_configuration(folder, **options):
    file = folder / 'arm.yaml'
    file.write_text(files.dump(validate(values(folder / 'bag', **options))))
    return file


def test_after_a_kill_all_but_the_last_second_is_replayed(graph, configured, boards, tmp_path):
    config = write_configuration(tmp_path)
    board = boards(arm_of(validate(values(''))))
    times = []
    with node('recorder', tmp_path, '--ros-args', '--params-file', config) as recorder:
        graph.probe.create_subscription(
            Imu,
            'imu_5/data',
            lambda m: times.append(m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec),
            STREAM,
        )
        bridge = graph.add(SerialBridge(parameter_overrides=configured(values('', board.path))))
        graph.until(lambda: bridge._data_publishers[5].get_subscription_count() == 2, 'the recorder')
        began = time.time()
        graph.until(lambda: times and times[-1] > began + 3.0, 'three seconds')
        recorder.signal(signal.SIGKILL)
        killed = time.time()
        recorder.ended()
    with command(
        tmp_path, 'replay', tmp_path / 'bag', '--config', config, '--out', tmp_path / 'again'
    ) as replayed:
        assert replayed.ended() == 0, replayed.errors
    assert 'warning: ' in replayed.errors
    assert 'bag_0.mcap' in replayed.errors
    assert 'messages over' in replayed.errors, 'it says what was read'
    stamps = [stamp_ns(m) / 1e9 for m in messages_by_topic(tmp_path / 'again')['/imu_5/data']]
    assert stamps[-1] > killed - 1.0
    # Without a hole before.
    assert np.diff(stamps).max() < 0.5
    assert messages_by_topic(tmp_path / 'again')['/pcc_delta/tip']


class Source:
    """Speaks as IMU 2 whenever asked."""

    def __init__(self, graph):
        self._publisher = graph.probe.create_publisher(Imu, 'imu_2/data', STREAM)
        graph.until(self._publisher.get_subscription_count, 'the recorder')
        self._messages = ImuMessages('imu_2')
        self._rng = np.random.default_rng(0)

    def say(self, n):
        for _ in range(n):
            # Of random numbers, so that nothing is gained by compression.
            self._publisher.publish(self._messages.make(time.time_ns(), self._rng.normal(size=4)))


def test_a_full_disk_ends_the_recorder_clearly_and_what_was_written_stays(graph, tmp_path):
    limit = 100_000

    def small_disk():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    config = write_configuration(tmp_path)
    arguments = ('--ros-args', '--params-file', config)
    with node('recorder', tmp_path, *arguments, preexec_fn=small_disk) as recorder:
        source = Source(graph)

        def more():
            source.say(20)
            return not recorder.running

        graph.until(more, 'the end of the recorder')
        assert failed_clearly(recorder, f'{tmp_path}/bag/bag_0.mcap: cannot be written: File too large')
    assert (tmp_path / 'bag/bag_0.mcap').stat().st_size <= limit
    with open_recording(tmp_path / 'bag') as recording:
        imus = ImuRecording(recording)
        assert len(list(imus.samples())) > 50
        assert imus.configuration() == config.read_text()
        assert recording.problems


def test_the_recorder_hears_what_was_said_before_it_and_every_message_at_once(
    graph, configured, tmp_path, boards
):
    """Scores are latched, and of several that come at once none is lost."""
    recorder = graph.add(Recorder(parameter_overrides=configured(values(tmp_path / 'bag'))))
    publisher = graph.probe.create_publisher(ImuCalibration, 'imu_2/calibration', LATCHED)
    graph.matched('imu_2/calibration')
    for score in range(4):
        publisher.publish(ImuCalibration(id=2, sys=score))
    graph.until(lambda: recorder.n_messages == 5, 'all four and the configuration')
    graph.remove(recorder)
    late = graph.add(Recorder(parameter_overrides=configured(values(tmp_path / 'late'))))
    graph.until(lambda: late.n_messages == 2, 'the last of them')
