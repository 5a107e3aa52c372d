"""Headers in CDR, against rosbags' serialisation in both byte orders."""

import struct

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from sesa2.errors import Sesa2Error
from sesa2.messages.header_bytes import read_header, read_stamp, with_stamp

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPE = 'geometry_msgs/msg/PointStamped'
STAMP_NS = 1_700_000_000_123_456_789


def message(frame, little_endian=True):
    types = STORE.types
    stamp = types['builtin_interfaces/msg/Time'](sec=STAMP_NS // 10**9, nanosec=STAMP_NS % 10**9)
    header = types['std_msgs/msg/Header'](stamp=stamp, frame_id=frame)
    point = types['geometry_msgs/msg/Point'](x=1.5, y=-2.5, z=3.5)
    data = STORE.serialize_cdr(types[TYPE](header=header, point=point), TYPE, little_endian=little_endian)
    return bytes(data)


@pytest.mark.parametrize('little_endian', [True, False])
@pytest.mark.parametrize('frame', ['', 'a', 'imu_1', 'imu_12', 'left_imu_1', 'world'])
def test_the_stamp_and_where_the_doubles_are(frame, little_endian):
    data = message(frame, little_endian)
    order, stamp_ns, at = read_header(data)
    assert stamp_ns == read_stamp(data) == STAMP_NS
    assert struct.unpack_from(f'{order}3d', data, at) == (1.5, -2.5, 3.5)


@pytest.mark.parametrize('little_endian', [True, False])
def test_another_stamp_changes_nothing_else(little_endian):
    changed = with_stamp(message('imu_3', little_endian), 5_000_000_007)
    assert read_stamp(changed) == 5_000_000_007
    got = STORE.deserialize_cdr(changed, TYPE)
    assert (got.header.stamp.sec, got.header.stamp.nanosec, got.header.frame_id) == (5, 7, 'imu_3')
    np.testing.assert_array_equal([got.point.x, got.point.y, got.point.z], [1.5, -2.5, 3.5])


@pytest.mark.parametrize('size', [0, 1, 4, 15])
def test_what_is_too_short_is_refused(size):
    with pytest.raises(Sesa2Error, match=f'a message of {size} bytes'):
        read_stamp(message('imu_1')[:size])
