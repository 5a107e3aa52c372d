"""Joint angles of a chain of links: three revolute joints between neighbours, in the order x, z, y."""

from typing import NamedTuple

import numpy as np

from sesa2.shape.measured import with_base
from sesa2.shape.rotations import FloatArray, multiply, wrap

# The joints are singular at |z| = 90°; beyond 80° the user is warned.
WARN_COSINE = np.cos(np.deg2rad(80.0))
_SINGULAR_COSINE = 1e-9
_XYZXYW = np.array([0, 1, 2, 0, 1, 3])


class JointAngles(NamedTuple):
    """Angles of the joints.

    Attributes
    ----------
    angles : batch + (n_links, 3)
        rad, in the order x, z, y.
    cosine : batch + (n_links,)
        of z; at 0, x and y turn about the same axis, and only their sum or difference is known.
    """

    angles: FloatArray
    cosine: FloatArray

    @property
    def singular(self) -> np.ndarray:
        """Whether a joint is singular, batch + (n_links,)."""
        return self.cosine < _SINGULAR_COSINE


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
    # Components first, x and y a second time behind z, so that each turn of x y z is a slice of contiguous numbers:
    # numpy is several times faster on these than on four numbers of each link.
    chain = np.moveaxis(with_base(link_orientations, base), -1, 0).take(_XYZXYW, axis=0)
    before, after = chain[..., :-1], chain[..., 1:]
    # The relative quaternion conj(before) ⊗ after, vector and scalar part.
    w = before[5] * after[5] + (before[:3] * after[:3]).sum(axis=0)
    v = before[5] * after[:3] - after[5] * before[:3] - before[1:4] * after[2:5] + before[2:5] * after[1:4]
    double = v + v
    squares, turns = double * v, double * w  # 2xx, 2yy, 2zz and 2wx, 2wy, 2wz
    products = double[0] * v[1], double[1] * v[2], double[2] * v[0]
    r00, r11 = 1.0 - squares[1] - squares[2], 1.0 - squares[0] - squares[2]
    r01, r02, r21 = products[0] - turns[2], products[2] + turns[1], products[1] + turns[0]
    cosine = np.sqrt(r00 * r00 + r02 * r02)
    angles = np.empty((*w.shape, 3))
    angles[..., 0] = np.arctan2(r21, r11)
    angles[..., 1] = np.arctan2(-r01, cosine)
    angles[..., 2] = np.arctan2(r02, r00)
    if cosine.min() < _SINGULAR_COSINE:
        singular = cosine < _SINGULAR_COSINE
        # With a = 0 the last row of Rz(c) Ry(b) is (−sin b, 0, cos b).
        r20, r22 = products[2] - turns[1], 1.0 - squares[0] - squares[1]
        angles[singular, 0] = 0.0
        angles[singular, 2] = np.arctan2(-r20, r22)[singular]
    return JointAngles(angles, cosine)


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
    angles[at, 2] = wrap(angles[at, 2] + np.sign(angles[at, 1]) * kept)
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
