"""A pose of the arm to draw errors around."""

from dataclasses import dataclass

import numpy as np

from sesa2.evaluation.trajectory import EvaluationError
from sesa2.shape.rotations import FloatArray


@dataclass(frozen=True, eq=False)
class DrawnPose:
    """One pose of the arm.

    Attributes
    ----------
    arc_lengths : (k,)
        from the base, m, increasing.
    positions : (k, 3)
        x y z, m.
    """

    arc_lengths: FloatArray
    positions: FloatArray

    def __post_init__(self) -> None:
        s, p = np.array(self.arc_lengths, dtype=float), np.array(self.positions, dtype=float)
        if len(s) < 2 or p.shape != (len(s), 3) or not (np.diff(s) > 0.0).all() or not np.isfinite(p).all():
            raise EvaluationError(
                f'backbone with arc lengths {s.shape} and positions {p.shape}, expected (k,), increasing, and (k, 3), '
                f'finite, with at least two points'
            )
        object.__setattr__(self, 'arc_lengths', s)
        object.__setattr__(self, 'positions', p)

    def at(self, s: FloatArray) -> FloatArray:
        """Points at arc lengths (n,), m, between the given ones: (n, 3), m."""
        return np.stack([np.interp(s, self.arc_lengths, c) for c in self.positions.T], axis=-1)
