import numpy as np
from rosbags.typesys import Stores, get_typestore

from sesa2.messages.imu_messages import ImuMessages
from sesa2.messages.magnetic_messages import MAGNETIC_FIELD, MagneticMessages

STORE = get_typestore(Stores.ROS2_JAZZY)
STAMP = 12_345_678_901


def test_a_magnetic_field_as_another_library_reads_it():
    data = MagneticMessages('imu_3').make(STAMP, np.array([1e-6, -2e-6, 3e-6]))
    message = STORE.deserialize_cdr(data, MAGNETIC_FIELD)
    assert STORE.serialize_cdr(message, MAGNETIC_FIELD) == data
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 345_678_901)
    assert message.header.frame_id == 'imu_3'
    b = message.magnetic_field
    assert (b.x, b.y, b.z) == (1e-6, -2e-6, 3e-6)
    assert not message.magnetic_field_covariance.any()


def test_raw_measurements_as_another_library_reads_them():
    data = ImuMessages('imu_3').make_raw(STAMP, np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 9.0]))
    message = STORE.deserialize_cdr(data, 'sensor_msgs/msg/Imu')
    assert STORE.serialize_cdr(message, 'sensor_msgs/msg/Imu') == data
    w, a = message.angular_velocity, message.linear_acceleration
    assert (w.x, w.y, w.z, a.x, a.y, a.z) == (0.1, 0.2, 0.3, 1.0, 2.0, 9.0)
    assert message.orientation_covariance[0] == -1.0
    assert message.angular_velocity_covariance[0] == message.linear_acceleration_covariance[0] == 0.0
