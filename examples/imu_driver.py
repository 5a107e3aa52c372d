"""A driver for another IMU: whoever publishes orientations on `imu_<id>/data` is heard with `--source external`.

    python examples/imu_driver.py 1 2 3 4 5 6 7 8                    # in one terminal: ids of the IMUs
    sesa2 run --config prototype3_8 --source external                # in another

What counts (REP-145): the raw orientation q_WS, x y z w, of the sensor against an earth frame with z up, not corrected
for how the sensor is mounted (that is `imus.mount_orientations`); the stamp of the measurement, not of the message;
`frame_id` `imu_<id>`; and −1 in front of a covariance whose quantity is not measured. A sample that fails is not
published at all.
"""

import math
import sys

import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu


def read_orientation(imu_id, seconds):
    """In place of a real sensor: a slow swing about x that grows along the arm; x y z w."""
    half = 0.05 * imu_id * math.sin(seconds)
    return math.sin(half), 0.0, 0.0, math.cos(half)


class ImuDriver(Node):
    """Publishes every IMU a hundred times a second."""

    def __init__(self, ids):
        super().__init__('imu_driver')
        self.publishers_of_imus = {
            i: self.create_publisher(Imu, f'imu_{i}/data', qos_profile_sensor_data) for i in ids
        }
        self.create_timer(0.01, self.measure)

    def measure(self):
        """Read each sensor, and say when that was."""
        for imu_id, publisher in self.publishers_of_imus.items():
            now = self.get_clock().now()
            x, y, z, w = read_orientation(imu_id, 1e-9 * now.nanoseconds)
            message = Imu()
            message.header.stamp = now.to_msg()
            message.header.frame_id = f'imu_{imu_id}'
            message.orientation.x, message.orientation.y = x, y
            message.orientation.z, message.orientation.w = z, w
            message.angular_velocity_covariance[0] = -1.0
            message.linear_acceleration_covariance[0] = -1.0
            publisher.publish(message)


def main():
    """Until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(ImuDriver([int(text) for text in sys.argv[1:] if text.isdigit()] or [1]))
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
