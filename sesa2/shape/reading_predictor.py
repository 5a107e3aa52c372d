"""What sensors read of a shape that coordinates describe: by physics, or as learnt."""

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.kinematics.coordinate_limits import CoordinateLimits
from sesa2.shape.rotations import IDENTITY, FloatArray


class Prediction(NamedTuple):
    """Predicted readings.

    Attributes
    ----------
    readings : batch + (n_readings,)
        in the unit of the sensors.
    jacobian : batch + (n_readings, n_coordinates)
        their derivatives by the coordinates.
    """

    readings: FloatArray
    jacobian: FloatArray


class ReadingPredictor(ABC):
    """Predicts all sensors' readings.

    Attributes
    ----------
    limits
        within which it predicts; `limits.kinematics` says what the coordinates are.
    names
        of the sensors, for messages.
    sensor_of : (n_readings,)
        index of the sensor that each reading is of.
    noise : (n_readings,)
        expected error of a reading, one standard deviation.
    largest
        magnitude at which a sensor saturates.
    doubts
        of what it predicts, for people.
    """

    limits: CoordinateLimits
    names: tuple[str, ...]
    sensor_of: np.ndarray
    noise: FloatArray
    largest: float
    doubts: tuple[str, ...] = ()

    @abstractmethod
    def predict(self, coordinates: FloatArray, base: ArrayLike = IDENTITY) -> Prediction:
        """Readings and their derivatives.

        Parameters
        ----------
        coordinates : batch + (n_coordinates,)
            rad and m, in the order of the kinematics' `coordinate_names`.
        base : (4,)
            or batch + (4,), q_WB, x y z w.
        """

    @abstractmethod
    def readings_of(self, measured: ArrayLike) -> FloatArray:
        """Readings, batch + (n_readings,), of what was measured, batch + (n_sensors, 3) in the sensors' own axes."""
