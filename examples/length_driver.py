"""A driver for backbones: counts of their motors' encoders become `backbone_lengths`, which every model then uses.

    python examples/length_driver.py --port /dev/ttyUSB0 b1 b2 b3    # a microcontroller that sends a line of counts
    python examples/length_driver.py b1 b2 b3                        # without one: counts that are made up
    sesa2 run --config tri_backbone --source external                # in another terminal, beside a driver of the IMUs

The microcontroller sends lines such as `-120 4096 377`, a count for each backbone in the order of the names, at any
rate (100 a second is plenty). Its counters have 16 bits and run over; it starts with the arm at home, where counts are
whatever they are. What counts in the messages: the names are those of `lengths.names`; lengths are in metres, of the
whole backbone; the stamp is that of the measurement; a line that is damaged is not published at all.
"""

import argparse
import itertools
import math
import sys
import time

import rclpy
import serial
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

HOME = 0.12  # m, of each backbone when the driver starts
METRES_PER_COUNT = math.pi * 0.012 / 2048  # a pinion of 12 mm on an encoder of 2048 counts a turn
COUNTER = 1 << 16


class LengthDriver(Node):
    """Publishes a message for each line of counts."""

    def __init__(self, names):
        super().__init__('length_driver')
        self.names = names
        self.publisher = self.create_publisher(JointState, 'backbone_lengths', qos_profile_sensor_data)
        self.last = None
        self.travelled = [0] * len(names)
        self.damaged = 0

    def take(self, line):
        """A line of counts, as bytes."""
        stamp = self.get_clock().now().to_msg()
        try:
            counts = [int(word) for word in line.split()]
        except ValueError:
            counts = []
        if len(counts) != len(self.names):
            self.damaged += 1
            self.get_logger().warning(
                f'{self.damaged} lines damaged, the last {line!r}: expected {len(self.names)} integers',
                throttle_duration_sec=5.0,
            )
            return
        if self.last is not None:
            # The short way round: a counter that ran over has not jumped.
            half = COUNTER // 2
            steps = [(new - old + half) % COUNTER - half for new, old in zip(counts, self.last, strict=True)]
            self.travelled = [n + step for n, step in zip(self.travelled, steps, strict=True)]
        self.last = counts
        lengths = [HOME + METRES_PER_COUNT * n for n in self.travelled]
        message = JointState(name=self.names, position=lengths)
        message.header.stamp = stamp
        self.publisher.publish(message)


def lines_of(port):
    """Whole lines from a serial port, as they come; the first is thrown away, as it may have begun before."""
    with serial.Serial(port, 115200, timeout=0.5) as connection:
        connection.readline()
        line = b''
        while True:
            line += connection.readline()  # what there was when the timeout was over
            if line.endswith(b'\n'):
                yield line
                line = b''


def made_lines(n):
    """In place of real motors: slow waves, a hundred lines a second."""
    for k in itertools.count():
        time.sleep(0.01)
        counts = [
            round(1500 * (1.0 - math.cos(0.005 * k)) + 300 * math.sin(0.007 * k + 2 * i)) for i in range(n)
        ]
        yield ' '.join(str((count + COUNTER // 2) % COUNTER - COUNTER // 2) for count in counts).encode()


def main():
    """Until Ctrl-C, or until the port is gone."""
    parser = argparse.ArgumentParser()
    parser.add_argument('names', nargs='+')
    parser.add_argument('--port')
    options = parser.parse_args()
    rclpy.init(
        signal_handler_options=SignalHandlerOptions.NO
    )  # Ctrl-C between two lines, not within a message
    node = LengthDriver(options.names)
    lines = lines_of(options.port) if options.port else made_lines(len(options.names))
    try:
        for line in lines:
            node.take(line)
    except serial.SerialException as error:
        print(f'error: {options.port}: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        pass
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
