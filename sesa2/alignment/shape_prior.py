"""What a soft arm's shape is likely to be before it is measured, and what orientations tell once the shape is left out.

Curvature along the arm, in the link frame, is taken as a Gaussian process: a random walk that begins near zero at the
tip, where a free arm bears no couple. Given tangents, its most likely course is the cubic spline of the model `spline`
(least integral of the squared change of curvature). Bending is free; twist is small. Whatever then turns the measured
orientations besides the shape, an IMU's mounting or its heading, is estimated with the shape marginalised.
"""

from typing import NamedTuple

import numpy as np

from sesa2.shape.layout import Layout
from sesa2.shape.measured import with_base
from sesa2.shape.rotations import (
    FloatArray,
    conjugate,
    from_rotation_vector,
    multiply,
    rotate,
    tangent,
    to_rotation_vector,
)

# Standard deviations of the angle by which the whole arm bends about each axis, so wide that it hardly matters, and
# twists, rad.
BENDING = 9.0
TWIST = 0.03
# The more an arm bends, the more its curvature changes along it: over the whole arm, against how much it bends.
_CHANGE_OF_CURVATURE = 6.0

# Scatter assumed of an IMU that is already corrected, from all that changes with time: about each axis, and of its
# heading about the vertical besides, rad.
TILT_SCATTER = np.deg2rad(1.0)
HEADING_SCATTER = np.deg2rad(2.0)

# Shape and sensor errors change within seconds: a recording tells as much as one independent frame per this time, s.
INDEPENDENCE_TIME = 3.0

_CELLS = 32
_TIP_VARIANCE = 4e-4  # of the curvature at the tip, against that at the base


class Linearised(NamedTuple):
    """Orientations linearised about a shape.

    With c the true curvature, d small rotations by which the measured orientations are off, and `rows` the n_imu × 3
    world components of rotations: y = J c + d + scatter.

    Attributes
    ----------
    y : (n, rows)
        rad.
    J : (n, rows, n_cells, 3)
        rad per unit of curvature.
    links : (n, n_imu, 4)
        q_WL of the shape, x y z w.
    """

    y: FloatArray
    J: FloatArray
    links: FloatArray


class Marginal(NamedTuple):
    """Orientations with the shape left out: y is Gaussian about d with covariance S.

    Attributes
    ----------
    bending, twist : (n, rows, rows)
        what bending and twist contribute to S, rad².
    precision : (n, rows, rows)
        S⁻¹, rad⁻²; zero in the rows of IMUs that have not measured.
    """

    bending: FloatArray
    twist: FloatArray
    precision: FloatArray


