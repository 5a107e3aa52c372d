"""A backbone of straight links, as the rigid and the PCC-extended model have it."""

from abc import abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.measured import Measured
from sesa2.shape.model import Backbone, Model
from sesa2.shape.rotations import FloatArray, tangent


class Chain(Backbone):
    """Straight links, one after the other (paper eq. 2 and 5)."""

    def __init__(self, model: 'ChainModel', link_orientations: FloatArray):
        self._model = model
        self._link_orientations = link_orientations
        self._tangents = tangent(link_orientations)

    def positions(self, s: ArrayLike) -> FloatArray:
        """See Backbone. Linear in the links' tangents."""
        lengths, _ = self._model.at(s)
        return lengths @ self._tangents

    def orientations(self, s: ArrayLike) -> FloatArray:
        """See Backbone. At a joint, that of the link which ends there."""
        _, link = self._model.at(s)
        return self._link_orientations.take(link, axis=-2)


class ChainModel(Model[tuple[FloatArray, np.ndarray]]):
    """A model whose backbone is a chain: it only has to say how its links are oriented."""

    def _fit(self, measured: Measured) -> Chain:
        return Chain(self, self._orient_links(measured.stations))

    @abstractmethod
    def _orient_links(self, stations: FloatArray) -> FloatArray:
        """Orientations of the links, batch + (n_links, 4), from those of base and IMUs, batch + (n_imu + 1, 4)."""

    def _precompute(self, s: FloatArray) -> tuple[FloatArray, np.ndarray]:
        """Length of each link that lies before s, (n, n_links), and the link that s is on, (n,)."""
        starts, lengths = self.link_ends[:-1], np.diff(self.link_ends)
        link = np.searchsorted(self.link_ends[1:-1], s, side='left')
        return np.clip(s[:, None] - starts, 0.0, lengths), link
