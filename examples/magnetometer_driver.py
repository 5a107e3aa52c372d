"""A driver of three-axis magnetometers: counts of chips on an I2C bus become `magnetometer_<id>/field`, in tesla.

    python examples/magnetometer_driver.py --bus 1 1 2 3             # ids; chips at 0x10, 0x11 … of /dev/i2c-1
    python examples/magnetometer_driver.py 1 2 3                     # without a bus: counts that are made up
    sesa2 run --config magnetic_1 --source external                  # in another terminal

The chip here answers with six bytes from register 0x01: x, y and z as 16 bits with a sign, the low byte first, 150 nT
a count. Most chips differ from this in the constants below only; get them from its data sheet, and mind the unit: 1
gauss is 1e-4 T. What counts in the messages: the field is in tesla, raw, in the chip's own axes (how it is mounted,
its gain and its offset are in the configuration); the stamp is that of the measurement; an axis that has not measured
is NaN, never 0. Of a chip that does not answer nothing is published.
"""

import argparse
import itertools
import math
import struct
import sys

import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import MagneticField

FIRST_ADDRESS = 0x10
REGISTER = 0x01
TESLA_PER_COUNT = 150e-9
# The chip says so of an axis whose converter has overflowed; and near its end it is not linear any more.
OVERFLOW, LARGEST = -32768, 32000
PERIOD_S = 0.025


def field_of(data):
    """Six bytes of the chip as x, y, z in tesla; NaN on axes that are saturated."""
    counts = struct.unpack('<3h', data)
    return [TESLA_PER_COUNT * n if n != OVERFLOW and abs(n) <= LARGEST else math.nan for n in counts]


def bus_reader(number):
    """What reads a chip on a bus, by its place."""
    from smbus2 import SMBus  # pip install smbus2

    bus = SMBus(number)
    return lambda place: bytes(bus.read_i2c_block_data(FIRST_ADDRESS + place, REGISTER, 6))


def made_reader():
    """In place of a bus: what `magnetic_1` reads, slightly bent; the x axis of the second chip overflows at times."""
    count = itertools.count()

    def read(place):
        seconds = 0.25 * PERIOD_S * next(count)
        z = round((-6.2e-4 + 2e-5 * math.sin(seconds + 2.1 * place)) / TESLA_PER_COUNT)
        x = OVERFLOW if place == 1 and int(4.0 * seconds) % 2 else 100
        return struct.pack('<3h', x, -50, z)

    return read


class MagnetometerDriver(Node):
    """Reads every chip forty times a second."""

    def __init__(self, ids, read):
        super().__init__('magnetometer_driver')
        self.read = read
        self.failed = 0
        self.publishers_of_fields = {
            i: self.create_publisher(MagneticField, f'magnetometer_{i}/field', qos_profile_sensor_data)
            for i in ids
        }
        self.create_timer(PERIOD_S, self.measure)

    def measure(self):
        """Read each chip, and say when that was."""
        for place, (i, publisher) in enumerate(self.publishers_of_fields.items()):
            stamp = self.get_clock().now().to_msg()
            try:
                x, y, z = field_of(self.read(place))
            except OSError as error:
                self.failed += 1
                self.get_logger().warning(
                    f'{self.failed} readings failed, the last of magnetometer {i}: {error}',
                    throttle_duration_sec=5.0,
                )
                continue
            message = MagneticField()
            message.header.stamp = stamp
            message.header.frame_id = f'magnetometer_{i}'
            message.magnetic_field.x, message.magnetic_field.y, message.magnetic_field.z = x, y, z
            publisher.publish(message)


def main():
    """Until Ctrl-C."""
    parser = argparse.ArgumentParser()
    parser.add_argument('ids', nargs='+', type=int)
    parser.add_argument('--bus', type=int, help='number of the I2C bus')
    options = parser.parse_args()
    try:
        read = made_reader() if options.bus is None else bus_reader(options.bus)
    except ImportError:
        print('error: smbus2 is not installed: pip install smbus2', file=sys.stderr)
        return 1
    except OSError as error:
        print(f'error: I2C bus {options.bus}: {error}', file=sys.stderr)
        return 1
    rclpy.init()
    try:
        rclpy.spin(MagnetometerDriver(options.ids, read))
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
