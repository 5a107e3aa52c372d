"""Bags of ROS 1 other than the predecessor's, made here with rosbags' ROS 1 writer."""

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from sesa2.bags.captured_bodies import read_bodies
from sesa2.bags.reading import ImuRecording, read_poses
from sesa2.bags.recording import open_recording
from sesa2.bags.replay import replay
from sesa2.configuration import files
from sesa2.errors import Sesa2Error
from sesa2.evaluation.truth import read_truth

STORE = get_typestore(Stores.ROS1_NOETIC)
T = STORE.types
IMU = 'sensor_msgs/msg/Imu'
S0 = 1_700_000_000
IDS = (2, 4)


def header(stamp_ns, frame='imu'):
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    return T['std_msgs/msg/Header'](7, T['builtin_interfaces/msg/Time'](seconds, nanoseconds), frame)


def vector(x, y, z):
    return T['geometry_msgs/msg/Vector3'](x, y, z)


def pose(x, y, z):
    return T['geometry_msgs/msg/Pose'](
        T['geometry_msgs/msg/Point'](x, y, z), T['geometry_msgs/msg/Quaternion'](0.0, 0.6, 0.0, 0.8)
    )


def imu(stamp_ns, q, frame='imu'):
    nine = np.zeros(9)
    return T[IMU](
        header(stamp_ns, frame),
        T['geometry_msgs/msg/Quaternion'](*q),
        nine,
        vector(0.0, 0.0, 0.0),
        nine,
        vector(0.0, 0.0, 9.81),
        nine,
    )


def write(path, messages, store=STORE):
    """Messages are topic, type, time of recording, ns, and message."""
    with Writer(path) as bag:
        connections = {}
        for topic, kind, log_ns, message in messages:
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, typestore=store)
            bag.write(connections[topic], log_ns, bytes(store.serialize_ros1(message, kind)))
    return path


def quaternion(k, i):
    angle = 0.1 * i + 0.02 * k
    return 0.0, float(np.sin(angle)), 0.0, float(np.cos(angle))


def imus(n, *, name='/imu_{}/data', stamped=True, frame='imu'):
    return [
        (
            name.format(i),
            IMU,
            S0 * 10**9 + 10_000_000 * k + i,
            imu((S0 - 5) * 10**9 + 10_000_000 * k if stamped else 0, quaternion(k, i), frame),
        )
        for k in range(n)
        for i in IDS
    ]


@pytest.mark.parametrize('frame', ['', 'a', 'imu_link', 'a frame of odd length'])
def test_imus_come_as_they_were_recorded(tmp_path, frame):
    with open_recording(write(tmp_path / 'a.bag', imus(3, frame=frame))) as recording:
        found = ImuRecording(recording)
        samples = list(found.samples())
        assert recording.problems == found.stamps.problems == []
    assert [(s.id, s.stamp_ns, s.log_ns) for s in samples] == [
        (i, (S0 - 5) * 10**9 + 10_000_000 * k, S0 * 10**9 + 10_000_000 * k + i) for k in range(3) for i in IDS
    ]
    np.testing.assert_array_equal(
        [s[2:6] for s in samples], [quaternion(k, i) for k in range(3) for i in IDS]
    )


def test_without_stamps_the_time_of_recording_stands_in(tmp_path):
    with open_recording(write(tmp_path / 'a.bag', imus(3, stamped=False))) as recording:
        found = ImuRecording(recording)
        assert [s.stamp_ns for s in found.samples()] == [
            S0 * 10**9 + 10_000_000 * k + i for k in range(3) for i in IDS
        ]
        [problem] = found.stamps.problems
    assert problem == 'IMU 2, 4: 6 messages have no stamp (0); the time of their recording stands in'


def test_a_namespace_and_other_topics_do_no_harm(tmp_path):
    text = STORE.types['std_msgs/msg/String']
    messages = [('/rosout', 'std_msgs/msg/String', 1, text('x')), *imus(2, name='/arm/imu_{}/data')]
    with open_recording(write(tmp_path / 'a.bag', messages)) as recording:
        found = ImuRecording(recording)
        assert found.namespace == '/arm/'
        assert found.counts == {2: 2, 4: 2}
        assert len(list(recording.messages())) == 5


