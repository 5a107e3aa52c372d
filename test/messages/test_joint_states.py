"""Joint states that ROS's own serialiser made, read back."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from sesa2.errors import Sesa2Error
from sesa2.messages.cdr import CdrLayout
from sesa2.messages.joint_states import JointStateLayout

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPE = 'sensor_msgs/msg/JointState'
STAMP_NS = 1_700_000_000_123_456_789


def names(n):
    """Of every length modulo eight."""
    return tuple(f'j{"o" * (i % 9)}{i}' for i in range(n))


@pytest.mark.parametrize('frame', ['', 'w', 'worl', 'base_link'])
@pytest.mark.parametrize('n', [0, 1, 2, 24])
def test_what_ros_serialises_is_read_back(frame, n):
    serialization = pytest.importorskip('rclpy.serialization', reason='ROS is not installed')
    from sensor_msgs.msg import JointState

    angles = np.random.default_rng(n).normal(size=n)
    message = JointState(name=list(names(n)), position=angles.tolist(), velocity=angles.tolist())
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(STAMP_NS, 10**9)
    data = bytes(serialization.serialize_message(message))
    layout = JointStateLayout.of(data)
    assert layout.names == names(n)
    stamp, got = layout.read(data)
    assert stamp == STAMP_NS
    np.testing.assert_array_equal(got, angles)


@pytest.mark.parametrize('frame', ['', 'w', 'worl', 'base_link'])
@pytest.mark.parametrize('n', [1, 3])
def test_what_is_big_endian_is_read_too(frame, n):
    """As rosbags serialises it; ROS on such a machine would."""
    types = STORE.types
    stamp = types['builtin_interfaces/msg/Time'](sec=STAMP_NS // 10**9, nanosec=STAMP_NS % 10**9)
    header = types['std_msgs/msg/Header'](stamp=stamp, frame_id=frame)
    values, none = np.arange(n) + 0.5, np.zeros(0)
    message = types[TYPE](header=header, name=list(names(n)), position=values, velocity=none, effort=none)
    data = bytes(STORE.serialize_cdr(message, TYPE, little_endian=False))
    layout = JointStateLayout.of(data)
    assert layout.names == names(n)
    stamp_ns, got = layout.read(data)
    assert stamp_ns == STAMP_NS
    np.testing.assert_array_equal(got, values)


def made(n, prefix=''):
    layout = CdrLayout().header('').strings(prefix + name for name in names(n)).uint32(n).doubles(n)
    return layout.uint32(0).uint32(0).template().make(np.array([STAMP_NS]), np.ones((1, n)))[0].tobytes()


def test_what_is_not_whole_or_of_others_is_refused():
    data = made(5)
    layout = JointStateLayout.of(data)
    for size in (0, 3, 12, 20, 40, len(data) - 12):
        with pytest.raises(Sesa2Error, match=r'bytes|plain CDR'):
            layout.read(data[:size])
    for size in (0, 3, 12, 20, 40):
        with pytest.raises(Sesa2Error, match=r'not whole|plain CDR'):
            JointStateLayout.of(data[:size])
    with pytest.raises(Sesa2Error, match='not of the joints before it'):
        layout.read(made(5, 'x'))
    with pytest.raises(Sesa2Error, match='plain CDR'):
        JointStateLayout.of(b'\0\3' + data[2:])
    unequal = CdrLayout().header('').strings(['a', 'b']).uint32(1).doubles(1).template()
    with pytest.raises(Sesa2Error, match='1 positions of 2 joints'):
        JointStateLayout.of(unequal.make(np.array([0]), np.ones((1, 1)))[0].tobytes())
