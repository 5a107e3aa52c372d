"""The arm as the models see it, without any sensor."""

from dataclasses import dataclass

import numpy as np

from sesa2.errors import Sesa2Error
from sesa2.shape.rotations import FloatArray


class GeometryError(Sesa2Error):
    """An arm, a link, a sensor's place or an arc length that cannot be."""


@dataclass(frozen=True)
class Arm:
    """An arm clamped at its base, arc length 0.

    Arc length *s* is that of the arm at rest: it names a point of the material and stays with it where the arm
    stretches.

    Attributes
    ----------
    length
        arc length of the tip, m.
    """

    length: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.length) and self.length > 0.0):
            raise GeometryError(f'length = {self.length} m, expected a positive number')

    def check_on_arm(self, s: FloatArray) -> None:
        """Refuse arc lengths that are not on the arm.

        Parameters
        ----------
        s : (n,)
            m.

        Raises
        ------
        GeometryError
            one is negative, beyond the tip or not a number.
        """
        outside = ~((s >= 0.0) & (s <= self.length * (1.0 + 1e-12)))
        if outside.any():
            raise GeometryError(f'arc length {s[outside][0]} m is not on the arm, 0 to {self.length} m')
