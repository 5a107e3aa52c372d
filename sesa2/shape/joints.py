"""Joint angles of a chain of links: three revolute joints between neighbours, in the order x, z, y."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from sesa2.shape.rotations import FloatArray, multiply, wrap

# The joints are singular at |z| = 90°; beyond 80° the user is warned.
WARN_COSINE = np.cos(np.deg2rad(80.0))
_SINGULAR_COSINE = 1e-9
# What `joint_angles` multiplies, as complex numbers, from x y z w: w − ix and z − iy of the link before,
# (w − z) + i (x + y) and (w + z) + i (x − y) of the link itself.
_BEFORE = np.array([[0, -1, 0, 0], [0, 0, 0, -1], [0, 0, 1, 0], [1, 0, 0, 0]], dtype=float)
_AFTER = np.array([[0, 1, 0, 1], [0, 1, 0, -1], [-1, 0, 1, 0], [1, 0, 1, 0]], dtype=float)


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


def joint_angles(
    link_orientations: FloatArray, base: FloatArray, on_base: Iterable[int] = (0,)
) -> JointAngles:
    """Split each link's rotation against the link before it into Rx(a) Rz(c) Ry(b).

    In half angles a quaternion x y z w is, after two additions,

        (w − z) + i (x + y) = (cos c/2 − sin c/2) exp(i (a + b) / 2) =: p
        (w + z) + i (x − y) = (cos c/2 + sin c/2) exp(i (a − b) / 2) =: m

    so that a and b are the arguments of p m and of p m*, and |p|, |m| are to each other as cosine and sine of c/2 + 45°
    (after Bernardes and Viollet, PLoS ONE 17 (2022) e0276302, worked out for this order). Where |c| is 90° one of the
    two is zero: a is put to 0 and b takes the whole; `hold_x` then brings back the x that was.

    Parameters
    ----------
    link_orientations : batch + (n_links, 4)
        q_WL, x y z w.
    base : (4,)
        or batch + (4,), q_WB, x y z w.
    on_base
        the links that the base comes before. More than one if chains of several models stand one after the other.

    Returns
    -------
    The angles.
    """
    before = np.empty(link_orientations.shape)
    before[..., 1:, :] = link_orientations[..., :-1, :]
    for link in on_base:
        before[..., link, :] = base
    # p and m of conj(before) ⊗ link, straight from both.
    before, own = (before @ _BEFORE).view(complex), (link_orientations @ _AFTER).view(complex)
    wx, zy, own_p, own_m = before[..., 0], before[..., 1], own[..., 0], own[..., 1]
    p = wx * own_p + zy * own_m.conj()
    m = wx * own_m - zy * own_p.conj()
    size_p, size_m = np.abs(p), np.abs(m)
    about_x, about_y = p * m, p * m.conj()
    cosine = size_p * size_m
    angles = np.empty((*cosine.shape, 3))
    np.arctan2(about_x.imag, about_x.real, out=angles[..., 0])
    np.subtract(2.0 * np.arctan2(size_m, size_p), 0.5 * np.pi, out=angles[..., 1])
    np.arctan2(about_y.imag, about_y.real, out=angles[..., 2])
    joints = JointAngles(angles, cosine)
    if cosine.min() < _SINGULAR_COSINE:
        singular = joints.singular
        whole = p[singular] + m[singular].conj()  # one of the two is as good as zero
        angles[singular, 0] = 0.0
        angles[singular, 2] = wrap(2.0 * np.angle(whole))
    return joints


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
