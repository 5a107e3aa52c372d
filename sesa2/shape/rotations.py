"""Unit quaternions, batched.

Every quaternion is an array of shape (..., 4) in the order x, y, z, w; leading axes broadcast. `q_AB` rotates
components in frame B into components in frame A, so that `q_AC = multiply(q_AB, q_BC)` and `v_A = rotate(q_AB, v_B)`.
Rotation vectors are axis times angle, rad, shape (..., 3).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])
IDENTITY.setflags(write=False)

# Below this angle (rad) a Taylor series replaces a quotient that loses digits; its next term is then below 1e-17.
SMALL_ANGLE = 1e-3
_BELOW_ONE = np.nextafter(1.0, 0.0)


def normalize(q: ArrayLike) -> FloatArray:
    """Scale quaternions to unit norm.

    Parameters
    ----------
    q : (..., 4)
        x y z w, norm not zero.

    Returns
    -------
    (..., 4), unit quaternions.
    """
    q = np.asarray(q, dtype=float)
    return q / np.sqrt(np.einsum('...i,...i->...', q, q))[..., None]


def multiply(p: ArrayLike, q: ArrayLike) -> FloatArray:
    """Hamilton product p ⊗ q: the rotation q followed by p.

    Parameters
    ----------
    p, q : (..., 4)
        x y z w.

    Returns
    -------
    (..., 4), p ⊗ q.
    """
    p, q = np.asarray(p, dtype=float), np.asarray(q, dtype=float)
    px, py, pz, pw = p[..., 0], p[..., 1], p[..., 2], p[..., 3]
    qx, qy, qz, qw = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    w = pw * qw - px * qx - py * qy - pz * qz
    out = np.empty((*w.shape, 4))
    out[..., 0] = pw * qx + px * qw + py * qz - pz * qy
    out[..., 1] = pw * qy - px * qz + py * qw + pz * qx
    out[..., 2] = pw * qz + px * qy - py * qx + pz * qw
    out[..., 3] = w
    return out


def cross(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Cross product of vectors, (..., 3) each: numpy's, without what it spends on other shapes (20 µs a call)."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    ax, ay, az, bx, by, bz = a[..., 0], a[..., 1], a[..., 2], b[..., 0], b[..., 1], b[..., 2]
    x = ay * bz - az * by
    out = np.empty((*x.shape, 3))
    out[..., 0] = x
    out[..., 1] = az * bx - ax * bz
    out[..., 2] = ax * by - ay * bx
    return out


def conjugate(q: ArrayLike) -> FloatArray:
    """Inverse rotation of unit quaternions q_AB: q_BA, shape (..., 4)."""
    return np.asarray(q, dtype=float) * (-1.0, -1.0, -1.0, 1.0)


def rotate(q: ArrayLike, v: ArrayLike) -> FloatArray:
    """Rotate vectors.

    Parameters
    ----------
    q : (..., 4)
        unit quaternions q_AB, x y z w.
    v : (..., 3)
        components in B.

    Returns
    -------
    (..., 3), components in A.
    """
    q, v = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
    u, w = q[..., :3], q[..., 3:]
    t = 2.0 * cross(u, v)
    return v + w * t + cross(u, t)


def tangent(q: ArrayLike) -> FloatArray:
    """Image of the z axis, the direction in which a link points: third column of the rotation matrix.

    Parameters
    ----------
    q : (..., 4)
        unit quaternions, x y z w.

    Returns
    -------
    (..., 3), unit vectors.
    """
    # With u = x + iy and v = z + iw it is 2 u v* and 1 − 2 |u|².
    pair = np.ascontiguousarray(q, dtype=float).view(complex)
    u, conjugates = pair[..., 0], pair.conj()
    out = np.empty((*u.shape, 3))
    np.multiply(u, conjugates[..., 1], out=out[..., :2].view(complex)[..., 0])
    np.subtract(0.5, (u * conjugates[..., 0]).real, out=out[..., 2])
    out += out
    return out


def to_matrix(q: ArrayLike) -> FloatArray:
    """Rotation matrices, whose columns are the images of the x, y and z axes.

    Parameters
    ----------
    q : (..., 4)
        unit quaternions q_AB, x y z w.

    Returns
    -------
    (..., 3, 3), R with v_A = R v_B.
    """
    q = np.asarray(q, dtype=float)
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    xx, yy, zz = x * x, y * y, z * z
    xy, xz, yz, xw, yw, zw = x * y, x * z, y * z, x * w, y * w, z * w
    half = np.empty((*x.shape, 3, 3))
    half[..., 0, 0] = 0.5 - (yy + zz)
    half[..., 0, 1] = xy - zw
    half[..., 0, 2] = xz + yw
    half[..., 1, 0] = xy + zw
    half[..., 1, 1] = 0.5 - (xx + zz)
    half[..., 1, 2] = yz - xw
    half[..., 2, 0] = xz - yw
    half[..., 2, 1] = yz + xw
    half[..., 2, 2] = 0.5 - (xx + yy)
    half += half
    return half


def from_matrix(R: ArrayLike) -> FloatArray:
    """Quaternions of rotation matrices, the inverse of `to_matrix`.

    The other components are divided by the largest, which no cancellation touches (Shepperd 1978).

    Parameters
    ----------
    R : (..., 3, 3)
        v_A = R v_B.

    Returns
    -------
    (..., 4), unit q_AB, x y z w.
    """
    R = np.asarray(R, dtype=float)
    x, y, z = (R[..., i, i] for i in range(3))
    # Row k of the four holds 4 q_k q: for the k whose q_k is the largest, it is as exact as R is.
    rows = np.empty((*R.shape[:-2], 4, 4))
    rows[..., 0, 0], rows[..., 1, 1] = 1.0 + x - y - z, 1.0 - x + y - z
    rows[..., 2, 2], rows[..., 3, 3] = 1.0 - x - y + z, 1.0 + x + y + z
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        rows[..., i, j] = rows[..., j, i] = R[..., i, j] + R[..., j, i]
        rows[..., k, 3] = rows[..., 3, k] = R[..., j, i] - R[..., i, j]
    largest = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), axis=-1)
    return normalize(np.take_along_axis(rows, largest[..., None, None], axis=-2)[..., 0, :])


def from_rotation_vector(v: ArrayLike) -> FloatArray:
    """Exponential map.

    Parameters
    ----------
    v : (..., 3)
        rotation vectors, rad.

    Returns
    -------
    (..., 4), unit quaternions, x y z w.
    """
    v = np.asarray(v, dtype=float)
    angle2 = np.einsum('...i,...i->...', v, v)
    angle = np.sqrt(angle2)
    half_sinc = np.where(
        angle < SMALL_ANGLE, 0.5 - angle2 / 48.0, np.sin(0.5 * angle) / np.where(angle == 0.0, 1.0, angle)
    )
    out = np.empty((*angle.shape, 4))
    out[..., :3] = half_sinc[..., None] * v
    out[..., 3] = np.cos(0.5 * angle)
    return out


def to_rotation_vector(q: ArrayLike) -> FloatArray:
    """Logarithm: the shortest rotation vector, so that q and −q give the same.

    Parameters
    ----------
    q : (..., 4)
        unit quaternions, x y z w.

    Returns
    -------
    (..., 3), rotation vectors, rad, length at most π. At π exactly the sign of the axis is arbitrary.
    """
    q = np.asarray(q, dtype=float)
    q = np.where(q[..., 3:] < 0.0, -q, q)
    sine = np.sqrt(np.einsum('...i,...i->...', q[..., :3], q[..., :3]))
    angle = 2.0 * np.arctan2(sine, q[..., 3])
    # angle / sine = 2 (1 + sine²/6 + …) near zero
    scale = np.where(sine < SMALL_ANGLE, 2.0 + sine * sine / 3.0, angle / np.where(sine == 0.0, 1.0, sine))
    return scale[..., None] * q[..., :3]


def slerp(a: ArrayLike, b: ArrayLike, t: ArrayLike) -> FloatArray:
    """Spherical linear interpolation, the short way.

    Paper eq. 4 and thesis eq. 3.12 leave out the choice between b and −b; without it random signs bend the arm the
    long way round.

    Parameters
    ----------
    a, b : (..., 4)
        unit quaternions, x y z w.
    t : (...)
        0 gives a, 1 gives b; broadcasts against the leading axes of a and b.

    Returns
    -------
    (..., 4), unit quaternions. Where a and b are exactly π apart, one of the two ways.
    """
    a, b, t = np.asarray(a, dtype=float), np.asarray(b, dtype=float), np.asarray(t, dtype=float)
    angle, sine, signed = _between(a, b)
    weight_a, weight_b = np.sin((1.0 - t) * angle) / sine, np.sin(t * angle) / signed
    return weight_a[..., None] * a + weight_b[..., None] * b


class SlerpPlaces:
    """Places between stations, ready for `slerp_along`.

    Slerp takes two sines a place; links at equal distances share them, as what lies before one lies behind another.

    Parameters
    ----------
    section : (m,)
        between 0 and n − 1, the station before each place.
    fraction : (m,)
        0 at that station, 1 at the next.
    """

    def __init__(self, section: np.ndarray, fraction: FloatArray):
        self.section = section
        of_sine = np.concatenate([1.0 - fraction, fraction])
        keys = np.tile(section, 2) + 1j * np.round(of_sine, 15)
        different, first, which = np.unique(keys, return_index=True, return_inverse=True)
        self.sine_section = different.real.astype(int)
        self.sine_fraction = of_sine[first]
        self.of_a, self.of_b = which.reshape(2, -1)


def slerp_along(stations: FloatArray, places: SlerpPlaces) -> FloatArray:
    """Spherical linear interpolation from station to station at many places; what a section has is computed once.

    Parameters
    ----------
    stations : (..., n + 1, 4)
        unit quaternions, x y z w.
    places
        m of them.

    Returns
    -------
    (..., m, 4), as `slerp` gives it.
    """
    a, b = stations[..., :-1, :], stations[..., 1:, :]
    angle, sine, signed = _between(a, b)
    a = (a / sine[..., None]).take(places.section, axis=-2)
    b = (b / signed[..., None]).take(places.section, axis=-2)
    sines = np.sin(places.sine_fraction * angle.take(places.sine_section, axis=-1))
    a *= sines.take(places.of_a, axis=-1)[..., None]
    b *= sines.take(places.of_b, axis=-1)[..., None]
    a += b
    return a


def _between(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Angle on the sphere from a to the nearer of b and −b, its sine, and that with the sign of the one that it is.

    The angle is at least 1e-8: sin(t · angle) / sin(angle) is t to the last digit there, as it is in the limit, and
    elsewhere this quotient hardly feels that the cosine does not tell small angles to the last digit.
    """
    cosine = np.einsum('...i,...i->...', a, b)
    angle = np.arccos(np.minimum(np.abs(cosine), _BELOW_ONE))
    sine = np.sin(angle)
    return angle, sine, np.copysign(sine, cosine)


