"""Bytes that ROS's own serialiser made, read back."""

import numpy as np
import pytest

from sesa2.errors import Sesa2Error
from sesa2.messages.cdr import CdrLayout
from sesa2.messages.poses import read_path, read_pose, read_pose_array

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
