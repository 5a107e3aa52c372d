"""The virtual arm with its IMUs: what each sensor measures while the arm moves."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from sesa2.link.virtual.motion import FloatArray, Motion
from sesa2.shape import rotations

_GRAVITY = (0.0, 0.0, 9.80665)  # what an accelerometer at rest measures, in W
_FIELD = (0.0, 20e-6, -45e-6)  # T, in the IMU's earth frame, whose y is north: that of middle latitudes


class VirtualArm:
    """IMUs on a moving arm.

    Parameters
    ----------
    ids
        Ids of the n IMUs, in the order of the motion's rows.
    motion
        Where their links point, over time.
    mount_orientations
        q_LS, shape (4,) or (n, 4), x y z w.
    headings
        Heading error of each IMU's earth frame, rad, shape () or (n,).
    random_signs
        Give q or −q at random, as a chip may.
    seed
        Of the random signs.
    """

    def __init__(
        self,
        ids: Sequence[int],
        motion: Motion,
        *,
        mount_orientations: ArrayLike = (0.0, 0.0, 0.0, 1.0),
        headings: ArrayLike = 0.0,
        random_signs: bool = False,
        seed: int = 0,
    ) -> None:
        self.ids = tuple(ids)
        self.motion = motion
        n = len(self.ids)
        self._mounts = np.broadcast_to(np.asarray(mount_orientations, float), (n, 4))
        self._headings = np.broadcast_to(np.asarray(headings, float), (n,))
        self._rows = {imu_id: row for row, imu_id in enumerate(self.ids)}
        self._random = np.random.default_rng(seed) if random_signs else None

    def orientations(self, ids: Sequence[int], t: FloatArray, headings: FloatArray) -> FloatArray:
        """What IMUs measure: q_WS = Rz(heading) ⊗ q_WL ⊗ q_LS, shape (..., n, 4).

        Parameters
        ----------
        ids
            Which n IMUs.
        t
            When each is read, s, shape (..., n).
        headings
            On top of the arm's own, rad, shape (n,).
        """
        rows = [self._rows[imu_id] for imu_id in ids]
        q_WL = self.motion(t)[..., np.arange(len(rows)), rows, :]
        half = (self._headings[rows] + headings) / 2
        turn = np.zeros((len(rows), 4))
        turn[:, 2], turn[:, 3] = np.sin(half), np.cos(half)
        q = rotations.multiply(rotations.multiply(turn, q_WL), self._mounts[rows])
        if self._random is not None:
            q *= self._random.choice((-1.0, 1.0), (*q.shape[:-1], 1))
        return q


def accelerations(q_WS: ArrayLike) -> FloatArray:
    """What accelerometers at these orientations measure, gravity alone: m/s², in the sensors' frames, shape (n, 3)."""
    return rotations.rotate(rotations.conjugate(q_WS), _GRAVITY)


def magnetic_fields(q_WS: ArrayLike) -> FloatArray:
    """What magnetometers at these orientations measure, the earth's field: T, in the sensors' frames, shape (n, 3)."""
    return rotations.rotate(rotations.conjugate(q_WS), _FIELD)


def angular_velocities(before: ArrayLike, after: ArrayLike, duration: float) -> FloatArray:
    """What gyroscopes measure that turn from one q_WS to another in a short time, s: rad/s, in their frames."""
    turn = rotations.multiply(rotations.conjugate(before), after)
    return rotations.to_rotation_vector(turn) / duration
