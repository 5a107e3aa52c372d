"""A driver for motors: `command` drives them, and the counts of their encoders become `backbone_lengths`.

    python examples/motor_driver.py b1 b2 b3                         # in one terminal: names of the backbones
    sesa2 run --config tri_backbone --source external                # in another, beside a driver of the IMUs

What counts in the messages: names are those of `controller.names`, in whichever order; lengths are in metres, of the
whole backbone; what comes back is what the encoders say, never what was commanded; its stamp is that of the reading. A
command that is not for these motors moves none of them. When commands end, the motors stay where they were sent: the
tip controller falls silent when it stops, or holds after a fault. `SimulatedMotors` is what your own take the place of.
"""

import argparse
import math

import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

HOME = 0.12  # m, of each backbone when the driver starts
SHORTEST, LONGEST = 0.05, 0.34  # m: what the racks allow
METRES_PER_COUNT = math.pi * 0.012 / 2048  # a pinion of 12 mm on an encoder of 2048 counts a turn
PERIOD = 0.01  # s
FASTEST = round(0.08 * PERIOD / METRES_PER_COUNT)  # counts in a period, at 0.08 m/s


class SimulatedMotors:
    """In place of real ones: each goes to its count as fast as it can."""

    def __init__(self, n):
        self.counts = [0] * n
        self.wanted = [0] * n

    def drive_to(self, counts):
        """What your motors' position control is told."""
        self.wanted = list(counts)

    def read(self):
        """What your encoders say; the simulated motors turn by a period."""
        steps = [max(-FASTEST, min(FASTEST, w - c)) for w, c in zip(self.wanted, self.counts, strict=True)]
        self.counts = [c + step for c, step in zip(self.counts, steps, strict=True)]
        return self.counts


class MotorDriver(Node):
    """Drives what is commanded, and says a hundred times a second where the motors are."""

    def __init__(self, names, motors):
        super().__init__('motor_driver')
        self.names, self.motors = names, motors
        self.refused = 0
        self.publisher = self.create_publisher(JointState, 'backbone_lengths', qos_profile_sensor_data)
        self.create_subscription(JointTrajectory, 'command', self.obey, 10)
        self.create_timer(PERIOD, self.measure)

    def obey(self, command):
        """Lengths by name, in a trajectory of one point."""
        names = list(command.joint_names)
        lengths = list(command.points[0].positions) if len(command.points) == 1 else []
        if (
            sorted(names) != sorted(self.names)
            or len(lengths) != len(names)
            or not all(SHORTEST <= length <= LONGEST for length in lengths)  # NaN is not between them either
        ):
            self.refused += 1
            self.get_logger().warning(
                f'{self.refused} commands refused, the last {names} {lengths}: expected a length of '
                f'{SHORTEST} to {LONGEST} m for each of {self.names}',
                throttle_duration_sec=5.0,
            )
            return
        by_name = dict(zip(names, lengths, strict=True))
        self.motors.drive_to([round((by_name[name] - HOME) / METRES_PER_COUNT) for name in self.names])

    def measure(self):
        """Read the encoders, and say when that was."""
        message = JointState(name=self.names)
        message.header.stamp = self.get_clock().now().to_msg()
        message.position = [HOME + METRES_PER_COUNT * count for count in self.motors.read()]
        self.publisher.publish(message)


def main():
    """Until Ctrl-C."""
    parser = argparse.ArgumentParser()
    parser.add_argument('names', nargs='+')
    options = parser.parse_args()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        rclpy.spin(MotorDriver(options.names, SimulatedMotors(len(options.names))))
    except KeyboardInterrupt:
        pass
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
