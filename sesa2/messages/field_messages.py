"""sensor_msgs/MagneticField as bytes: what a magnetometer beside a raw IMU says."""

import struct

import numpy as np

from sesa2.errors import Sesa2Error
from sesa2.messages.cdr import CdrLayout
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

FIELD_TYPE = 'sensor_msgs/msg/MagneticField'


def read_field(data: bytes) -> tuple[int, FloatArray]:
    """Read stamp, ns, and magnetic field, (3,), T, in the sensor's axes.

    Parameters
    ----------
    data
        the serialised message, either byte order.

    Raises
    ------
    Sesa2Error
        it is too short to be one.
    """
    try:
        order = '<' if data[1] & 1 else '>'
        seconds, nanoseconds, length = struct.unpack_from(f'{order}iII', data, 4)
        at = 4 + (12 + length + 7) // 8 * 8
        return seconds * NS + nanoseconds, np.array(struct.unpack_from(f'{order}3d', data, at))
    except (IndexError, struct.error):
        raise Sesa2Error(f'a {FIELD_TYPE} message of {len(data)} bytes, expected at least 112') from None


class FieldMessages:
    """Makes the messages of one magnetometer; covariance unknown."""

    def __init__(self, frame_id: str):
        self._template = CdrLayout().header(frame_id).doubles(3).constants(*[0.0] * 9).template()

    def make_fields(self, stamps_ns: np.ndarray, fields: FloatArray) -> np.ndarray:
        """Messages at stamps (n,), ns, of fields (n, 3), T: a message a row, (n, size), uint8."""
        return self._template.make(stamps_ns, fields)
