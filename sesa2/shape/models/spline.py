"""A cubic spline through the tangents at the IMUs, at unit speed: an arm of continuous curvature (ours)."""

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.backbone import Backbone
from sesa2.shape.chain import in_blocks
from sesa2.shape.curve import CurveModel
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.options import LinkOptions
from sesa2.shape.quadrature import PanelQuadrature
from sesa2.shape.rotations import FloatArray, aim, of_one_sign, tangent

_SUM = np.ones((3, 1))


class TangentSpline(Backbone):
    """The curve of unit speed whose tangent points as the spline does."""

    def __init__(self, model: 'Spline', stations: FloatArray):
        self._model = model
        self._stations = of_one_sign(stations)
        self._tangents = tangent(stations)

    def positions(self, s: ArrayLike) -> FloatArray:
        """See Backbone. A weighted sum of the unit tangents at the model's nodes."""
        integrals, *_ = self._model.at(s)
        at_nodes = self._model.at_nodes

        def integrated(tangents: FloatArray) -> FloatArray:
            return integrals @ _unit(at_nodes @ tangents)

        return in_blocks(integrated, self._tangents, len(at_nodes))

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
    second derivative to 0 there, costs 0.1 % of arc length on a simulated passive arm where this leaves
    0.39 / 0.34 % (median, markers at 0.36 and 0.60 of 0.66 m). Past the last IMU the last cubic goes on to the tip,
    where its derivative is 0: a tip that carries no couple is not curved. With 8 IMUs all end conditions at the tip
    agree within 0.005 %; 0.12 m past the last of 6 IMUs this one leaves 0.4 % and not-a-knot 2.2 %.

    With one or two IMUs what is left is a parabola (a cantilever under a force at its tip, linear theory) or one cubic.

    The cubic only says where the tangent points. Where the arm bends far from one station to the next it is well short
    of unit length in between; it is scaled to unit length before it is integrated, so that the curve keeps the arm's
    length. Its values at fixed nodes are linear in the stations' tangents, and the integral in these once they are
    scaled: two matrix products. On that arm this leaves 2.1 / 1.2 % with 4 IMUs, unscaled 2.6 / 1.8 %. Two IMUs are too
    few for its bends: 22 / 13 % (`pcc_exact` 8 / 10 %).
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
        self._panels = PanelQuadrature(np.array([*stations, *([1.0] if stations[-1] < 1.0 else [])]))
        # Weights of the stations' tangents in the tangents at the nodes, (n_nodes, n_imu + 1).
        self.at_nodes = self._past(self._panels.nodes) ** self._powers @ self._coefficients

    def _past(self, u: FloatArray) -> FloatArray:
        return np.maximum(u[:, None] - self._starts, 0.0)

    def _fit(self, measured: Measured) -> TangentSpline:
        return TangentSpline(self, measured.stations)

    def _precompute(self, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Weights of the nodes' unit tangents in the position, m, (n, n_nodes); of the stations' tangents in the
        tangent, and of their quaternions in the orientation before it is aimed, (n, n_imu + 1) each.
        """
        section, fraction = self._sections(s)
        fraction = np.minimum(fraction, 1.0)
        u = s / self.layout.arm.length
        integrals = self.layout.arm.length * self._panels.integrals(u)
        blend = np.zeros((len(s), len(self.layout.stations)))
        blend[np.arange(len(s)), section] = 1.0 - fraction
        blend[np.arange(len(s)), section + 1] = fraction
        return integrals, self._past(u) ** self._powers @ self._coefficients, blend


def _unit(vectors: FloatArray) -> FloatArray:
    """Scale vectors (..., 3) to unit length, in place; one of length zero stays."""
    length = (vectors * vectors) @ _SUM  # half of what einsum takes for a single sweep
    length += 1e-300
    np.sqrt(length, out=length)
    vectors /= length
    return vectors
