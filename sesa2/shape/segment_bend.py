"""The bend of a segment of constant curvature, from how its tip is oriented against its base, in closed form."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sesa2.errors import shown
from sesa2.shape.arm import GeometryError
from sesa2.shape.rotations import FloatArray

# Who owns the twist that an arc cannot have.
TWIST_OWNERS = ('shared', 'tip', 'base', 'heading')


class SegmentBend(NamedTuple):
    """Bends of segments.

    Attributes
    ----------
    bend : (..., 2)
        bend_x, bend_y, rad; at most π together.
    twist : (...)
        what was left, rad, within ±π.
    """

    bend: FloatArray
    twist: FloatArray


def fit_bend(relative: ArrayLike, owner: str, vertical: ArrayLike | None = None) -> SegmentBend:
    """Fit an arc without twist.

    An arc turns its tip about (−bend_y, bend_x, 0) by |bend|. With x y z w of the relative orientation, w ≥ 0:

    `shared`
        the least error of orientation, Hughes et al. eq. 3: the turn about (x, y) by 2 atan2(√(x² + y²), w). Half the
        twist is at each end.
    `tip`
        q = arc ⊗ twist about z: about (x w − y z, y w + x z), by 2 atan2(√(x² + y²), √(z² + w²)). The IMU at the tip is
        mounted askew, or the arm twists.
    `base`
        q = twist ⊗ arc: about (x w + y z, y w − x z), by the same.
    `heading`
        q = turn about the vertical u ⊗ arc: the turn by 2 atan(z / (u_x y − u_y x + u_z w)) leaves an arc. The headings
        of the IMUs differ. Near a horizontal base the denominator is small and nothing is known of the turn.

    Parameters
    ----------
    relative : (..., 4)
        of the tip against the base, unit quaternions, x y z w.
    owner
        one of TWIST_OWNERS.
    vertical : (..., 3)
        unit vector of the world's vertical in the frame of the base; for `heading`.

    Returns
    -------
    The bends, and the twists; for `heading` the turn about the vertical.

    Raises
    ------
    GeometryError
        no such owner, or `heading` without the vertical.
    """
    relative = np.asarray(relative, dtype=float)
    x, y, z, w = np.moveaxis(np.where(relative[..., 3:] < 0.0, -relative, relative), -1, 0)
    if owner == 'shared':
        return SegmentBend(_bend(x, y, w), 2.0 * np.arctan2(z, w))
    if owner in ('tip', 'base'):
        # Taking the twist off: q ⊗ conj(twist) or conj(twist) ⊗ q, twist = (0, 0, z, w) / √(z² + w²).
        cosine = np.hypot(z, w)
        none = cosine == 0.0  # a half turn about a horizontal axis: as good as any is no twist
        safe = np.where(none, 1.0, cosine)
        sine, along = z / safe, np.where(none, 1.0, w / safe)
        if owner == 'base':
            return SegmentBend(
                _bend(x * along + y * sine, y * along - x * sine, cosine), 2.0 * np.arctan2(z, w)
            )
        return SegmentBend(_bend(x * along - y * sine, y * along + x * sine, cosine), 2.0 * np.arctan2(z, w))
    if owner != 'heading':
        raise GeometryError(f'twist = {shown(owner)}, expected one of {", ".join(TWIST_OWNERS)}')
    if vertical is None:
        raise GeometryError("twist = 'heading' needs the vertical in the frame of the base, got none")
    ux, uy, uz = np.moveaxis(np.asarray(vertical, dtype=float), -1, 0)
    along = ux * y - uy * x + uz * w
    half = np.arctan2(np.where(along < 0.0, -z, z), np.abs(along))
    c, s = np.cos(half), np.sin(half)
    # Vector and scalar of exp(−half u) ⊗ q; its z is zero.
    turned = _bend(
        c * x - s * (ux * w + uy * z - uz * y),
        c * y - s * (uy * w + uz * x - ux * z),
        c * w + s * (ux * x + uy * y + uz * z),
    )
    return SegmentBend(turned, 2.0 * half)


def _bend(x: FloatArray, y: FloatArray, w: FloatArray) -> FloatArray:
    """Of the turn about (x, y, 0) by 2 atan2(√(x² + y²), w), the short way; (..., 2)."""
    sine = np.hypot(x, y)
    small = sine < 1e-8
    scale = np.where(small, 2.0, 2.0 * np.arctan2(sine, np.abs(w)) / np.where(small, 1.0, sine))
    scale = np.where(w < 0.0, -scale, scale)
    return np.stack([scale * y, -scale * x], axis=-1)
