"""What a controller without feedback would leave of the way to the target, on a copy of the simulated arm."""

from collections.abc import Sequence

import numpy as np

from sesa2.control.reach import Reach
from sesa2.plant.simulated_arm import Plant
from sesa2.shape.rotations import FloatArray

_STEP_S = 0.01
# A process that was held up does not make up for more than so many steps.
_AT_ONCE = 20


class OpenLoop:
    """The arm as it was when the tip controller began, driven by the inverse of its geometry alone.

    Parameters
    ----------
    arm
        a copy of its own, which it moves.
    reach
        of the controller.
    order
        place of each of the arm's racks among the controller's backbones.
    length_rate
        fastest that a backbone is driven, m/s.
    now
        s, by any steady clock.
    """

    def __init__(self, arm: Plant, reach: Reach, order: Sequence[int], length_rate: float, now: float):
        self._arm, self._reach, self._order, self._rate = arm, reach, list(order), length_rate
        self._sent = arm.encoders
        self._at = now

    def advance(self, now: float, coordinates: FloatArray) -> None:
        """Let time pass on the way to the coordinates of the target, (3 m,), rad and m."""
        wanted = self._reach.backbone_lengths(coordinates)[self._order]
        n = int((now - self._at) / _STEP_S)
        self._at += n * _STEP_S
        for _ in range(min(n, _AT_ONCE)):
            way = wanted - self._sent
            fastest = float(np.abs(way).max())
            self._sent = self._sent + way * min(1.0, self._rate * _STEP_S / max(fastest, 1e-12))
            self._arm.step(self._sent, _STEP_S)

    @property
    def tip(self) -> FloatArray:
        """Where the tip truly is then, (3,), m in base_link."""
        return self._arm.tip
