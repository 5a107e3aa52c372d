"""Which ways of bending or stretching the sensors do not tell."""

from typing import NamedTuple

import numpy as np

from sesa2.shape.rotations import FloatArray

# Where readings leave more than this part of what was unknown before, they do not tell.
UNTOLD = 0.5


class UntoldDirection(NamedTuple):
    """A direction in the space of coordinates that readings do not tell.

    Attributes
    ----------
    left
        standard deviation along it after the readings, over that before.
    direction : (n_coordinates,)
        unit vector in coordinates over their scales.
    names
        the coordinates that have the most of it, the first first.
    """

    left: float
    direction: FloatArray
    names: tuple[str, ...]


def untold_directions(information: FloatArray, names: tuple[str, ...]) -> list[UntoldDirection]:
    """What readings do not tell, the least told first.

    Parameters
    ----------
    information : (n, n)
        with the prior's, which is the identity, in coordinates over their scales: `FittedCoordinates.information`.
    names
        of the coordinates.
    """
    values, vectors = np.linalg.eigh(information)
    found = []
    for value, vector in zip(values, vectors.T, strict=True):
        left = 1.0 / np.sqrt(max(value, 1.0))
        if left <= UNTOLD:
            break
        order = np.argsort(-np.abs(vector))
        much = [names[i] for i in order if abs(vector[i]) > 0.5 * abs(vector[order[0]])]
        found.append(UntoldDirection(float(left), vector, tuple(much)))
    return found
