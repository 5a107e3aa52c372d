"""sensor_msgs/MagneticField as bytes: what a magnetometer beside a raw IMU says."""

import struct

import numpy as np

from sesa2.errors import Sesa2Error
from sesa2.messages.cdr import CdrLayout
from sesa2.messages.header_bytes import read_header
from sesa2.shape.rotations import FloatArray

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
        order, stamp_ns, at = read_header(data)
        return stamp_ns, np.array(struct.unpack_from(f'{order}3d', data, at))
    except (IndexError, struct.error):
        raise Sesa2Error(f'a {FIELD_TYPE} message of {len(data)} bytes, expected at least 112') from None


class FieldMessages:
    """Makes the messages of one magnetometer; covariance unknown."""

    def __init__(self, frame_id: str):
        self._template = CdrLayout().header(frame_id).doubles(3).constants(*[0.0] * 9).template()

    def make_fields(self, stamps_ns: np.ndarray, fields: FloatArray) -> np.ndarray:
        """Messages at stamps (n,), ns, of fields (n, 3), T: a message a row, (n, size), uint8."""
        return self._template.make(stamps_ns, fields)
