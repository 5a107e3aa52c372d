"""Bags of the ROS 1 predecessor, made here with rosbags' ROS 1 writer."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from sesa2.bags.reading import ImuRecording
from sesa2.bags.recording import open_recording
from sesa2.errors import Sesa2Error

STORE = get_typestore(Stores.ROS1_NOETIC)
STORE.register(
    get_types_from_msg(
        'std_msgs/Header header\nuint8 ID\nfloat32 w\nfloat32 x\nfloat32 y\nfloat32 z', 'sesa/msg/quat'
    )
)
QUAT, TEXT = 'sesa/msg/quat', 'std_msgs/msg/String'
HALVES = {3: (0.5, 0.5, 0.5, 0.5), 4: (0.5, -0.5, 0.5, 0.5), 6: (0.5, 0.5, -0.5, 0.5)}  # ID: w x y z


def write(path, sweeps, *, topic='/quat_meas', type_name=QUAT):
    header = STORE.types['std_msgs/msg/Header'](
        seq=0, stamp=STORE.types['builtin_interfaces/msg/Time'](sec=0, nanosec=0), frame_id=''
    )
    with Writer(path) as bag:
        connection = bag.add_connection(topic, type_name, typestore=STORE)
        for k in range(sweeps):
            for id_, wxyz in HALVES.items():
                message = {QUAT: STORE.types[QUAT](header, id_, *wxyz), TEXT: STORE.types[TEXT]('x')}
                data = STORE.serialize_ros1(message[type_name], type_name)
                bag.write(connection, 10**9 + 10_000_000 * k + id_, bytes(data))
    return path


def read(path, first_id=None):
    with open_recording(path, first_id) as recording:
        return list(ImuRecording(recording).samples()), recording.problems


def attempt(path):
    """What `read` gives, or the message of our error; any other error is let through."""
    try:
        return *read(path), None
    except Sesa2Error as error:
        return [], [], str(error)


def test_ids_begin_at_one_and_the_bags_time_is_the_stamp(tmp_path):
    samples, problems = read(write(tmp_path / 'old.bag', 2))
    assert problems == []
    assert [(s.id, s.stamp_ns) for s in samples] == [
        (id_ - 2, 10**9 + 10_000_000 * k + id_) for k in range(2) for id_ in HALVES
    ]
    np.testing.assert_array_equal(samples[1][2:6], (-0.5, 0.5, 0.5, 0.5))


def test_it_looks_like_one_of_our_own(tmp_path):
    with open_recording(write(tmp_path / 'old.bag', 2)) as recording:
        assert {n: t.count for n, t in recording.topics.items()} == {
            '/imu_1/data': 2,
            '/imu_2/data': 2,
            '/imu_4/data': 2,
        }
        (message, _) = recording.messages(['/imu_4/data'])
        assert message.type == 'sensor_msgs/msg/Imu'
        assert message.log_ns == 10**9 + 6


def test_a_given_first_id(tmp_path):
    path = write(tmp_path / 'old.bag', 5)
    assert {s.id for s in read(path, first_id=1)[0]} == {3, 4, 6}
    samples, problems = read(path, first_id=4)
    assert {s.id for s in samples} == {1, 3}
    assert len(problems) == 1
    assert '5 samples of IDs below the first ID 4' in problems[0]


def test_without_orientations(tmp_path):
    path = write(tmp_path / 'old.bag', 1, topic='/chatter', type_name=TEXT)
    with pytest.raises(Sesa2Error, match=r'no message of an IMU, expected .*; its topics: /chatter'):
        read(path)


def test_with_messages_of_another_type(tmp_path):
    path = write(tmp_path / 'old.bag', 1, type_name=TEXT)
    with pytest.raises(Sesa2Error, match='nothing readable'):
        open_recording(path)


@pytest.fixture(scope='module')
def old(tmp_path_factory):
    path = write(tmp_path_factory.mktemp('bags') / 'old.bag', 20)
    return path.read_bytes(), path


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_cut_or_damaged(old, data):
    whole, path = old
    content = bytearray(whole)
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content) - 1)) :]
    else:
        content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    samples, problems, error = attempt(path)
    if error:
        assert 'old.bag' in error
    else:
        assert problems or len(samples) == 60
