"""Magnetic fields beside raw IMUs: found by name, stamped, and in the replay's bag, which can be replayed again."""

from importlib.util import find_spec

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from sesa2.bags.reading import read_poses
from sesa2.bags.replay import replay
from sesa2.bags.writing import new_bag
from sesa2.configuration import validate
from sesa2.messages.field_messages import FIELD_TYPE, FieldMessages
from sesa2.messages.imu_messages import TYPE, ImuMessages

pytestmark = pytest.mark.skipif(find_spec('vqf') is None, reason='vqf is not installed (extra raw)')
S0 = 1_700_000_000 * 10**9
STEP = 10_000_000  # ns
TIMES = np.arange(600) * STEP / 1e9
IDS, LENGTH = (1, 2), 0.3
EARTH = np.array([0.0, 20e-6, -45e-6])  # T, y is north


def arm(**imus):
    return validate(
        {
            'arm': {'length': LENGTH},
            'imus': {'ids': list(IDS), 'positions': [0.15, 0.3], 'fusion': '9d', **imus},
            'markers': {'names': ['M'], 'positions': [LENGTH]},
            'models': ['pcc_exact'],
        }
    )


def bend(seconds):
    """rad, of the whole arm towards x."""
    return 0.8 * np.sin(1.1 * seconds)


def messages(stamped=True, field_stamped=True, data='/imu_{}/data', field='/imu_{}/mag', every=4):
    """Topic, type, time of recording, bytes; the IMUs are on an arc, and every fourth sample has a field."""
    made = []
    for share, imu in zip((0.5, 1.0), IDS, strict=True):
        q, ahead = (
            Rotation.from_rotvec(share * np.outer(bend(TIMES + dt), [0.0, 1.0, 0.0])) for dt in (0.0, 1e-4)
        )
        angular = (q.inv() * ahead).as_rotvec() / 1e-4
        stamps = S0 + np.arange(len(TIMES)) * STEP
        own = stamps if stamped else 0 * stamps
        imus = ImuMessages('imu').make_raw(own, angular, q.inv().apply([0.0, 0.0, 9.81]))
        own = own if field_stamped else 0 * stamps
        fields = FieldMessages('imu').make_fields(own, q.inv().apply(EARTH))
        for k, stamp in enumerate(stamps.tolist()):
            made.append((data.format(imu), TYPE, stamp, imus[k].tobytes()))
            if k % every == 0:
                made.append((field.format(imu), FIELD_TYPE, stamp, fields[k].tobytes()))
    return sorted(made, key=lambda message: message[2])


def written(path, made):
    with new_bag(path) as bag:
        numbers = {}
        for topic, kind, log_ns, data in made:
            if topic not in numbers:
                numbers[topic] = bag.add_topic(topic, kind)
            bag.write(numbers[topic], log_ns, data)
    return path


def in_ros1(path, made):
    new, old = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
    header = old.types['std_msgs/msg/Header']
    with Writer(path) as bag:
        connections = {}
        for topic, kind, log_ns, data in made:
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, typestore=old)
            message = new.deserialize_cdr(data, kind)
            message.header = header(0, message.header.stamp, message.header.frame_id)
            bag.write(connections[topic], log_ns, bytes(old.serialize_ros1(message, kind)))
    return path


def errors(out):
    """How far the tip is from that of the arc, m."""
    poses = read_poses(out, 'pcc_exact/markers')
    angle = bend(poses.times_s - S0 / 1e9)
    angle = np.where(np.abs(angle) < 1e-9, 1e-9, angle)
    tip = LENGTH / angle[:, None] * np.stack([1 - np.cos(angle), 0 * angle, np.sin(angle)], axis=-1)
    return np.linalg.norm(poses.positions[:, 0] - tip, axis=1)


def check(source, c, tmp_path):
    """It is fused rightly, and so is what comes out of it; the fields are in there as they were."""
    for name in ('once', 'again'):
        summary = replay(source, c, tmp_path / name)
        assert [w for w in summary.warnings if 'before the first magnetic field' not in w] == []
        assert np.median(errors(tmp_path / name)) < 3e-3
        assert sorted(n for topic, n in summary.messages.items() if topic.endswith('/mag')) == [150, 150]
        source = tmp_path / name
    return summary


def test_what_a_replay_writes_can_be_replayed(tmp_path):
    check(written(tmp_path / 'bag', messages()), arm(), tmp_path)


def test_a_bag_of_ros_1(tmp_path):
    check(in_ros1(tmp_path / 'a.bag', messages()), arm(), tmp_path)


@pytest.mark.parametrize('stamped', [True, False])
def test_fields_without_a_stamp_are_of_when_they_were_recorded(tmp_path, stamped):
    made = messages(stamped=stamped, field_stamped=False)
    summary = replay(written(tmp_path / 'bag', made), arm(), tmp_path / 'out')
    assert not any('without a magnetic field' in warning for warning in summary.warnings)
    assert np.median(errors(tmp_path / 'out')) < 3e-3


def test_the_field_is_beside_the_imu_whatever_that_is_called(tmp_path):
    made = messages(data='/left{}/imu/data_raw', field='/left{}/imu/mag')
    c = arm(topics=['/left1/imu/data_raw', '/left2/imu/data_raw'])
    summary = check(written(tmp_path / 'bag', made), c, tmp_path)
    assert '/left2/imu/mag' in summary.messages


def test_where_one_would_be_beside_several_ids_tell(tmp_path):
    made = messages(data='/imus/number_{}')
    c = arm(topics=['/imus/number_1', '/imus/number_2'])
    check(written(tmp_path / 'bag', made), c, tmp_path)


def test_without_fusion_no_field_is_written(tmp_path):
    q = np.tile([0.0, 0.0, 0.0, 1.0], (1, 1))
    also = [
        (
            f'/imu_{i}/data',
            TYPE,
            S0 + k * STEP,
            ImuMessages('imu').make_many(np.array([S0 + k * STEP]), q)[0].tobytes(),
        )
        for k in range(5)
        for i in IDS
    ]
    fields = [m for m in messages() if m[1] == FIELD_TYPE][:4]
    made = sorted(also + fields, key=lambda m: m[2])
    summary = replay(written(tmp_path / 'bag', made), arm(fusion='none'), tmp_path / 'out')
    assert not any(topic.endswith('/mag') for topic in summary.messages)
