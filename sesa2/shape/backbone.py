"""What every shape model gives: the arm's centre line."""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.rotations import FloatArray


class Backbone(ABC):
    """The arm's centre line, fitted to one set of orientations or to a batch of them.

    Arc lengths are material: a place keeps its own where the arm stretches. Positions are in world axes with their
    origin at the base, m; orientations are q_WL, x y z w. `batch` below is whatever leading shape the orientations had.

    Attributes
    ----------
    fallen_back
        how many of the batch its model could not solve and gave the shape of another, which it names.
    lengths : batch + (n_segments,)
        present lengths of the segments, m; None: those at rest.
    lost : batch
        of which instants there is no shape: positions and orientations are NaN; None: of none.
    coordinates : batch + (n_coordinates,)
        in the order of its model's `coordinate_names`; None where the shape has none.
    twists : batch + (n_segments,)
        twist that each segment was measured to have and its shape has not, rad; None where that is not told.
    """

    fallen_back: int = 0
    lengths: FloatArray | None = None
    lost: np.ndarray | None = None
    coordinates: FloatArray | None = None
    twists: FloatArray | None = None

    @abstractmethod
    def positions(self, s: ArrayLike) -> FloatArray:
        """Points of the backbone.

        Parameters
        ----------
        s : (n,)
            arc lengths from the base, m.

        Returns
        -------
        batch + (n, 3), m.

        Raises
        ------
        GeometryError
            an arc length is not on the arm.
        """

    @abstractmethod
    def orientations(self, s: ArrayLike) -> FloatArray:
        """Orientations of the cross-sections.

        Parameters
        ----------
        s : (n,)
            arc lengths from the base, m.

        Returns
        -------
        batch + (n, 4), q_WL, x y z w.

        Raises
        ------
        GeometryError
            an arc length is not on the arm.
        """
