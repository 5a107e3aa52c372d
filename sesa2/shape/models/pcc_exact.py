"""Piecewise constant curvature in closed form: what `pcc` tends to as its links get shorter (thesis 3.2.2)."""

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.backbone import Backbone
from sesa2.shape.curve import CurveModel
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.options import LinkOptions
from sesa2.shape.rotations import (
    SMALL_ANGLE,
    FloatArray,
    SlerpPlaces,
    conjugate,
    cross,
    multiply,
    slerp_along,
    tangent,
    to_rotation_vector,
)


def arc(rotation: FloatArray, start: FloatArray) -> FloatArray:
    """Displacement along an arc of unit length whose cross-section turns at a constant rate.

    Thesis eq. 3.8, corrected: V(w) t₀ with V(w) = I + (1 − cos θ)/θ² [w]ₓ + (θ − sin θ)/θ³ [w]ₓ² and θ = |w|. It is
    the integral of exp(τ [w]ₓ) t₀ over τ from 0 to 1, twist included. As printed, 3.8 holds for pure tangent
    quaternions only and not for attitudes.

    Parameters
    ----------
    rotation : (..., 3)
        w, the rotation from start to end in world axes, rad.
    start : (..., 3)
        t₀, the unit tangent at the start.

    Returns
    -------
    (..., 3), displacement per length.
    """
    angle2 = np.einsum('...i,...i->...', rotation, rotation)
    angle = np.sqrt(angle2)
    small = (
        angle < 10.0 * SMALL_ANGLE
    )  # cancellation in θ − sin θ begins early; the series' next terms are below 1e-15
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5 - angle2 / 24.0 + angle2**2 / 720.0, (1.0 - np.cos(safe)) / safe**2)
    second = np.where(small, 1.0 / 6.0 - angle2 / 120.0 + angle2**2 / 5040.0, (safe - np.sin(safe)) / safe**3)
    once = cross(rotation, start)
    return start + first[..., None] * once + second[..., None] * cross(rotation, once)


class Arcs(Backbone):
    """Arcs from station to station; straight past the last IMU."""

    def __init__(self, model: 'PccExact', stations: FloatArray):
        self._model = model
        self._stations = stations
        self._tangents = tangent(stations)
        self._rotations = to_rotation_vector(multiply(stations[..., 1:, :], conjugate(stations[..., :-1, :])))
        steps = model.section_lengths[:, None] * arc(self._rotations, self._tangents[..., :-1, :])
        self._joints = np.zeros((*steps.shape[:-2], steps.shape[-2] + 1, 3))
        np.cumsum(steps, axis=-2, out=self._joints[..., 1:, :])

    def positions(self, s: ArrayLike) -> FloatArray:
        """See Backbone."""
        places, fraction, on_arc, past = self._model.at(s)
        section = places.section
        partial = arc(
            fraction[:, None] * self._rotations[..., section, :], self._tangents.take(section, axis=-2)
        )
        points = self._joints.take(section, axis=-2) + on_arc[:, None] * partial
        return points + past[:, None] * self._tangents[..., -1:, :] if past.any() else points

    def orientations(self, s: ArrayLike) -> FloatArray:
        """See Backbone. Slerp from station to station."""
        places, *_ = self._model.at(s)
        return slerp_along(self._stations, places)


class PccExact(CurveModel[tuple[SlerpPlaces, FloatArray, FloatArray, FloatArray]]):
    """Constant curvature (and twist) from station to station."""

    name = 'pcc_exact'

    def __init__(self, layout: Layout, options: LinkOptions):
        super().__init__(layout, options)
        self.section_lengths = np.diff(layout.stations)

    def _fit(self, measured: Measured) -> Arcs:
        return Arcs(self, measured.stations)

    def _precompute(self, s: FloatArray) -> tuple[SlerpPlaces, FloatArray, FloatArray, FloatArray]:
        """Places, fraction of the section (at most 1), length on the arc and length past the last IMU; each (n,)."""
        section, fraction = self._sections(s)
        fraction = np.minimum(fraction, 1.0)
        past = np.maximum(s - self.layout.imu_positions[-1], 0.0)
        return SlerpPlaces(section, fraction), fraction, fraction * self.section_lengths[section], past
