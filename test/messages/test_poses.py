"""Bytes that ROS's own serialiser made, read back."""

import numpy as np
import pytest

from sesa2.errors import Sesa2Error
from sesa2.messages.cdr import CdrLayout
from sesa2.messages.poses import read_path, read_pose, read_pose_array, read_pose_arrays

STAMP_NS = 1_700_000_000_123_456_789


def poses(n):
    return np.random.default_rng(n).normal(size=(n, 7))


def ros_pose(row, kind):
    pose = kind()
    pose.position.x, pose.position.y, pose.position.z = row[:3]
    o = pose.orientation
    o.x, o.y, o.z, o.w = row[3:]
    return pose


def stamp(header, frame):
    header.stamp.sec, header.stamp.nanosec = divmod(STAMP_NS, 10**9)
    header.frame_id = frame


# Names of every length modulo eight: alignment is what can go wrong.
@pytest.mark.parametrize('frame', ['', 'w', 'wo', 'wor', 'worl', 'world', 'world_', 'world_2', 'base_link'])
@pytest.mark.parametrize('n', [0, 1, 2, 65])
def test_what_ros_serialises_is_read_back(frame, n):
    serialization = pytest.importorskip('rclpy.serialization', reason='ROS is not installed')
    from geometry_msgs.msg import Pose, PoseArray, PoseStamped
    from nav_msgs.msg import Path

    array = PoseArray(poses=[ros_pose(row, Pose) for row in poses(n)])
    stamp(array.header, frame)
    path = Path(poses=[PoseStamped(pose=ros_pose(row, Pose)) for row in poses(n)])
    stamp(path.header, 'another frame')
    for pose in path.poses:
        stamp(pose.header, frame)
    for read, message in ((read_pose_array, array), (read_path, path)):
        got = read(bytes(serialization.serialize_message(message)))
        assert got.stamp_ns == STAMP_NS
        np.testing.assert_array_equal(got.poses, poses(n))
    if n == 1:
        path.poses[0].header.stamp = path.header.stamp
        got = read_pose(bytes(serialization.serialize_message(path.poses[0])))
        assert got.stamp_ns == STAMP_NS
        np.testing.assert_array_equal(got.poses, poses(1))


def made(n):
    layout = CdrLayout().header('base_link').uint32(n)
    for _ in range(n):
        layout.header('base_link').doubles(7)
    return layout.template().make(np.array([STAMP_NS]), poses(n).reshape(1, -1))[0].tobytes()


@pytest.mark.parametrize('size', [0, 3, 12, 20, 40, 100, 300])
def test_a_cut_message_is_refused(size):
    data = made(5)
    assert len(read_path(data).poses) == 5
    for read in (read_path, read_pose_array):
        with pytest.raises(Sesa2Error, match=r'bytes|little-endian'):
            read(data[:size])


def test_the_other_byte_order_is_refused():
    with pytest.raises(Sesa2Error, match='little-endian'):
        read_path(b'\x00\x00' + made(2)[2:])


@pytest.mark.parametrize('frame', ['', 'w', 'wo', 'wor', 'world'])
@pytest.mark.parametrize('n', [0, 1, 3])
def test_many_are_read_as_one_by_one(frame, n):
    layout = CdrLayout().header(frame).uint32(n).doubles(7 * n).template()
    stamps = STAMP_NS + 3_000_000_000 * np.arange(5)
    values = np.random.default_rng(0).normal(size=(5, 7 * n))
    data = [row.tobytes() for row in layout.make(stamps, values)]
    got, arrays = read_pose_arrays(data)
    np.testing.assert_array_equal(got, stamps)
    np.testing.assert_array_equal(arrays, [read_pose_array(one).poses for one in data])
    assert arrays.shape == (5, n, 7)
    # One of another frame, and so of another length.
    other = CdrLayout().header(f'{frame}1234567').uint32(n).doubles(7 * n).template()
    mixed = [*data, other.make(stamps[:1], values[:1])[0].tobytes()]
    np.testing.assert_array_equal(read_pose_arrays(mixed)[1], [read_pose_array(one).poses for one in mixed])


def test_many_of_which_one_is_cut_or_other():
    data = []
    for n in (2, 3):
        layout = CdrLayout().header('w').uint32(n).doubles(7 * n).template()
        data.append(layout.make(np.array([STAMP_NS]), np.ones((1, 7 * n)))[0].tobytes())
    with pytest.raises(ValueError, match='inhomogeneous'):
        read_pose_arrays(data)
    with pytest.raises(Sesa2Error):
        read_pose_arrays([data[0], data[0][:-9]])
    # Of the same length, and yet not alike: it says that it has more poses than it can hold.
    lying = bytearray(data[0])
    lying[20:24] = (9).to_bytes(4, 'little')
    with pytest.raises(Sesa2Error, match='9 poses'):
        read_pose_arrays([data[0], bytes(lying)])
