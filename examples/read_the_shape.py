"""A node of one's own that reads the arm's shape: the place to begin a controller from.

    sesa2 run --config prototype3_8 --source sim       # in one terminal
    python examples/read_the_shape.py                  # in another

It needs nothing of sesa2: the shape is in messages of ROS. Stamps are those of the measurement, so that the age of what
is steered by is known; positions are metres in `base_link`, quaternions x y z w, angles rad.
"""

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import JointState


class ReadTheShape(Node):
    """Says once a second where the tip is, how much the arm bends, and how old that is."""

    def __init__(self):
        super().__init__('read_the_shape')
        self.tip = None
        self.bend = 0.0
        self.create_subscription(JointState, 'pcc/joint_states', self.take_joints, 10)
        self.create_subscription(PoseStamped, 'pcc/tip', self.take_tip, 10)
        self.create_timer(1.0, self.say)

    def take_joints(self, message):
        """Angles of the joints, link by link from the base: x, z, y each. The arm bends by those about x and y."""
        about_x, about_y = message.position[0::3], message.position[2::3]
        self.bend = sum((x * x + y * y) ** 0.5 for x, y in zip(about_x, about_y, strict=True))

    def take_tip(self, message):
        """Where the tip is, in base_link."""
        self.tip = message

    def say(self):
        """A line on the terminal."""
        if self.tip is None:
            self.get_logger().warning(
                'nothing on pcc/tip yet: does `sesa2 run` run, on the same ROS_DOMAIN_ID?'
            )
            return
        p, age = self.tip.pose.position, self.get_clock().now() - Time.from_msg(self.tip.header.stamp)
        self.get_logger().info(
            f'tip at {p.x:+.3f} {p.y:+.3f} {p.z:+.3f} m, bent by {self.bend:.2f} rad, '
            f'{1e-6 * age.nanoseconds:.1f} ms ago'
        )


def main():
    """Until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(ReadTheShape())
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
