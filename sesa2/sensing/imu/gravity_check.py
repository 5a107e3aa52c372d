"""Whether orientation and acceleration of an IMU agree: at rest it feels 1 g upwards, and W has its z axis up.

That tells an earth frame with z down (north, east, down) however the arm stands, a conjugated quaternion and one with w
first. An IMU that turns while its orientation stays 0 0 0 1 has none: that is what an empty message of ROS 2 holds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sesa2.shape.rotations import FloatArray

_GRAVITY = 9.80665  # m/s²
_AT_REST = 0.3  # of it: what may be missing or too much
_ENOUGH = 20  # samples
_TURNS = 0.2  # rad/s
_IDENTITY = (0.0, 0.0, 0.0, 1.0)
# Of the cosine to the vertical, on average: what may be missing (11°), beyond what nothing is explained (60°), and how
# many times less another reading of the numbers must leave.
_MAY_LACK, _LACKS, _BETTER = 0.02, 0.5, 4.0

POINTS_DOWN = (
    'turned by its orientation, the acceleration points down, expected up: z of the earth frame points down '
    '(north-east-down; all is well if arm.base_orientation is given in it), or the driver gives acceleration with the '
    'sign of gravity'
)
CONJUGATED = (
    'its acceleration shows that its quaternions are conjugated: the earth in the sensor, expected the sensor in the '
    'earth'
)
W_FIRST = 'its acceleration shows that its quaternions are w x y z, expected x y z w'
DISAGREES = (
    'turned by its orientation, the acceleration does not point up, expected so at rest: are its accelerations in '
    'other axes than its orientation?'
)
NO_ORIENTATION_GIVEN = (
    'its orientation is always 0 0 0 1 while it turns: the driver gives none (and should say so by '
    'orientation_covariance[0] = −1); imus.fusion: 6d makes one'
)


@dataclass
class _Tally:
    looked: int = 0
    at_rest: int = 0
    up: float = 0.0  # sums of cosines: as it is, conjugated, w first
    up_conjugated: float = 0.0
    up_w_first: float = 0.0
    identities: int = 0
    fastest: float = 0.0  # rad/s
    first: FloatArray | None = None  # acceleration at rest
    varies: bool = False


class GravityCheck:
    """Looks at samples of IMUs; any number, and some of them do.

    Parameters
    ----------
    base_tells
        whether an earth frame that points down need not be told: it is seen by the base (`alignment.earth_frame`).
    """

    def __init__(self, base_tells: bool = False) -> None:
        self._base_tells = base_tells
        self._of: dict[int, _Tally] = {}

    def add(
        self, imu: int, orientations: FloatArray, angular_velocities: FloatArray, accelerations: FloatArray
    ) -> None:
        """Take samples of one IMU.

        Parameters
        ----------
        imu
            its id.
        orientations : (n, 4)
            q_WS, x y z w, of any norm.
        angular_velocities, accelerations : (n, 3)
            rad/s and, with gravity, m/s², in the sensor's axes; NaN where there is none.
        """
        own = self._of.setdefault(imu, _Tally())
        own.looked += len(orientations)
        own.identities += int((orientations == _IDENTITY).all(axis=1).sum())
        speeds = np.linalg.norm(angular_velocities, axis=1)
        own.fastest = max(own.fastest, float(np.nanmax(speeds, initial=0.0)))
        strength = np.linalg.norm(accelerations, axis=1)
        square = np.sum(orientations**2, axis=1)
        rest = (np.abs(strength / _GRAVITY - 1.0) < _AT_REST) & (square > 0.0)
        q = orientations[rest] / np.sqrt(square[rest, None])
        a = accelerations[rest] / strength[rest, None]
        own.at_rest += len(q)
        if len(q):
            own.first = accelerations[rest][0] if own.first is None else own.first
            own.varies |= bool((accelerations[rest] != own.first).any())
        own.up += _upwards(q, a)
        own.up_conjugated += _upwards(q * (-1.0, -1.0, -1.0, 1.0), a)
        own.up_w_first += _upwards(q[:, [1, 2, 3, 0]], a)

    @property
    def doubts(self) -> list[str]:
        """What looks wrong, for people, each with the IMUs that it is about."""
        found: dict[str, list[int]] = {}
        for imu, own in sorted(self._of.items()):
            if (reason := _doubt(own)) and not (reason == POINTS_DOWN and self._base_tells):
                found.setdefault(reason, []).append(imu)
        return [f'IMU {_listed(ids)}: {reason}' for reason, ids in found.items()]


def _doubt(own: _Tally) -> str:
    if own.looked < _ENOUGH:
        return ''
    if own.identities == own.looked and own.fastest > _TURNS:
        return NO_ORIENTATION_GIVEN
    # Without gravity, not in m/s², or a number that stands in for what is not measured.
    if own.at_rest < max(_ENOUGH, own.looked // 2) or not own.varies:
        return ''
    lacking = 1.0 - own.up / own.at_rest
    others = {
        POINTS_DOWN: 1.0 + own.up / own.at_rest,
        CONJUGATED: 1.0 - own.up_conjugated / own.at_rest,
        W_FIRST: 1.0 - own.up_w_first / own.at_rest,
    }
    best = min(others, key=lambda reason: others[reason])
    if lacking > _MAY_LACK and lacking > _BETTER * others[best]:
        return best
    return DISAGREES if lacking > _LACKS else ''


def _upwards(q: FloatArray, a: FloatArray) -> float:
    """Sum of the z components of unit vectors a (n, 3) turned by q (n, 4)."""
    x, y, z, w = q.T
    vertical = np.stack(
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), z * z + w * w - x * x - y * y], axis=-1
    )
    return float(np.sum(vertical * a))


def _listed(ids: Sequence[int]) -> str:
    return ', '.join(map(str, ids))
