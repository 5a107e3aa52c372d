"""The estimator's messages, from the bytes in which they arrive to arrays: rclpy would spend 2 ms on one Path."""

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sesa2.errors import Sesa2Error
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

_HEADER = 4  # of CDR; alignment counts from behind it
_POSE = 7  # doubles: position x y z, orientation x y z w


class StampedPoses(NamedTuple):
    """Poses of one instant.

    Attributes
    ----------
    stamp_ns
        of the measurement.
    poses : (n, 7)
        position x y z, m, and orientation x y z w.
    """

    stamp_ns: int
    poses: FloatArray


def read_pose_array(data: bytes) -> StampedPoses:
    """Read a geometry_msgs/PoseArray.

    Raises
    ------
    Sesa2Error
        the bytes are not one.
    """
    stamp_ns, at = _read_header(data, _HEADER, 'PoseArray')
    n, at = _read_count(data, at, 'PoseArray')
    return StampedPoses(stamp_ns, _read_poses(data, n, _align(at, 8), 8 * _POSE, 'PoseArray'))


def read_pose_arrays(data: Sequence[bytes]) -> tuple[np.ndarray, FloatArray]:
    """Read many geometry_msgs/PoseArray of equally many poses.

    Returns
    -------
    stamps_ns : (n,) and poses : (n, m, 7), as of `read_pose_array`.

    Raises
    ------
    Sesa2Error
        the bytes of one are none.
    ValueError
        their numbers of poses differ.
    """
    first = read_pose_array(data[0])
    size, m = len(data[0]), len(first.poses)
    together = np.frombuffer(b''.join(data), np.uint8)
    if m and set(map(len, data)) == {size}:
        rows = together.reshape(len(data), size)
        header, count = 16, _align(_read_header(data[0], _HEADER, 'PoseArray')[1], 4)
        start = _align(count + 4, 8)
        # Beginning, length of the frame's name and number of poses alike: then all is in the same places.
        fixed = np.concatenate([rows[:, :2], rows[:, 12:header], rows[:, count : count + 4]], axis=1)
        if (fixed == fixed[0]).all():
            times = np.ascontiguousarray(rows[:, 4:12]).view('<i4, <u4')[:, 0]
            stamps = times['f0'].astype(np.int64) * NS + times['f1']
            numbers = np.ascontiguousarray(rows[:, start : start + 8 * _POSE * m]).view('<f8')
            return stamps, numbers.reshape(len(data), m, _POSE)
    read = [read_pose_array(message) for message in data]
    return np.array([one.stamp_ns for one in read], dtype=np.int64), np.array([one.poses for one in read])


def read_pose(data: bytes) -> StampedPoses:
    """Read a geometry_msgs/PoseStamped.

    Raises
    ------
    Sesa2Error
        the bytes are not one.
    """
    stamp_ns, at = _read_header(data, _HEADER, 'PoseStamped')
    return StampedPoses(stamp_ns, _read_poses(data, 1, _align(at, 8), 8 * _POSE, 'PoseStamped'))


def read_path(data: bytes) -> StampedPoses:
    """Read a nav_msgs/Path whose poses all name one frame, or none.

    Raises
    ------
    Sesa2Error
        the bytes are not one.
    """
    stamp_ns, at = _read_header(data, _HEADER, 'Path')
    n, at = _read_count(data, at, 'Path')
    if n == 0:
        return StampedPoses(stamp_ns, np.empty((0, _POSE)))
    start = _align(at, 4)
    _, end_of_header = _read_header(data, start, 'Path')
    first = _align(end_of_header, 8)
    # Each further pose begins where the one before ended, at a multiple of eight: stamp, name of the frame, doubles.
    stride = _align(_HEADER + end_of_header - start, 8) - _HEADER + 8 * _POSE
    return StampedPoses(stamp_ns, _read_poses(data, n, first, stride, 'Path'))


def _align(at: int, size: int) -> int:
    return at + (_HEADER - at) % size


def _read_header(data: bytes, at: int, kind: str) -> tuple[int, int]:
    """Stamp, ns, and where the header ends."""
    if data[:2] != b'\x00\x01':
        raise Sesa2Error(f'a {kind} that is not little-endian CDR')
    try:
        seconds, nanoseconds, length = struct.unpack_from('<iII', data, at)
    except struct.error:
        raise Sesa2Error(f'a {kind} of {len(data)} bytes is too short') from None
    return seconds * NS + nanoseconds, at + 12 + length


def _read_count(data: bytes, at: int, kind: str) -> tuple[int, int]:
    at = _align(at, 4)
    try:
        return struct.unpack_from('<I', data, at)[0], at + 4
    except struct.error:
        raise Sesa2Error(f'a {kind} of {len(data)} bytes is too short') from None


def _read_poses(data: bytes, n: int, first: int, stride: int, kind: str) -> FloatArray:
    if n == 0:
        return np.empty((0, _POSE))
    expected = first + (n - 1) * stride + 8 * _POSE
    if len(data) < expected:
        raise Sesa2Error(f'a {kind} of {n} poses in {len(data)} bytes, expected {expected}')
    view = np.ndarray((n, _POSE), '<f8', data, first, (stride, 8))
    return view.astype(float)
