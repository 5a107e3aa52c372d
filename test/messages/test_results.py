"""Our bytes against rosbags' own serialiser, which writes the same messages field by field."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from sesa2.configuration import files, validate
from sesa2.errors import Sesa2Error
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep
from sesa2.messages.imu_messages import ImuMessages, read_imu, without_acceleration
from sesa2.messages.results import ResultMessages, joint_names
from sesa2.shape.rotations import normalize

STORE = get_typestore(Stores.ROS2_JAZZY)
STAMPS = [1_700_000_000_123_456_789, 1_700_000_000_999_999_999]


@pytest.fixture(params=['', 'a', 'abcd'])
def made(request):
    """Results of two sweeps; names of different length shift every field that follows them."""
    values = {
        'arm': {'length': 0.3, 'base_orientation': [0.1, 0.2, 0.3, 0.927]},
        'imus': {'ids': [1, 2, 3], 'positions': [0.1, 0.2, 0.29]},
        'markers': {'names': ['M2', 'M1'], 'positions': [0.25, 0.12]},
        'models': ['rigid', 'pcc', 'pcc_exact', 'pcc_delta'],
        'links': 5,
    }
    values['arm']['output_frame'] = 'world' if request.param == 'a' else 'base'
    if request.param == '':
        del values['markers']
    configuration = validate(values)
    rng = np.random.default_rng(1)
    sweeps = [Sweep(t, normalize(rng.normal(size=(3, 4))), np.ones(3, bool), None) for t in STAMPS]
    estimator = Estimator(configuration)
    return configuration, estimator.estimate(sweeps), ResultMessages(configuration, estimator)


def check_bytes(row, type_name):
    """What rosbags reads out of our bytes, written by rosbags again, is our bytes."""
    message = STORE.deserialize_cdr(row, type_name)
    assert bytes(STORE.serialize_cdr(message, type_name)) == row
    return message


def stamp(header):
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def xyzw(q):
    return [q.x, q.y, q.z, q.w]


def test_every_topic_is_byte_for_byte_what_rosbags_writes(made):
    _, estimate, messages = made
    for topic in messages.topics:
        rows = messages.make(topic, estimate)
        assert len(rows) == 2
        for row in rows:
            check_bytes(row, topic.type)


def test_the_numbers_are_at_their_places(made):
    configuration, estimate, messages = made
    for topic in messages.topics:
        model, _, kind = topic.name.partition('/')
        result = estimate.models[model]
        for i, row in enumerate(messages.make(topic, estimate)):
            message = check_bytes(row, topic.type)
            if kind == 'joint_states':
                assert stamp(message.header) == STAMPS[i]
                n = result.joints.shape[1]
                assert message.name == [f'{model}_{k:03d}_{axis}' for k in range(1, n + 1) for axis in 'xzy']
                np.testing.assert_array_equal(message.position, result.joints[i].ravel())
                velocity = result.joint_velocities[i].ravel() if i else []
                np.testing.assert_array_equal(message.velocity, velocity)
                assert np.isfinite(message.velocity).all()
            elif kind == 'shape':
                assert {stamp(pose.header) for pose in message.poses} == {STAMPS[i]}
                assert {pose.header.frame_id for pose in message.poses} == {configuration.frame_id}
                got = [[p.pose.position.x, p.pose.position.y, p.pose.position.z] for p in message.poses]
                np.testing.assert_array_equal(got, result.ends[i])
                got = [xyzw(p.pose.orientation) for p in message.poses]
                np.testing.assert_array_equal(got, result.end_orientations[i])
            elif kind == 'markers':
                got = [[p.position.x, p.position.y, p.position.z] for p in message.poses]
                np.testing.assert_array_equal(np.reshape(got, (-1, 3)), result.markers[i])
                got = [xyzw(p.orientation) for p in message.poses]
                np.testing.assert_array_equal(np.reshape(got, (-1, 4)), result.marker_orientations[i])
            elif kind == 'coordinates':
                np.testing.assert_array_equal(message.position, result.coordinates[i])
            elif kind == 'tip':
                assert message.header.frame_id == configuration.frame_id
                np.testing.assert_array_equal(
                    [getattr(message.pose.position, c) for c in 'xyz'], result.ends[i, -1]
                )
                np.testing.assert_array_equal(xyzw(message.pose.orientation), result.end_orientations[i, -1])
            else:
                line, spheres = message.markers
                np.testing.assert_array_equal([[p.x, p.y, p.z] for p in line.points], result.ends[i])
                got = [[p.x, p.y, p.z] for p in spheres.points]
                np.testing.assert_array_equal(np.reshape(got, (-1, 3)), result.markers[i])
                assert (line.type, spheres.type) == (line.LINE_STRIP, spheres.SPHERE_LIST)
                for marker in (line, spheres):
                    assert (marker.action, marker.ns) == (marker.ADD, model)
                    assert stamp(marker.header) == STAMPS[i]
                    assert marker.header.frame_id == configuration.frame_id
                assert line.id != spheres.id
                assert line.scale.x == 0.025


def test_coordinates_are_a_joint_state_for_models_that_have_some(made):
    _, estimate, messages = made
    (topic,) = [t for t in messages.topics if t.name.endswith('/coordinates')]
    assert topic == ('pcc_delta/coordinates', 'sensor_msgs/msg/JointState')
    result = estimate.models['pcc_delta']
    for k, row in enumerate(messages.make(topic, estimate)):
        message = check_bytes(row, topic.type)
        assert stamp(message.header) == STAMPS[k]
        assert message.name[:4] == [
            'segment_1_bend_x',
            'segment_1_bend_y',
            'segment_1_length',
            'segment_2_bend_x',
        ]
        np.testing.assert_array_equal(message.position, result.coordinates[k])
        assert len(message.name) == len(message.position) == 12
    np.testing.assert_allclose(result.coordinates[:, 2::3], np.tile([0.1, 0.1, 0.09, 0.01], (2, 1)))


def test_a_measured_base_turns_by_joints_behind_the_arms():
    configuration = validate(
        {
            'arm': {'length': 0.3},
            'imus': {'ids': [1, 2], 'positions': [0.1, 0.3], 'base_id': 5},
            'models': ['rigid', 'spline'],
            'links': 4,
        }
    )
    rng = np.random.default_rng(2)
    bases = Rotation.random(2, random_state=3)
    sweeps = [
        Sweep(t, normalize(rng.normal(size=(2, 4))), np.ones(2, bool), q)
        for t, q in zip(STAMPS, bases.as_quat(), strict=True)
    ]
    estimator = Estimator(configuration)
    estimate, messages = estimator.estimate(sweeps), ResultMessages(configuration, estimator)
    for topic in messages.topics:
        model, _, kind = topic.name.partition('/')
        for i, row in enumerate(messages.make(topic, estimate)):
            message = check_bytes(row, topic.type)
            if kind == 'joint_states':
                joints = estimate.models[model].joints[i].ravel()
                assert message.name[:-3] == joint_names(model, len(joints) // 3)
                assert message.name[-3:] == ['base_x', 'base_z', 'base_y']
                np.testing.assert_array_equal(message.position[:-3], joints)
                np.testing.assert_allclose(message.position[-3:], bases[i].as_euler('XZY'), atol=1e-12)
                assert not len(message.effort)
                if i == 0:
                    assert not len(message.velocity)
                    continue
                turn = np.concatenate([joints, bases[1].as_euler('XZY')])
                turn -= np.concatenate([estimate.models[model].joints[0].ravel(), bases[0].as_euler('XZY')])
                turn = (turn + np.pi) % (2.0 * np.pi) - np.pi  # the short way
                seconds = 1e-9 * (STAMPS[1] - STAMPS[0])
                np.testing.assert_allclose(message.velocity, turn / seconds, atol=1e-12)


def test_imu_messages():
    orientation = normalize([0.1, -0.2, 0.3, 0.9])
    data = ImuMessages('imu_3').make(STAMPS[1], orientation)
    message = check_bytes(data, 'sensor_msgs/msg/Imu')
    assert message.header.frame_id == 'imu_3'
    assert message.angular_velocity_covariance[0] == message.linear_acceleration_covariance[0] == -1.0
    assert not message.orientation_covariance.any()
    sample = read_imu(data)
    assert sample.stamp_ns == STAMPS[1]
    np.testing.assert_array_equal(sample[1:], orientation)
    data = ImuMessages('x').make(STAMPS[0], orientation, np.array([1.0, 2.0, 9.8]))
    message = STORE.deserialize_cdr(data, 'sensor_msgs/msg/Imu')
    assert message.linear_acceleration.z == 9.8
    assert message.linear_acceleration_covariance[0] == 0.0
    assert without_acceleration(data) == ImuMessages('x').make(STAMPS[0], orientation)
    big = STORE.serialize_cdr(message, 'sensor_msgs/msg/Imu', little_endian=False)
    assert read_imu(bytes(big)) == read_imu(data)


@pytest.mark.parametrize('data', [b'', b'\0', b'\0\1\0\0abc', bytes(30)])
def test_a_cut_imu_message_is_refused(data):
    with pytest.raises(Sesa2Error, match='expected at least 316'):
        read_imu(data)


def test_shipped_configurations_give_messages():
    for name in ('prototype3_8', 'authors_recording', 'single_section'):
        configuration = files.load(files.find(name))
        assert ResultMessages(configuration, Estimator(configuration)).topics
