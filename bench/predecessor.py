"""The predecessor's way to compute a shape, as the thesis describes it: a peer to measure against.

At every message of one IMU, eight to a sweep, the whole chain is computed again, link by link, each quaternion in a small
array (thesis 4.4.6; the paper's eq. 2 to 7). Written anew; the positions are those of the package's models.
"""

import math

import numpy as np


def multiply(a, b):
    """Hamilton product, x y z w."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return np.array(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
    )


def slerp(a, b, t):
    """Between two quaternions, the short way."""
    dot = float(np.dot(a, b))
    if dot < 0.0:
        a, dot = -a, -dot
    angle = math.acos(min(dot, 1.0))
    if angle < 1e-9:
        return a
    return (math.sin((1.0 - t) * angle) * a + math.sin(t * angle) * b) / math.sin(angle)


def matrix(q):
    """Rotation matrix of a quaternion (paper eq. 1)."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def euler(relative):
    """Joint angles x, z, y of a relative rotation."""
    r = matrix(relative)
    return (
        math.atan2(r[2, 1], r[1, 1]),
        math.atan2(-r[0, 1], math.hypot(r[0, 0], r[0, 2])),
        math.atan2(r[0, 2], r[0, 0]),
    )


def chain(links, lengths, base):
    """Joint positions and angles, link by link."""
    positions, angles = [np.zeros(3)], []
    before = base
    for q, length in zip(links, lengths, strict=True):
        positions.append(positions[-1] + matrix(q) @ np.array([0.0, 0.0, length]))
        angles.append(euler(multiply(before * np.array([-1.0, -1.0, -1.0, 1.0]), q)))
        before = q
    return positions, angles


def on_message(orientations, base, mounting_inverse, segments, section_length, rigid_lengths):
    """Both models, as at each message: the corrected orientations, then every link again."""
    q = [multiply(one, mounting_inverse) for one in orientations]
    stations = [base, *q]
    links, lengths = [], []
    for a, b, n in zip(stations, stations[1:], segments, strict=False):
        for k in range(n):
            links.append(slerp(a, b, (2 * k + 1) / (2 * n)))
            lengths.append(section_length / n)
    return chain(q, rigid_lengths, base), chain(links, lengths, base)


def on_sweep(orientations, *arguments):
    """One sweep: eight messages."""
    for _ in orientations:
        result = on_message(orientations, *arguments)
    return result
