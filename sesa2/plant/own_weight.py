"""How far the segments of an arm bend under its own weight."""

import numpy as np

from sesa2.plant.uneven_segments import UnevenSegments
from sesa2.shape.rotations import FloatArray, conjugate, cross, rotate

_BEGIN_MIDDLE_END = (0.0, 0.5, 1.0)


class OwnWeight:
    """Bends from the moments that the weight of each segment has about the middle of itself and of those before it.

    A segment of length L turns by M L / (E I). Its own weight W acts with a mean moment of W L / 6, as on a cantilever,
    whose tip turns by W L² / (6 E I); weights of others act at their middles. The weight is evenly spread over the
    arm at rest.

    Parameters
    ----------
    segment_lengths : (m,)
        at rest, m.
    sag
        how far the whole arm, straight, horizontal and at rest, would turn its tip as one cantilever, rad.
    base : (4,)
        q_WB, x y z w; the weight acts along −z of the world.
    """

    def __init__(self, segment_lengths: FloatArray, sag: float, base: FloatArray):
        m, total = len(segment_lengths), segment_lengths.sum()
        # Weight of each segment over the stiffness E I.
        self._weights = 6.0 * sag / total**2 * segment_lengths / total
        self._down = rotate(conjugate(base), (0.0, 0.0, -1.0))
        starts = np.cumsum(segment_lengths) - segment_lengths
        places = (starts[:, None] + segment_lengths[:, None] * _BEGIN_MIDDLE_END).ravel()
        places[-1] = total
        self._middles = UnevenSegments(segment_lengths, np.zeros(m), np.zeros(m), places)
        self._later = np.triu(np.ones((m, m)), k=1)

    def bends(self, bends: FloatArray, lengths: FloatArray) -> FloatArray:
        """What the weight adds to the bend of each segment where the arm has this shape.

        Parameters
        ----------
        bends, lengths : (m, 2), (m,)
            of the segments, rad and m.

        Returns
        -------
        (m, 2), bend_x, bend_y, rad.
        """
        positions, orientations = self._middles.poses(bends, lengths)
        begin, middle, end = positions.reshape(-1, 3, 3).transpose(1, 0, 2)
        beyond = (
            self._later @ (self._weights[:, None] * middle) - (self._later @ self._weights)[:, None] * middle
        )
        lever = self._weights[:, None] * (end - begin) / 6.0 + beyond
        moment = cross(lever, self._down)
        own = rotate(conjugate(orientations[1::3]), moment)
        return lengths[:, None] * np.stack([own[:, 1], -own[:, 0]], axis=-1)
