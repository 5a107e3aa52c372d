"""Whether the IMUs' earth frame has its z axis down, as that of north, east and down (NED) has; ours has it up.

Everything that such IMUs measure is mirrored against the base, and a straight pose even makes a plausible arm of it.
The orientation of the base in their frame mends it: q_WB is (√½, √½, 0, 0) ⊗ what it is in east, north and up (ENU).
"""

import numpy as np

from sesa2.shape.rotations import FloatArray, tangent

# An arm may be curled up. That the IMU next to the clamp points against it on average, and the others do too, is no
# shape of it.
_AGAINST = np.cos(np.deg2rad(120.0))

UPSIDE_DOWN = (
    'all IMUs point against the base: does z of their earth frame point down (north-east-down)? Then '
    'arm.base_orientation of an upright arm is [0.7071, 0.7071, 0.0, 0.0]; or the arm hangs, which '
    'arm.base_orientation has to say'
)


class BaseComparison:
    """Compares the directions of the links with that of the base, over any number of sweeps."""

    def __init__(self) -> None:
        self._sum: FloatArray | float = 0.0
        self._n: np.ndarray | int = 0

    def add(self, links: FloatArray, measured: np.ndarray, base: FloatArray) -> None:
        """Take sweeps.

        Parameters
        ----------
        links : (n, n_imu, 4)
            q_WL, x y z w, unit norm.
        measured : (n, n_imu)
            true where the IMU has measured.
        base : (n, 4)
            q_WB, x y z w, unit norm.
        """
        cosine = np.sum(tangent(links) * tangent(base)[:, None], axis=-1)
        self._sum = self._sum + np.where(measured, cosine, 0.0).sum(axis=0)
        self._n = self._n + measured.sum(axis=0)

    @property
    def doubt(self) -> str:
        """A sentence where the IMUs that have measured point against the base; empty where all is well."""
        heard = np.flatnonzero(self._n)
        if not len(heard):
            return ''
        mean = np.asarray(self._sum)[heard] / np.asarray(self._n)[heard]
        return UPSIDE_DOWN if mean[0] < _AGAINST and (mean < 0.0).all() else ''
