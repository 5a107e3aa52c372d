"""A cubic spline through the tangents at the IMUs, integrated exactly: an arm of continuous curvature (ours)."""

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.curve import CurveModel
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.model import Backbone
from sesa2.shape.options import LinkOptions
from sesa2.shape.rotations import FloatArray, aim, of_one_sign, tangent


class TangentSpline(Backbone):
    """The curve whose tangent is the spline."""

    def __init__(self, model: 'Spline', stations: FloatArray):
        self._model = model
        self._stations = of_one_sign(stations)
        self._tangents = tangent(stations)

    def positions(self, s: ArrayLike) -> FloatArray:
        """See Backbone. A weighted sum of the tangents at the stations."""
        integrals, *_ = self._model.at(s)
        return integrals @ self._tangents

    def orientations(self, s: ArrayLike) -> FloatArray:
        """See Backbone. The least turn onto the curve from what lies between the stations (held past the last IMU).

        Between the stations the quaternions are blended linearly: where two are 30° apart this is 0.03° from slerp at
        most, and it is a matrix product where slerp takes two sines for every place.
        """
        _, weights, blend = self._model.at(s)
        return aim(blend @ self._stations, weights @ self._tangents)


class Spline(CurveModel[tuple[FloatArray, FloatArray, FloatArray]]):
    """Cubic spline through the tangents at the stations (the base, then the IMUs), component by component.

    At the base it is not-a-knot: the clamp says nothing of curvature, and a natural spline, which puts the tangent's
    second derivative to 0 there, leaves 0.51 / 0.42 % of arc length on a simulated passive arm where this leaves
    0.38 / 0.34 % (median, markers at 0.36 and 0.60 of 0.66 m). Past the last IMU the last cubic goes on to the tip,
    where its derivative is 0: a tip that carries no couple is not curved. With 8 IMUs all end conditions at the tip
    agree within 0.005 %; 0.12 m past the last of 6 IMUs this one leaves 0.4 % and not-a-knot 2.2 %.

    With one or two IMUs what is left is a parabola (a cantilever under a force at its tip, linear theory) or one cubic.
    Where the arm bends far from one station to the next the tangent between them is well short of unit length: on that
    arm with 2 IMUs this leaves 24 / 13 % and `pcc_exact` 8 / 10 %, with 4 it is 2.6 / 1.8 % against 3.4 / 3.4 %.

    The tangent is not scaled to unit length, so that positions stay linear in it. The links on the ROS graph have their
    full length: their chain tends to the curve of the same tangents at unit length, as 1/links², and at the tip of that
    arm with 8 IMUs this lies 0.25 mm from the spline (median; at most 2 mm).
    """

    name = 'spline'

    def __init__(self, layout: Layout, options: LinkOptions):
        super().__init__(layout, options)
        # Truncated powers of u = s / length: u⁰ … u³, and (u − knot)³ from every IMU on but the first and the last.
        stations = layout.stations / layout.arm.length
        knots = stations[2:-1]
        degree = min(3, len(stations))
        self._powers = np.array([*range(degree + 1), *[3] * len(knots)])
        self._starts = np.array([*[0.0] * (degree + 1), *knots])
        slope_at_tip = self._powers * (1.0 - self._starts) ** np.maximum(self._powers - 1, 0)
        conditions = np.vstack([self._past(stations) ** self._powers, slope_at_tip])
        values = np.eye(len(stations) + 1, len(stations))
        self._coefficients = np.linalg.solve(conditions, values)

    def _past(self, u: FloatArray) -> FloatArray:
        return np.maximum(u[:, None] - self._starts, 0.0)

    def _fit(self, measured: Measured) -> TangentSpline:
        return TangentSpline(self, measured.stations)

    def _precompute(self, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Weights of the stations' tangents in the position, m, and in the tangent, and of their quaternions in the
        orientation before it is aimed; (n, n_imu + 1) each.
        """
        section, fraction = self._sections(s)
        fraction = np.minimum(fraction, 1.0)
        past = self._past(s / self.layout.arm.length)
        values = past**self._powers
        integrals = self.layout.arm.length * past * values / (self._powers + 1)
        blend = np.zeros((len(s), len(self.layout.stations)))
        blend[np.arange(len(s)), section] = 1.0 - fraction
        blend[np.arange(len(s)), section + 1] = fraction
        return integrals @ self._coefficients, values @ self._coefficients, blend
