"""Points of the arm as readings: with them, coordinates are fitted to what motion capture sees."""

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.kinematics.coordinate_limits import CoordinateLimits
from sesa2.shape.reading_predictor import Prediction, ReadingPredictor
from sesa2.shape.rotations import IDENTITY, FloatArray, rotate, to_matrix


class PointPredictor(ReadingPredictor):
    """Positions of points on the backbone, origin at the clamp, turned with the base, m: x, y, z of each.

    Parameters
    ----------
    limits
        of the shapes.
    names
        of the points.
    positions : (n_points,)
        their material arc lengths, m.
    error
        expected error of a component, m, one standard deviation.
    """

    def __init__(self, limits: CoordinateLimits, names: tuple[str, ...], positions: ArrayLike, error: float):
        self.limits, self.names = limits, names
        self._positions = np.asarray(positions, dtype=float)
        self.sensor_of = np.repeat(np.arange(len(names)), 3)
        self.noise = np.full(len(self.sensor_of), error)
        self.largest = np.inf

    def predict(self, coordinates: FloatArray, base: ArrayLike = IDENTITY) -> Prediction:
        """See ReadingPredictor."""
        backbone = self.limits.kinematics.backbone(coordinates)
        base = np.asarray(base, dtype=float)[..., None, :]
        points = rotate(base, backbone.positions(self._positions))
        rates = to_matrix(base) @ backbone.jacobian(self._positions)[..., :3, :]
        return Prediction(
            points.reshape(*points.shape[:-2], -1), rates.reshape(*rates.shape[:-3], -1, rates.shape[-1])
        )

    def readings_of(self, measured: ArrayLike) -> FloatArray:
        """See ReadingPredictor; measured in m."""
        measured = np.asarray(measured, dtype=float)
        return measured.reshape(*measured.shape[:-2], -1)
