"""From what an IMU measures to how its link is oriented."""

import numpy as np

from sesa2.shape.rotations import FloatArray, conjugate, multiply


class Mounting:
    """Corrects measured orientations: q_WL = Rz(−heading) ⊗ q_WS ⊗ q_LS⁻¹.

    The thesis's reorientation quaternion is q_LS⁻¹, one for all IMUs; here each has its own.

    Parameters
    ----------
    mountings : (n_imu, 4)
        q_LS, the sensor in its link, x y z w, unit norm.
    headings : (n_imu,)
        error of each IMU's heading about the world's z axis, rad.
    """

    def __init__(self, mountings: FloatArray, headings: FloatArray):
        n = len(headings)
        self._unmount = conjugate(mountings)
        self._unturn = np.zeros((n, 4))
        self._unturn[:, 2] = np.sin(-0.5 * headings)
        self._unturn[:, 3] = np.cos(0.5 * headings)
        # Most arms need none of the two, and a sweep should not pay for what it does not need.
        self._mounted = not np.array_equal(np.abs(mountings[:, 3]), np.ones(n))
        self._turned = bool(np.any(headings != 0.0))

    def link_orientations(self, measured: FloatArray) -> FloatArray:
        """Orientations of the links.

        Parameters
        ----------
        measured : (..., n_imu, 4)
            q_WS, x y z w, unit norm.

        Returns
        -------
        (..., n_imu, 4), q_WL, x y z w, unit norm.
        """
        links = multiply(measured, self._unmount) if self._mounted else measured
        return multiply(self._unturn, links) if self._turned else links
