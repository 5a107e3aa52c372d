"""Results of a bag as arrays, against rosbags' own reading of each message."""

from collections import defaultdict

import numpy as np
import pytest
from rosbags.rosbag2 import Reader

import sesa2
from sesa2.bags.array_files import write_arrays
from sesa2.bags.definitions import STRING, string_message, typestore
from sesa2.bags.estimate_arrays import read_estimate
from sesa2.bags.recording import open_recording
from sesa2.bags.replay import replay
from sesa2.bags.writing import new_bag
from sesa2.configuration import files, validate
from sesa2.errors import Sesa2Error
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep
from sesa2.messages.results import ResultMessages
from sesa2.shape.rotations import normalize


@pytest.fixture
def estimate(bag, configuration, tmp_path):
    replay(bag, configuration, tmp_path / 'out')
    return tmp_path / 'out'


def rewritten(source, target, change):
    """The bag again, each message as `change(topic, index, data)` gives it: data, or None to leave it out."""
    seen = defaultdict(int)
    with open_recording(source) as recording, new_bag(target) as bag:
        topics = {name: bag.add_topic(name, topic.type) for name, topic in recording.topics.items()}
        for topic, _, log_ns, data in recording.messages():
            data = change(topic, seen[topic], data)
            seen[topic] += 1
            if data is not None:
                bag.write(topics[topic], log_ns, data)
    return target


def pose(p):
    return [p.position.x, p.position.y, p.position.z], [
        p.orientation.x,
        p.orientation.y,
        p.orientation.z,
        p.orientation.w,
    ]


def test_arrays_are_the_messages(estimate, configuration):
    got = sesa2.read_estimate(estimate)
    assert list(got.models) == ['rigid', 'pcc']
    assert got.configuration.markers == configuration.markers
    assert got.frame == 'base_link'
    assert got.problems == ()
    index, store = defaultdict(int), typestore()
    with Reader(estimate) as reader:
        for connection, _, data in reader.messages():
            name, _, kind = connection.topic.lstrip('/').partition('/')
            if name not in got.models:
                continue
            i, m = index[connection.topic], got.models[name]
            index[connection.topic] += 1
            if kind not in ('joint_states', 'markers', 'tip', 'shape'):
                continue
            message = store.deserialize_cdr(data, connection.msgtype)
            stamp = message.header.stamp
            assert got.stamps_ns[i] == stamp.sec * 10**9 + stamp.nanosec
            if kind == 'joint_states':
                assert list(m.joint_names) == message.name
                np.testing.assert_array_equal(m.joints[i], message.position)
                known = message.velocity if len(message.velocity) else np.full(len(message.name), np.nan)
                np.testing.assert_array_equal(m.joint_velocities[i], known)
                assert np.isfinite(known).all() == (i > 0)
            elif kind == 'tip':
                np.testing.assert_array_equal(m.tip[i], pose(message.pose)[0])
                np.testing.assert_array_equal(m.tip_orientation[i], pose(message.pose)[1])
            else:
                poses = message.poses if kind == 'markers' else [p.pose for p in message.poses]
                positions, orientations = zip(*map(pose, poses), strict=True)
                ours = (
                    (m.markers, m.marker_orientations)
                    if kind == 'markers'
                    else (m.backbone, m.backbone_orientations)
                )
                np.testing.assert_array_equal(ours[0][i], positions)
                np.testing.assert_array_equal(ours[1][i], orientations)
    assert set(index.values()) == {len(got.stamps_ns)}
    pcc = got.models['pcc']
    np.testing.assert_allclose(pcc.backbone_positions[[0, -1]], [0.0, 0.3])
    np.testing.assert_array_equal(pcc.backbone[:, -1], pcc.tip)
    np.testing.assert_allclose(np.diff(got.times_s), 0.01, atol=1e-6)


