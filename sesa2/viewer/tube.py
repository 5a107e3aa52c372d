"""The arm's skin: a tube about the backbone as a triangle mesh."""

import numpy as np

from sesa2.shape.rotations import FloatArray, cross, rotate

SIDES = 16
_BAR_EVERY = 4  # sides, of a cage
_ROUND = 2.0 * np.pi * np.arange(SIDES) / SIDES
_COSINE, _SINE = np.cos(_ROUND)[:, None], np.sin(_ROUND)[:, None]
_X, _Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def tube_vertices(backbone: FloatArray, radius: float) -> FloatArray:
    """Points of the skin: a ring about each point of the backbone, mitred at joints, and the middle of both lids.

    Parameters
    ----------
    backbone : (n, 7)
        positions, m, and orientations x y z w, whose x axis says where each ring begins.
    radius
        m.

    Returns
    -------
    (n · SIDES + 2, 3), m.
    """
    points = backbone[:, :3]
    steps = _unit(np.diff(points, axis=0))
    along = _unit(np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]]))
    first = cross(rotate(backbone[:, 3:], _Y), along)
    # A truth from elsewhere may carry any orientation: where its y axis lies along the arm, its x axis does not.
    lost = np.einsum('ni,ni->n', first, first) < 1e-6
    if lost.any():
        first[lost] = cross(rotate(backbone[lost, 3:], _X), along[lost])
    first = _unit(first)
    second = cross(along, first)
    rings = points[:, None, :] + radius * (_COSINE * first[:, None, :] + _SINE * second[:, None, :])
    return np.concatenate([rings.reshape(-1, 3), points[:1], points[-1:]])


def _unit(v: FloatArray) -> FloatArray:
    """Unit vectors; zero stays zero, since one NaN would take the whole mesh away."""
    norm = np.sqrt(np.einsum('ni,ni->n', v, v))
    return v / np.where(norm > 0.0, norm, 1.0)[:, None]


def tube_faces(n: int, cage: bool = False) -> np.ndarray:
    """Triangles of a tube about n points.

    Parameters
    ----------
    n
        number of points.
    cage
        only bars along the arm, so that one sees what is inside.

    Returns
    -------
    (n_triangles, 3), indices into the vertices, counter-clockwise from outside.
    """
    side = np.arange(0, SIDES, _BAR_EVERY if cage else 1)
    after = (side + 1) % SIDES
    ring = SIDES * np.arange(n - 1)[:, None]
    a, b = ring + side, ring + after
    c, d = a + SIDES, b + SIDES
    walls = np.concatenate([np.stack([a, b, d], axis=-1), np.stack([a, d, c], axis=-1)]).reshape(-1, 3)
    if cage:
        return walls
    last = SIDES * (n - 1)
    bottom = np.stack([after, side, np.full(SIDES, SIDES * n)], axis=-1)
    top = np.stack([last + side, last + after, np.full(SIDES, SIDES * n + 1)], axis=-1)
    return np.concatenate([walls, bottom, top])
