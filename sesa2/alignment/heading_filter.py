"""Slow drift of the headings, followed while the arm moves, from the past alone."""

import numpy as np

from sesa2.alignment.shape_prior import (
    INDEPENDENCE_TIME,
    TILT_SCATTER,
    ShapePrior,
    likelier_twist,
)
from sesa2.shape.layout import Layout
from sesa2.shape.missing import fill_missing
from sesa2.shape.rotations import FloatArray, multiply

# Assumed of a calibrated BNO055, whose heading follows the magnetic surroundings as the arm and the room change.
DRIFT_STD = np.deg2rad(2.0)
DRIFT_TIME = 60.0

PERIOD = 1.0
_FIRST_TWIST = 0.1
_TWIST_RATE = 0.1  # of the way to the likelier twist, a frame
_GAUSS_NEWTON_STEPS = 2


class HeadingFilter:
    """Kalman filter of each IMU's heading, an Ornstein–Uhlenbeck process, that looks at one sweep a second.

    What a sweep tells about the headings is taken with the shape marginalised, as in self-calibration. A twist of the
    arm looks like headings that drift; how much it twists is learnt on the way, so that an arm that does is corrected
    less.

    Parameters
    ----------
    layout
        the arm and its IMUs.
    drift_std
        standard deviation of a heading about its calibrated value, rad.
    drift_time
        time in which it is forgotten, s.

    Attributes
    ----------
    headings : (n_imu,)
        current errors of the headings, to be taken off: q_WL = Rz(−heading) ⊗ link, rad.
    covariance : (n_imu, n_imu)
        their uncertainty, rad².
    """

    def __init__(self, layout: Layout, drift_std: float = DRIFT_STD, drift_time: float = DRIFT_TIME):
        self._layout = layout
        self._prior = ShapePrior(layout, heading_scatter=TILT_SCATTER)
        self._variance, self._time = drift_std**2, drift_time
        self._n_imu = layout.n_imu
        self.reset()

    def reset(self) -> None:
        """Forget everything, as at the start of a recording."""
        self.headings = np.zeros(self._n_imu)
        self.covariance = self._variance * np.eye(self._n_imu)
        self._twist = _FIRST_TWIST
        self._last: float | None = None

    def correct(
        self, stamps: FloatArray, links: FloatArray, measured: np.ndarray, base: FloatArray
    ) -> FloatArray:
        """Follow the headings through sweeps and take them off.

        Parameters
        ----------
        stamps : (n,)
            s, increasing; a step back resets.
        links : (n, n_imu, 4)
            q_WL, corrected for mountings and calibrated headings, x y z w.
        measured : (n, n_imu)
            true where the IMU has measured.
        base : (4,)
            or (n, 4), q_WB, x y z w.

        Returns
        -------
        (n, n_imu, 4), q_WL, each sweep with the headings known at its time.
        """
        bases = np.broadcast_to(base, (len(stamps), 4))
        half = np.empty((len(stamps), self._n_imu))
        for i, stamp in enumerate(stamps):
            half[i] = self.update(stamp, links[i], measured[i], bases[i])
        half *= -0.5
        unturn = np.zeros((*half.shape, 4))
        unturn[..., 2], unturn[..., 3] = np.sin(half), np.cos(half)
        return multiply(unturn, links)

    def update(self, stamp: float, links: FloatArray, measured: np.ndarray, base: FloatArray) -> FloatArray:
        """Take one sweep; only one a second is looked at.

        Parameters
        ----------
        stamp
            s.
        links : (n_imu, 4)
            q_WL, corrected for mountings and calibrated headings, x y z w.
        measured : (n_imu,)
            true where the IMU has measured.
        base : (4,)
            q_WB, x y z w.

        Returns
        -------
        (n_imu,), the current headings, rad.
        """
        if self._last is not None:
            elapsed = stamp - self._last
            if 0.0 <= elapsed < PERIOD:
                return self.headings
            if elapsed < 0.0:
                self.reset()
            else:
                kept = np.exp(-elapsed / self._time)
                self.headings = kept * self.headings
                fresh = (1.0 - kept**2) * self._variance * np.eye(self._n_imu)
                self.covariance = kept**2 * self.covariance + fresh
        self._last = stamp
        if measured.any():
            self._look(links, measured, base)
        return self.headings

    def _look(self, links: FloatArray, measured: np.ndarray, base: FloatArray) -> None:
        q, there, bases = links[None], measured[None], np.asarray(base, dtype=float)[None]
        q = fill_missing(q, there, self._layout, bases)
        curvature = self._prior.first_guess(q, bases)
        for _ in range(_GAUSS_NEWTON_STEPS):
            y, J, _ = self._prior.linearise(curvature, q, bases)
            # The headings known so far turn about the world's z: every third row.
            y[:, 2::3] -= self.headings
            marginal = self._prior.marginalise(J, there, self._twist)
            weighed = np.einsum('nrs,ns->nr', marginal.precision, y)
            curvature = self._prior.most_likely(J, weighed, self._twist)
        # A sweep that fits nothing, from a damaged sample, is weighted down.
        trust = min(1.0, 3.0 * measured.sum() / max(float((y * weighed).sum()), 1e-12))
        weight = trust * min(1.0, PERIOD / INDEPENDENCE_TIME)
        information = weight * marginal.precision[0, 2::3, 2::3]
        self.covariance = np.linalg.inv(np.linalg.inv(self.covariance) + information)
        step = self.covariance @ (weight * weighed[0, 2::3])
        self.headings = self.headings + step
        left = np.sqrt(trust) * (weighed - marginal.precision[:, :, 2::3] @ step)
        likelier = likelier_twist(self._twist, marginal, left)
        self._twist *= (likelier / self._twist) ** _TWIST_RATE