class ShapePrior:
    """The prior for one arm, on cells of constant curvature between its stations.

    Curvature is times the arm's length: the angle, rad, by which it would turn the whole arm.

    Parameters
    ----------
    layout
        the arm and its IMUs.
    heading_scatter
        of an IMU, rad.

    Attributes
    ----------
    bending
        standard deviation of the angle by which the whole arm bends about each axis, rad.
    """

    def __init__(self, layout: Layout, heading_scatter: float = HEADING_SCATTER):
        self.bending = BENDING
        stations = layout.stations / layout.arm.length
        self._sections = np.diff(stations)
        counts = np.ceil(_CELLS * self._sections / stations[-1] - 1e-9).astype(int)
        self._section = np.repeat(np.arange(len(counts)), counts)
        self._h = np.repeat(self._sections / counts, counts)
        self._ends_at_imu = np.cumsum(counts)
        before_imu = np.arange(len(self._h)) < self._ends_at_imu[:, None]
        self._h_before_imu = before_imu * self._h
        to_tip = 1.0 - np.cumsum(self._h) + 0.5 * self._h
        # The whole arm's angle then has unit variance: the integral of min(a, b) over the unit square is 1/3.
        self._covariance = 3.0 * (np.minimum(to_tip[:, None], to_tip) + _TIP_VARIANCE)
        rows = 3 * len(counts)
        self._scatter = TILT_SCATTER**2 * np.eye(rows)
        self._scatter[2::3, 2::3] += heading_scatter**2 * np.eye(len(counts))

    def widen(self, links: FloatArray, base: FloatArray) -> None:
        """Expect as much bending as these orientations show, and no less than always.

        Parameters
        ----------
        links : (n, n_imu, 4)
            q_WL, x y z w.
        base : (n, 4)
            q_WB, x y z w.
        """
        self.bending = max(BENDING, _CHANGE_OF_CURVATURE * _least_bend(links, base))

    def first_guess(self, links: FloatArray, base: FloatArray) -> FloatArray:
        """Constant curvature from station to station.

        Parameters
        ----------
        links : (n, n_imu, 4)
            q_WL, x y z w.
        base : (n, 4)
            q_WB, x y z w.

        Returns
        -------
        (n, n_cells, 3), rad.
        """
        stations = with_base(links, base)
        turns = to_rotation_vector(multiply(conjugate(stations[:, :-1]), stations[:, 1:]))
        return (turns / self._sections[:, None]).take(self._section, axis=1)

    def curvature_at_imus(self, curvature: FloatArray) -> FloatArray:
        """Curvature of the cells before and after each IMU, the mean: (n, n_imu, 3) of (n, n_cells, 3), rad."""
        before = self._ends_at_imu - 1
        after = np.minimum(self._ends_at_imu, len(self._h) - 1)
        return 0.5 * (curvature[:, before] + curvature[:, after])

    def linearise(self, curvature: FloatArray, links: FloatArray, base: FloatArray) -> Linearised:
        """Compare measured orientations with a shape.

        Parameters
        ----------
        curvature : (n, n_cells, 3)
            of the shape, rad.
        links : (n, n_imu, 4)
            measured q_WL, x y z w.
        base : (n, 4)
            q_WB, x y z w.
        """
        n, n_imu = links.shape[:2]
        turns = curvature * self._h[:, None]
        chain = np.concatenate([base[:, None], from_rotation_vector(turns)], axis=1)
        step = 1
        while step < chain.shape[1]:  # running product, by doubling
            chain[:, step:] = multiply(chain[:, :-step], chain[:, step:])
            step *= 2
        middles = multiply(chain[:, :-1], from_rotation_vector(0.5 * turns))
        axes = rotate(middles[:, :, None], np.eye(3))  # (n, cell, link axis, world component)
        J = self._h_before_imu[:, None, :, None] * axes.transpose(0, 3, 1, 2)[:, None]
        J = J.reshape(n, 3 * n_imu, -1, 3)
        shape = chain[:, self._ends_at_imu]
        off = to_rotation_vector(multiply(links, conjugate(shape))).reshape(n, -1)
        return Linearised(off + np.einsum('nrca,nca->nr', J, curvature), J, shape)

    def marginalise(self, J: FloatArray, measured: np.ndarray, twist: float) -> Marginal:
        """Leave the shape out.

        Parameters
        ----------
        J : (n, rows, n_cells, 3)
            see Linearised.
        measured : (n, n_imu)
            true where the IMU has measured.
        twist
            standard deviation of the whole arm's twist, rad.
        """
        by_axis = [J[..., a] @ self._covariance @ J[..., a].swapaxes(-1, -2) for a in range(3)]
        bending = self.bending**2 * (by_axis[0] + by_axis[1])
        twisting = twist**2 * by_axis[2]
        S = bending + twisting + self._scatter
        there = np.repeat(measured, 3, axis=-1)
        both = there[:, :, None] & there[:, None, :]
        S = np.where(both, S, np.eye(S.shape[-1]))
        return Marginal(bending, twisting, np.where(both, np.linalg.inv(S), 0.0))

    def most_likely(self, J: FloatArray, weighed: FloatArray, twist: float) -> FloatArray:
        """Curvature that is most likely given the orientations.

        Parameters
        ----------
        J : (n, rows, n_cells, 3)
            see Linearised.
        weighed : (n, rows)
            S⁻¹ (y − d).
        twist
            standard deviation of the whole arm's twist, rad.

        Returns
        -------
        (n, n_cells, 3), rad.
        """
        pulled = np.einsum('nrca,nr->nca', J, weighed)
        return (self._covariance @ pulled) * np.square([self.bending, self.bending, twist])


def _least_bend(links: FloatArray, bases: FloatArray) -> float:
    """How much an arm bends at least, rad: the median angle from a station to the nearest one in direction, times them.

    It is the same however IMUs are exchanged, so that exchanged ones do not pass for an arm that bends a lot.
    """
    tangents = tangent(with_base(links, bases))
    cosines = tangents @ tangents.swapaxes(1, 2)
    n = cosines.shape[1]
    cosines[:, np.arange(n), np.arange(n)] = -1.0
    return (n - 1) * float(np.median(np.arccos(np.clip(cosines.max(axis=-1), -1.0, 1.0))))


def likelier_twist(twist: float, marginal: Marginal, weighed: FloatArray) -> float:
    """One step towards the twist under which the orientations are likeliest.

    With G the twist's share of S, the likelihood of its scale is stationary where Σ wᵀ G w = Σ tr S⁻¹ G,
    w = S⁻¹ (y − d): the condition of REML for a variance component, met by MacKay's fixed-point iteration (1992).

    Parameters
    ----------
    twist
        the scale that `marginal` was made with, rad.
    marginal
        of the frames.
    weighed : (n, rows)
        w, weighted as the frames are.

    Returns
    -------
    The scale, rad, within 0.01 and 3.
    """
    got = np.einsum('nr,nrs,ns->', weighed, marginal.twist, weighed)
    expected = np.einsum('nrs,nsr->', marginal.precision, marginal.twist)
    return float(np.clip(twist * np.sqrt(np.clip(got / expected, 0.1, 10.0)), 0.01, 3.0))
