"""Joint angles of a chain of links: three revolute joints between neighbours, in the order x, z, y."""

from typing import NamedTuple

import numpy as np

from sesa2.shape.model import with_base
from sesa2.shape.rotations import FloatArray, multiply

# The joints are singular at |z| = 90°; beyond this the user is warned.
WARN_ANGLE = np.deg2rad(80.0)
_SINGULAR_COSINE = 1e-9


class JointAngles(NamedTuple):
    """Angles of the joints.

    Attributes
    ----------
    angles : batch + (n_links, 3)
        rad, in the order x, z, y.
    singular : batch + (n_links,)
        true where x and y turn about the same axis and only their sum or difference is known.
    """

    angles: FloatArray
    singular: np.ndarray


def joint_angles(link_orientations: FloatArray, base: FloatArray) -> JointAngles:
    """Split each link's rotation against its predecessor into R = Rx(a) Rz(c) Ry(b).

    With R written out, R₀₁ = −sin c, b = atan2(R₀₂, R₀₀) and a = atan2(R₂₁, R₁₁). Where |c| is 90°, a is put to 0 and
    b takes the whole; `hold_x` then brings back the x that was.

    Parameters
    ----------
    link_orientations : batch + (n_links, 4)
        q_WL, x y z w.
    base : (4,)
        or batch + (4,), q_WB.

    Returns
    -------
    The angles.
    """
    # Components first: numpy is several times faster on the contiguous numbers of many links than on four of each.
    chain = np.ascontiguousarray(np.moveaxis(with_base(link_orientations, base), -1, 0))
    (bx, by, bz, bw), (ax, ay, az, aw) = chain[..., :-1], chain[..., 1:]
    x = bw * ax - bx * aw - by * az + bz * ay
    y = bw * ay + bx * az - by * aw - bz * ax
    z = bw * az - bx * ay + by * ax - bz * aw
    w = bw * aw + bx * ax + by * ay + bz * az
    xx, yy, zz = x * x, y * y, z * z
    r01 = 2.0 * (x * y - w * z)
    r00, r02 = 1.0 - 2.0 * (yy + zz), 2.0 * (x * z + w * y)
    r11, r21 = 1.0 - 2.0 * (xx + zz), 2.0 * (y * z + w * x)
    cosine = np.sqrt(r00 * r00 + r02 * r02)
    angles = np.empty((*x.shape, 3))
    angles[..., 0] = np.arctan2(r21, r11)
    angles[..., 1] = np.arctan2(-r01, cosine)
    angles[..., 2] = np.arctan2(r02, r00)
    singular = cosine < _SINGULAR_COSINE
    if singular.any():
        # With a = 0 the last row of Rz(c) Ry(b) is (−sin b, 0, cos b).
        r20, r22 = 2.0 * (x * z - w * y), 1.0 - 2.0 * (xx + yy)
        angles[singular, 0] = 0.0
        angles[singular, 2] = np.arctan2(-r20, r22)[singular]
    return JointAngles(angles, singular)


def hold_x(joints: JointAngles, previous: FloatArray) -> FloatArray:
    """Give singular joints the x angle that they had, and y what is left over.

    Parameters
    ----------
    joints
        of one instant, (n_links, 3).
    previous : (n_links, 3)
        angles of the instant before, rad.

    Returns
    -------
    (n_links, 3), rad; the same rotation, without a jump in x.
    """
    angles = joints.angles
    if not joints.singular.any():
        return angles
    angles = angles.copy()
    at = joints.singular
    kept = previous[at, 0]
    # With c = +90°, Rx(a) Rz(c) Ry(b) = Rz(c) Ry(b − a); with −90° it is Rz(c) Ry(b + a).
    angles[at, 0] = kept
    angles[at, 2] = _wrap(angles[at, 2] + np.sign(angles[at, 1]) * kept)
    return angles


def link_orientations(angles: FloatArray, base: FloatArray) -> FloatArray:
    """Follow the joints from the base to the tip: the inverse of `joint_angles`.

    Parameters
    ----------
    angles : (n_links, 3)
        rad, in the order x, z, y.
    base : (4,)
        q_WB, x y z w.

    Returns
    -------
    (n_links, 4), q_WL, x y z w.
    """
    half = 0.5 * angles
    zero = np.zeros(len(angles))
    about_x = np.stack([np.sin(half[:, 0]), zero, zero, np.cos(half[:, 0])], axis=-1)
    about_z = np.stack([zero, zero, np.sin(half[:, 1]), np.cos(half[:, 1])], axis=-1)
    about_y = np.stack([zero, np.sin(half[:, 2]), zero, np.cos(half[:, 2])], axis=-1)
    steps = multiply(multiply(about_x, about_z), about_y)
    out = np.empty_like(steps)
    q = np.asarray(base, dtype=float)
    for i, step in enumerate(steps):
        q = multiply(q, step)
        out[i] = q
    return out


def _wrap(angle: FloatArray) -> FloatArray:
    return np.arctan2(np.sin(angle), np.cos(angle))
