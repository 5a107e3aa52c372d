import os

import numpy as np
import pytest
from made_samples import START_NS, make_samples, write_samples
from rosbags.typesys import Stores, get_typestore

from sesa2.bags.definitions import STRING, string_message
from sesa2.bags.reading import ImuRecording, read_poses
from sesa2.bags.recording import open_recording
from sesa2.bags.writing import new_bag
from sesa2.errors import Sesa2Error

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
POSE_ARRAY = 'geometry_msgs/msg/PoseArray'


def test_samples(bag, samples):
    with open_recording(bag) as recording:
        imus = ImuRecording(recording)
        assert imus.namespace == '/'
        assert imus.counts == {1: 300, 2: 300, 3: 300}
        read = list(imus.samples())
    assert [s.stamp_ns for s in read] == [m.stamp_ns for m in samples]
    assert [f'/imu_{s.id}/data' for s in read] == [m.topic for m in samples]
    np.testing.assert_array_equal([s[2:6] for s in read], [m.orientation for m in samples])
    assert [s.data for s in read] == [m.data for m in samples]


@pytest.mark.parametrize('namespace', ['/arm/', '/lab/left_arm/'])
def test_a_namespace(tmp_path, namespace):
    with new_bag(tmp_path / 'in') as writer:
        write_samples(writer, make_samples(5, namespace=namespace))
        topic = writer.add_topic(f'{namespace}configuration', STRING)
        writer.write(topic, START_NS, string_message('arm: é'))
        elsewhere = writer.add_topic('/configuration', STRING)
        writer.write(elsewhere, START_NS, string_message('another'))
    with open_recording(tmp_path / 'in') as recording:
        imus = ImuRecording(recording)
        assert imus.namespace == namespace
        assert imus.configuration() == 'arm: é'
        assert len(list(imus.samples())) == 15


def test_the_imus_of_two_arms(tmp_path):
    with new_bag(tmp_path / 'in') as writer:
        write_samples(writer, make_samples(2, namespace='/left/'))
        write_samples(writer, make_samples(2, namespace='/right/'))
    with (
        open_recording(tmp_path / 'in') as recording,
        pytest.raises(Sesa2Error, match='namespaces /left/ and /right/, expected those of one arm'),
    ):
        ImuRecording(recording)


def test_no_imu_topic(tmp_path):
    with new_bag(tmp_path / 'in') as writer:
        writer.write(writer.add_topic('/imu/data', 'sensor_msgs/msg/Imu'), 1, b'')
        writer.write(writer.add_topic('/imu_1/data', STRING), 1, b'')
        writer.write(writer.add_topic('/ximu_1/data', 'sensor_msgs/msg/Imu'), 1, b'')
    with open_recording(tmp_path / 'in') as recording, pytest.raises(Sesa2Error) as raised:
        ImuRecording(recording)
    for expected in (
        'no message of an IMU',
        '/imu/data (sensor_msgs/msg/Imu, 1)',
        '/imu_1/data (std_msgs/msg/String, 1)',
    ):
        assert expected in str(raised.value)


def test_topics_without_a_message_do_not_count(tmp_path):
    with new_bag(tmp_path / 'in') as writer:
        writer.add_topic('/left/imu_1/data', 'sensor_msgs/msg/Imu')
        write_samples(writer, make_samples(2, namespace='/right/'))
    with open_recording(tmp_path / 'in') as recording:
        assert ImuRecording(recording).namespace == '/right/'


def test_no_topic_at_all(tmp_path):
    with new_bag(tmp_path / 'in'):
        pass
    with open_recording(tmp_path / 'in') as recording, pytest.raises(Sesa2Error, match='its topics: none'):
        ImuRecording(recording)


