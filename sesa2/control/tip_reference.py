"""Where the tip should be by now: led to its target at a speed, so that a jump of the target is none of the command."""

import numpy as np

from sesa2.shape.rotations import FloatArray

# By which an arm on motors follows, s: what has not arrived yet is no error.
LAG_S = 0.15


class TipReference:
    """A point that runs to the target at no more than a speed, and the same as it comes through the arm's lag.

    Attributes
    ----------
    position : (3,)
        in B, m.
    velocity : (3,)
        m/s.
    expected : (3,)
        where the tip is by now if it follows with LAG_S, m.
    """

    def __init__(self, speed: float):
        self._speed = speed
        self.reset(np.zeros(3))

    def reset(self, position: FloatArray) -> None:
        """Begin here, at rest."""
        self.position = np.array(position, dtype=float)
        self.expected = self.position.copy()
        self.velocity = np.zeros(3)

    def advance(self, target: FloatArray, dt: float) -> None:
        """Let time pass, s."""
        away = target - self.position
        distance = float(np.linalg.norm(away))
        step = away * min(1.0, self._speed * dt / distance) if distance > 0.0 else away
        self.position = self.position + step
        self.velocity = step / dt
        self.expected = self.expected + (1.0 - np.exp(-dt / LAG_S)) * (self.position - self.expected)