def test_a_type_of_ones_own_is_read_as_its_bag_defines_it(tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg('Header header\ntime at\nuint8 n', 'lab_msgs/msg/Tick'))
    tick = store.types['lab_msgs/msg/Tick'](header(5), T['builtin_interfaces/msg/Time'](1, 2), 3)
    path = write(tmp_path / 'a.bag', [('/tick', 'lab_msgs/msg/Tick', 9, tick)], store)
    with open_recording(path) as recording:
        [message] = recording.messages()
        own = get_typestore(Stores.ROS2_JAZZY)
        own.register(get_types_from_msg(recording.topics['/tick'].definition, 'lab_msgs/msg/Tick'))
        read = own.deserialize_cdr(message.data, 'lab_msgs/msg/Tick')
    assert (read.at.sec, read.at.nanosec, read.n, read.header.frame_id) == (1, 2, 3, 'imu')


def test_poses_are_a_truth(tmp_path):
    array = T['geometry_msgs/msg/PoseArray']
    messages = [
        (
            '/truth/markers',
            'geometry_msgs/msg/PoseArray',
            k + 1,
            array(header(10**9 * (k + 1), 'world'), [pose(0.1 * k, 0.0, 0.3), pose(0.2 * k, 0.0, 0.6)]),
        )
        for k in range(4)
    ]
    path = write(tmp_path / 'a.bag', messages)
    poses = read_poses(path, 'truth/markers')
    np.testing.assert_allclose(poses.positions[:, :, 0], np.outer(np.arange(4), [0.1, 0.2]), atol=1e-15)
    assert poses.frame == 'world'
    truth = read_truth(path, ['M1', 'M2'])
    np.testing.assert_array_equal(truth.trajectory.positions, poses.positions)


def test_transforms_of_tf_by_either_of_its_names(tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    for kind in ('tf/msg/tfMessage', 'tf2_msgs/msg/TFMessage'):
        store.register(get_types_from_msg('geometry_msgs/TransformStamped[] transforms', kind))
        transform = T['geometry_msgs/msg/TransformStamped'](
            header(10**9, 'world'),
            'M1',
            T['geometry_msgs/msg/Transform'](
                vector(1.0, 2.0, 3.0), T['geometry_msgs/msg/Quaternion'](0.0, 0.6, 0.0, 0.8)
            ),
        )
        path = tmp_path / f'{kind.split("/")[0]}.bag'
        write(path, [('/tf', kind, 5, store.types[kind]([transform]))], store)
        body = read_bodies(path).bodies['M1']
        np.testing.assert_array_equal(body.positions, [[1.0, 2.0, 3.0]])
        np.testing.assert_array_equal(body.orientations, [[0.0, 0.6, 0.0, 0.8]])


def test_a_first_id_is_for_the_predecessors_bags(tmp_path):
    with open_recording(write(tmp_path / 'a.bag', imus(1)), first_id=1) as recording:
        assert 'no bag of the predecessor' in recording.problems[0]


def test_a_bag_cut_short_is_an_error_with_its_cause(tmp_path):
    path = write(tmp_path / 'a.bag', imus(50))
    whole = path.read_bytes()
    for size in (0, 20, len(whole) // 2, len(whole) - 10):
        path.write_bytes(whole[:size])
        with pytest.raises(Sesa2Error, match=r'a\.bag: nothing readable'):
            open_recording(path)


def test_the_case(cases, tmp_path):
    """The trial's own estimate is the oracle: the bag is a piece of it."""
    summary = replay(
        cases / '05-ros1-bag/arm.bag',
        files.load(files.find('prototype3_4')),
        tmp_path / 'out',
        models=['pcc'],
    )
    assert summary.sweeps == 60
    assert summary.warnings == []
    whole = read_poses(cases / '00-common/est10', 'pcc/markers')
    piece = read_poses(tmp_path / 'out', 'pcc/markers')
    nearest = np.abs(whole.times_s - piece.times_s[:, None]).argmin(axis=1)
    np.testing.assert_allclose(whole.times_s[nearest], piece.times_s, atol=0.01)
    np.testing.assert_allclose(whole.positions[nearest], piece.positions, atol=2e-3)
    with pytest.raises(Sesa2Error, match='expected one with poses of markers') as error:
        read_truth(cases / '05-ros1-bag/arm.bag', ['M1', 'M2'])
    assert 'quat_meas' not in str(error.value)