def test_damaged_messages_are_counted(tmp_path):
    made = make_samples(4)
    made[4] = made[4]._replace(data=made[4].data[:50])
    made[7] = made[7]._replace(data=b'')
    with new_bag(tmp_path / 'in') as writer:
        write_samples(writer, made)
    with open_recording(tmp_path / 'in') as recording:
        imus = ImuRecording(recording)
        assert len(list(imus.samples())) == 10
        assert imus.unreadable == {2: 2}


def test_no_configuration(bag):
    with open_recording(bag) as recording:
        assert ImuRecording(recording).configuration() is None


def pose_array(stamp_ns, points, frame='mocap'):
    time = TYPES['builtin_interfaces/msg/Time'](stamp_ns // 10**9, stamp_ns % 10**9)
    poses = [
        TYPES['geometry_msgs/msg/Pose'](
            TYPES['geometry_msgs/msg/Point'](*point),
            TYPES['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
        )
        for point in points
    ]
    message = TYPES[POSE_ARRAY](TYPES['std_msgs/msg/Header'](time, frame), poses)
    return bytes(STORE.serialize_cdr(message, POSE_ARRAY))


def write_poses(path, messages):
    with new_bag(path) as writer:
        topic = writer.add_topic('/mocap/markers', POSE_ARRAY)
        for log_ns, data in messages:
            writer.write(topic, log_ns, data)


@pytest.mark.parametrize('topic', ['/mocap/markers', 'mocap/markers'])
def test_poses(tmp_path, topic):
    positions = np.random.default_rng(0).normal(size=(5, 2, 3))
    stamps = [START_NS + 10_000_000 * k for k in range(5)]
    write_poses(
        tmp_path / 'in',
        [(t + 3, pose_array(t, p.tolist())) for t, p in zip(stamps, positions, strict=True)],
    )
    poses = read_poses(tmp_path / 'in', topic)
    np.testing.assert_array_equal(poses.positions, positions)
    np.testing.assert_allclose(poses.times_s, np.array(stamps) / 1e9, rtol=0, atol=1e-6)
    assert poses.frame == 'mocap'


def test_poses_without_stamps_are_at_the_time_of_recording(tmp_path):
    write_poses(tmp_path / 'in', [(2 * 10**9, pose_array(0, [])), (3 * 10**9, pose_array(0, []))])
    poses = read_poses(tmp_path / 'in', 'mocap/markers')
    np.testing.assert_array_equal(poses.times_s, [2.0, 3.0])
    assert poses.positions.shape == (2, 0, 3)


def test_what_is_no_topic_of_poses(tmp_path, bag):
    write_poses(tmp_path / 'poses', [(1, pose_array(1, []))])
    with pytest.raises(Sesa2Error, match='there is none; of this type are: /mocap/markers'):
        read_poses(tmp_path / 'poses', 'M1')
    with pytest.raises(Sesa2Error, match='it is of sensor_msgs/msg/Imu; of this type are: none'):
        read_poses(bag, '/imu_1/data')


def test_poses_that_do_not_fit_together(tmp_path):
    write_poses(tmp_path / 'in', [(1, pose_array(1, [(0.0, 0.0, 0.0)])), (2, pose_array(2, []))])
    with pytest.raises(Sesa2Error, match='message 1 of /mocap/markers has 0 poses, the first one 1'):
        read_poses(tmp_path / 'in', 'mocap/markers')
    write_poses(tmp_path / 'cut', [(1, pose_array(1, [(0.0, 0.0, 0.0)])[:-9])])
    with pytest.raises(Sesa2Error, match='message 0 of /mocap/markers is no geometry_msgs/msg/PoseArray'):
        read_poses(tmp_path / 'cut', 'mocap/markers')
    write_poses(tmp_path / 'none', [])
    with pytest.raises(Sesa2Error, match='no message on /mocap/markers'):
        read_poses(tmp_path / 'none', 'mocap/markers')


def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / 'pipe.mcap')
    with pytest.raises(Sesa2Error, match=r'pipe\.mcap: is a pipe, expected a file'):
        open_recording(tmp_path / 'pipe.mcap')