@pytest.mark.parametrize('base_id', [0, 4], ids=['fixed base', 'measured base'])
def test_lengths_of_links_stand_apart_from_angles(tmp_path, base_id):
    c = validate(
        {
            'arm': {'length': 0.3},
            'imus': {'ids': [1, 2], 'positions': [0.1, 0.3], 'base_id': base_id},
            'segments': {'lengths': [0.1, 0.2]},
            'lengths': {'names': ['a', 'b'], 'segments': [1, 2], 'starts': [1, 2]},
            'models': ['rigid', 'spline'],
            'links': 4,
        }
    )
    rng, estimator = np.random.default_rng(1), Estimator(c)
    lengths = rng.uniform(0.1, 0.2, (5, 2))
    q = normalize(rng.normal(size=(5, 3, 4)))
    sweeps = [
        Sweep(10**18 + k * 10**7, q[k, :2], np.ones(2, bool), q[k, 2] if base_id else None, lengths[k])
        for k in range(5)
    ]
    estimate, messages = estimator.estimate(sweeps), ResultMessages(c, estimator)
    with new_bag(tmp_path / 'grown') as bag:
        bag.write(bag.add_topic('configuration', STRING), 10**18, string_message(files.dump(c)))
        for topic in messages.topics:
            number = bag.add_topic(*topic)
            for stamp, data in zip(estimate.stamps_ns.tolist(), messages.make(topic, estimate), strict=True):
                bag.write(number, stamp, data)
    got = read_estimate(tmp_path / 'grown')
    assert got.problems == ()
    for name, m in got.models.items():
        result, n = estimate.models[name], estimator.models[name].n_links
        own = m.joints[:, : 3 * n].reshape(5, n, 3), m.joint_velocities[:, : 3 * n].reshape(5, n, 3)
        np.testing.assert_array_equal(own[0], result.joints[..., :3])
        np.testing.assert_array_equal(own[1], result.joint_velocities[..., :3])
        np.testing.assert_array_equal(m.link_lengths, result.joints[..., 3])
        np.testing.assert_array_equal(m.link_velocities, result.joint_velocities[..., 3])
        np.testing.assert_allclose(m.link_lengths.sum(axis=1), lengths.sum(axis=1))
        assert len(m.joint_names) == m.joints.shape[1] == 3 * n + (3 if base_id else 0)
        assert not any(joint.endswith('_l') for joint in m.joint_names)
    write_arrays(got, tmp_path / 'grown.npz')
    write_arrays(got, tmp_path / 'grown.csv')
    with np.load(tmp_path / 'grown.npz') as arrays:
        np.testing.assert_array_equal(arrays['rigid/link_lengths_m'], got.models['rigid'].link_lengths)
    head = (tmp_path / 'grown.csv').read_text().splitlines()[0].split(',')
    assert {'rigid/joint_states:rigid_002_l [m]', 'rigid/joint_states:rigid_002_l_velocity [m/s]'} <= set(
        head
    )
    assert ('spline/joint_states:base_z_velocity [rad/s]' in head) == bool(base_id)


def test_only_some_models(estimate):
    assert list(read_estimate(estimate, ['pcc']).models) == ['pcc']
    with pytest.raises(Sesa2Error, match='no model spline; there are rigid, pcc'):
        read_estimate(estimate, ['spline'])
    with pytest.raises(Sesa2Error, match='named twice'):
        read_estimate(estimate, ['pcc', 'pcc'])


def test_messages_that_are_missing_or_damaged_leave_nan_and_are_told(estimate, tmp_path):
    def change(topic, index, data):
        if topic == '/pcc/markers' and index in (3, 4):
            return None
        return data[:30] if topic == '/rigid/joint_states' and index == 7 else data

    got = read_estimate(rewritten(estimate, tmp_path / 'less', change))
    whole = read_estimate(estimate)
    np.testing.assert_array_equal(got.stamps_ns, whole.stamps_ns)
    assert np.isnan(got.models['pcc'].markers[3:5]).all()
    np.testing.assert_array_equal(got.models['pcc'].markers[5:], whole.models['pcc'].markers[5:])
    np.testing.assert_array_equal(got.models['pcc'].tip, whole.models['pcc'].tip)
    assert np.isnan(got.models['rigid'].joints[7]).all()
    n = len(whole.stamps_ns)
    assert got.problems == (
        '1 messages not used: damaged',
        f'rigid/joint_states: 1 of {n} instants have no message; NaN there',
        f'pcc/markers: 2 of {n} instants have no message; NaN there',
    )


def test_of_a_loop_the_first_round_counts(estimate, tmp_path):
    with open_recording(estimate) as recording, new_bag(tmp_path / 'looped') as bag:
        topics = {name: bag.add_topic(name, topic.type) for name, topic in recording.topics.items()}
        messages = list(recording.messages())
        for shift in (0, 10**13):
            for topic, _, log_ns, data in messages:
                bag.write(topics[topic], log_ns + shift, data)
    got, whole = read_estimate(tmp_path / 'looped'), read_estimate(estimate)
    np.testing.assert_array_equal(got.models['pcc'].tip, whole.models['pcc'].tip)
    assert any('of a loop the first round counts' in problem for problem in got.problems)


def test_an_arm_in_a_namespace(estimate, tmp_path):
    with open_recording(estimate) as recording, new_bag(tmp_path / 'named') as bag:
        topics = {name: bag.add_topic(f'/left{name}', topic.type) for name, topic in recording.topics.items()}
        for topic, _, log_ns, data in recording.messages():
            bag.write(topics[topic], log_ns, data)
    got = read_estimate(tmp_path / 'named')
    np.testing.assert_array_equal(got.models['pcc'].tip, read_estimate(estimate).models['pcc'].tip)


def test_what_is_no_estimate_is_refused(bag, estimate, configuration, tmp_path):
    with pytest.raises(Sesa2Error, match='has no topic configuration'):
        read_estimate(bag)
    with pytest.raises(Sesa2Error, match='no such file'):
        read_estimate(tmp_path / 'none')
    with new_bag(tmp_path / 'bare') as bare:
        bare.write(bare.add_topic('/configuration', STRING), 1, string_message(files.dump(configuration)))
    with pytest.raises(Sesa2Error, match=r'no results of rigid, expected topics /rigid/'):
        read_estimate(tmp_path / 'bare')
    other = (
        files.dump(configuration).replace('names: [M1, M2]', 'names: [M1]').replace('[0.15, 0.3]', '[0.15]')
    )
    changed = rewritten(
        estimate,
        tmp_path / 'other',
        lambda topic, _, data: string_message(other) if topic == '/configuration' else data,
    )
    with pytest.raises(Sesa2Error, match='rigid/markers has 14 numbers a message, expected 7'):
        read_estimate(changed)
