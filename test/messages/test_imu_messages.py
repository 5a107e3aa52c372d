"""sensor_msgs/Imu in bytes: one by one and many at once, against rosbags."""

import numpy as np
from rosbags.typesys import Stores, get_typestore

from sesa2.messages.imu_messages import TYPE, ImuMessages, read_imu, read_imus


def test_many_are_read_as_one_by_one_and_as_rosbags_does():
    rng = np.random.default_rng(0)
    store = get_typestore(Stores.ROS2_JAZZY)
    data, expected = [], []
    for k in range(300):
        q, stamp = rng.normal(size=4), int(rng.integers(-(2**31), 2**31)) * 10**9 + int(rng.integers(10**9))
        # Names of several lengths, of which some fall into the same size of a message.
        one = ImuMessages(['imu_1', 'imu_2', 'imu_10', '', 'a/long/frame'][k % 5]).make(stamp, q)
        if k % 7 == 0:
            one = bytes(store.serialize_cdr(store.deserialize_cdr(one, TYPE), TYPE, little_endian=False))
        data.append(one)
        expected.append((stamp, *q))
    data[50], data[51], data[52] = b'', data[51][:20], data[52][:3]
    stamps, q, readable = read_imus(data).stamps_ns, read_imus(data).orientations, read_imus(data).readable
    assert np.flatnonzero(~readable).tolist() == [50, 51, 52]
    for k in np.flatnonzero(readable).tolist():
        assert (stamps[k], *q[k]) == expected[k] == tuple(read_imu(data[k]))


def test_none_are_none():
    none = read_imus([])
    stamps, q, readable = none.stamps_ns, none.orientations, none.readable
    assert (stamps.shape, q.shape, readable.shape) == ((0,), (0, 4), (0,))
