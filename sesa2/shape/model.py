"""What every shape model is: orientations in, a backbone out."""

from abc import ABC, abstractmethod
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.arm import Arm, GeometryError
from sesa2.shape.rotations import IDENTITY, FloatArray


class Backbone(ABC):
    """The arm's centre line, fitted to one set of orientations or to a batch of them.

    Positions are in world axes with their origin at the base, m; orientations are q_WL, x y z w. `batch` below is
    whatever leading shape the orientations had.
    """

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


class Model(ABC):
    """A shape model bound to an arm. What does not depend on the measurement is computed once, here.

    Attributes
    ----------
    name
        of the model, in the configuration and on the ROS graph.
    arm
        the arm.
    link_ends : (n_links + 1,)
        arc lengths at which the links that stand for the arm on the ROS graph begin and end, base to tip, m.
    link_middles : (n_links,)
        arc lengths at which the links take their orientation, m.
    """

    name: ClassVar[str]

    def __init__(self, arm: Arm, link_ends: ArrayLike):
        self.arm = arm
        self.link_ends = np.asarray(link_ends, dtype=float)
        self.link_middles = 0.5 * (self.link_ends[:-1] + self.link_ends[1:])
        self._cached = lru_cache(maxsize=16)(lambda key: self._precompute(np.frombuffer(key)))

    @property
    def n_links(self) -> int:
        """Number of links on the ROS graph."""
        return len(self.link_ends) - 1

    def fit(self, orientations: ArrayLike, base: ArrayLike = IDENTITY) -> Backbone:
        """Fit the backbone to measured orientations.

        Parameters
        ----------
        orientations : batch + (n_imu, 4)
            q_WL at the IMUs, x y z w, unit norm, any signs.
        base : (4,)
            or batch + (4,), q_WB, x y z w.

        Returns
        -------
        The backbone.

        Raises
        ------
        GeometryError
            the last two axes are not (n_imu, 4).
        """
        orientations, base = np.asarray(orientations, dtype=float), np.asarray(base, dtype=float)
        expected = (len(self.arm.imu_positions), 4)
        if orientations.shape[-2:] != expected:
            raise GeometryError(
                f'orientations of shape {orientations.shape}, expected (..., {expected[0]}, 4)'
            )
        return self._fit(orientations, base)

    @abstractmethod
    def _fit(self, orientations: FloatArray, base: FloatArray) -> Backbone: ...

    def at(self, s: ArrayLike):  # type: ignore[no-untyped-def]  # each model keeps what suits it
        """What the model keeps ready for these arc lengths; computed at the first call and kept."""
        return self._cached(np.ascontiguousarray(s, dtype=float).tobytes())

    @abstractmethod
    def _precompute(self, s: FloatArray): ...  # type: ignore[no-untyped-def]


def with_base(orientations: FloatArray, base: FloatArray) -> FloatArray:
    """Put the base's orientation before those of the IMUs.

    Parameters
    ----------
    orientations : batch + (n_imu, 4)
        .
    base : (4,)
        or batch + (4,).

    Returns
    -------
    batch + (n_imu + 1, 4).
    """
    *batch, n, _ = orientations.shape
    stations = np.empty((*batch, n + 1, 4))
    stations[..., 0, :] = base
    stations[..., 1:, :] = orientations
    return stations
