import numpy as np
import pytest
from made_poses import Q, T, header, made, one_pose, point, pose, transform, write_topics
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from sesa2.bags.captured_bodies import read_bodies
from sesa2.bags.reading import ImuRecording
from sesa2.bags.recording import open_recording
from sesa2.errors import Sesa2Error


def odometry(stamp_ns, child, place):
    zeros = np.zeros(36)
    velocity = T['geometry_msgs/msg/Twist'](*[T['geometry_msgs/msg/Vector3'](0.0, 0.0, 0.0)] * 2)
    return made(
        'nav_msgs/msg/Odometry',
        header(stamp_ns, 'mocap'),
        child,
        T['geometry_msgs/msg/PoseWithCovariance'](one_pose(place), zeros),
        T['geometry_msgs/msg/TwistWithCovariance'](velocity, zeros),
    )


def tf(*transforms):
    return made('tf2_msgs/msg/TFMessage', list(transforms))


def check(body, *, orientation=True, frame='mocap'):
    np.testing.assert_allclose(body.times, [1.0, 1.01])
    np.testing.assert_allclose(body.positions, [[1, 2, 3], [2, 2, 3]])
    assert body.frame == frame
    if orientation:
        np.testing.assert_allclose(body.orientations, [Q, Q])
    else:
        assert body.orientations is None


@pytest.mark.parametrize('frame', ['mocap', 'm', ''])
def test_a_topic_a_body(tmp_path, frame):
    """Whatever the length of the names in a message."""

    def at(k):
        place, stamp = (1 + k, 2, 3), 1e9 + 1e7 * k
        covered = T['geometry_msgs/msg/PoseWithCovariance'](one_pose(place), np.zeros(36))
        return [
            ('/vrpn_mocap/M1/pose', k, pose(stamp, place, frame=frame)),
            ('/M2', k, point(stamp, place, frame=frame)),
            ('/qualisys/M3/odom', k, odometry(stamp, 'M3_body', place)),
            (
                '/M4/pose',
                k,
                made('geometry_msgs/msg/PoseWithCovarianceStamped', header(stamp, frame), covered),
            ),
            (
                '/arm/pose',
                k,
                made('geometry_msgs/msg/TransformStamped', *_parts(transform(stamp, 'M5', place, frame))),
            ),
        ]

    capture = read_bodies(write_topics(tmp_path / 'bag', at(0) + at(1), start=10**9))
    assert sorted(capture.bodies) == ['M1', 'M2', 'M3', 'M4', 'M5']
    for name, body in capture.bodies.items():
        check(body, orientation=name != 'M2', frame='mocap' if name == 'M3' else frame)


def _parts(stamped):
    return stamped.header, stamped.child_frame_id, stamped.transform


def test_names_that_are_not_unique_are_topics(tmp_path):
    messages = [(f'/{arm}/M1/pose', 0, pose(0, (1, 2, 3))) for arm in ('left', 'right')]
    assert sorted(read_bodies(write_topics(tmp_path / 'bag', messages)).bodies) == [
        '/left/M1/pose',
        '/right/M1/pose',
    ]


def test_tf(tmp_path):
    messages = [
        (
            '/tf',
            k,
            tf(
                transform(1e9 + 1e7 * k, 'M1', (1 + k, 2, 3)),
                transform(1e9 + 1e7 * k, 'rig/M22', (1 + k, 2, 3)),
            ),
        )
        for k in range(2)
    ]
    capture = read_bodies(write_topics(tmp_path / 'bag', messages, start=10**9))
    assert list(capture.bodies) == ['M1', 'rig/M22']
    for body in capture.bodies.values():
        check(body)


NAMED = """\
std_msgs/Header header
uint32 frame_number
lab_msgs/Body[] bodies
"""
BODY = 'string rigid_body_name\ngeometry_msgs/Pose pose\n'


def test_named_bodies_of_a_type_that_the_bag_explains(tmp_path):
    """As drivers have them; the type is in no release of ROS."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(NAMED, 'lab_msgs/msg/Bodies'))
    store.register(get_types_from_msg(BODY, 'lab_msgs/msg/Body'))
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection('/bodies', 'lab_msgs/msg/Bodies', typestore=store)
        for k in range(2):
            body = store.types['lab_msgs/msg/Body']
            bodies = [body('M1', one_pose((1 + k, 2, 3))), body('other', one_pose((0, 0, 0)))]
            message = store.types['lab_msgs/msg/Bodies'](header(1e9 + 1e7 * k, 'mocap'), 7, bodies)
            writer.write(connection, 10**9 + 10**7 * k, store.serialize_cdr(message, 'lab_msgs/msg/Bodies'))
    capture = read_bodies(tmp_path / 'bag')
    assert list(capture.bodies) == ['M1', 'other']
    check(capture.bodies['M1'])


def test_where_a_message_has_no_stamp_its_recording_has(tmp_path):
    messages = [('/M1', k, pose(0, (1, 2, 3))) for k in range(2)]
    bag = write_topics(tmp_path / 'bag', messages, start=10**9)
    np.testing.assert_allclose(read_bodies(bag).bodies['M1'].times, [1.0, 1.01])


def test_damaged_messages_are_counted(tmp_path):
    whole = pose(1e9, (1, 2, 3))
    messages = [
        ('/M1', 0, whole),
        ('/M1', 1, whole._replace(data=whole.data[:40])),
        ('/M1', 2, whole._replace(data=b'')),
    ]
    capture = read_bodies(write_topics(tmp_path / 'bag', messages))
    assert len(capture.bodies['M1'].times) == 1
    assert '2 messages not used: damaged' in capture.notes[0]


def test_no_such_topic(tmp_path):
    bag = write_topics(tmp_path / 'bag', [('/M1', 0, pose(0, (1, 2, 3)))])
    with pytest.raises(
        Sesa2Error, match=r'expected a topic /poses with poses of markers; its topics: /M1 \(geometry_msgs'
    ):
        read_bodies(bag, 'poses')


def test_bodies_called_as_imus_are_imus(tmp_path):
    messages = [(f'/mocap/imu_{i}/pose', k, pose(1e9 + 1e7 * k, (i, 2, 3))) for k in range(3) for i in (2, 4)]
    with open_recording(write_topics(tmp_path / 'bag', messages)) as recording:
        imus = ImuRecording(recording)
        assert imus.counts == {2: 3, 4: 3}
        samples = list(imus.samples())
    assert [s.id for s in samples] == [2, 4] * 3
    np.testing.assert_allclose([s[2:6] for s in samples], [Q] * 6)


def test_arrays_of_different_lengths_are_told(tmp_path):
    def of(*lengths):
        places = [(1, 2, 3), (4, 5, 6)]
        return [('/poses', k, pose(10**9 + k, *places[:n], array=True)) for k, n in enumerate(lengths)]

    assert read_bodies(write_topics(tmp_path / 'same', of(2, 2, 2))).notes == ()
    capture = read_bodies(write_topics(tmp_path / 'other', of(2, 1, 2)))
    assert [len(body.times) for body in capture.bodies.values()] == [3, 2]
    (note,) = capture.notes
    assert '/poses has 1 to 2 poses a message, and nothing says which are missing' in note