def swing(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Least rotation that takes one direction onto another.

    Parameters
    ----------
    a : (..., 3)
        unit vectors.
    b : (..., 3)
        vectors of any length but zero, in the same frame.

    Returns
    -------
    (..., 4), unit quaternions q with rotate(q, a) along b. Opposite vectors turn about some perpendicular axis.
    """
    a, b = np.broadcast_arrays(np.asarray(a, dtype=float), np.asarray(b, dtype=float))
    length = np.sqrt(np.einsum('...i,...i->...', b, b))
    out = np.empty((*a.shape[:-1], 4))
    out[..., :3] = cross(a, b)
    out[..., 3] = length + np.einsum('...i,...i->...', a, b)
    opposite = out[..., 3] < 1e-12 * length
    if opposite.any():
        axis = np.where(np.abs(a[..., :1]) < 0.9, cross(a, (1.0, 0.0, 0.0)), cross(a, (0.0, 1.0, 0.0)))
        out[opposite, :3] = axis[opposite]
        out[opposite, 3] = 0.0
    return normalize(out)


def wrap(angle: ArrayLike) -> FloatArray:
    """The same angles within (−π, π], rad."""
    return np.arctan2(np.sin(angle), np.cos(angle))


def aim(q: ArrayLike, direction: ArrayLike) -> FloatArray:
    """Turn orientations the least that puts their z axes along given directions.

    Parameters
    ----------
    q : (..., 4)
        quaternions of any norm but zero, x y z w.
    direction : (..., 3)
        vectors of any length; one of length zero says nothing, and q stays as it is.

    Returns
    -------
    (..., 4), unit quaternions. A z axis that points the opposite way is turned about the orientation's own x axis.
    """
    q, direction = np.ascontiguousarray(q, dtype=float), np.ascontiguousarray(direction, dtype=float)
    # With d the direction and |d| its length it is |d| q − d ⊗ q ⊗ k, to be normalised. With u = x + iy and v = z + iw
    # of q and β = x + iy of d, its two complex numbers are (|d| − d_z) u + β v and (|d| + d_z) v + β* u.
    pair = q.view(complex)
    beta, along = direction[..., :2].view(complex)[..., 0], direction[..., 2]
    length = np.sqrt(np.einsum('...i,...i->...', direction, direction))
    own = np.empty((*length.shape, 2))
    np.subtract(length, along, out=own[..., 0])
    np.add(length, along, out=own[..., 1])
    aimed = own * pair
    aimed[..., 0] += beta * pair[..., 1]
    aimed[..., 1] += beta.conj() * pair[..., 0]
    out = aimed.view(float)
    norm = np.sqrt(np.einsum('...i,...i->...', out, out))
    lost = norm <= 1e-12 * length
    if np.count_nonzero(lost):
        stays = np.where((length > 0.0)[..., None], multiply(q, (1.0, 0.0, 0.0, 0.0)), q)
        return normalize(np.where(lost[..., None], stays, out))
    out /= norm[..., None]
    return out


def of_one_sign(q: ArrayLike) -> FloatArray:
    """Choose between q and −q so that each quaternion of a row is on the side of the one before it.

    Parameters
    ----------
    q : (..., n, 4)
        x y z w.

    Returns
    -------
    (..., n, 4), the same rotations.
    """
    q = np.asarray(q, dtype=float)
    turns = np.einsum('...i,...i->...', q[..., 1:, :], q[..., :-1, :]) < 0.0
    if not np.count_nonzero(turns):
        return q
    out = q.copy()
    out[..., 1:, :] *= np.where(np.logical_xor.accumulate(turns, axis=-1), -1.0, 1.0)[..., None]
    return out
