"""A backbone of straight links, as the rigid and the PCC-extended model have it."""

import math
from abc import abstractmethod
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from sesa2.shape.backbone import Backbone
from sesa2.shape.measured import Measured
from sesa2.shape.model import Model
from sesa2.shape.rotations import FloatArray, tangent

# So many links at a time: their quaternions take 128 kB. Arrays of this size stay in the processor's cache, and malloc
# hands them out again; larger ones are mapped anew for every operation, and a large batch takes twice as long.
_BLOCK = 4000


class Chain(Backbone):
    """Straight links, one after the other (paper eq. 2 and 5)."""

    def __init__(self, model: 'ChainModel', link_orientations: FloatArray):
        self._model = model
        self._link_orientations = link_orientations

    def positions(self, s: ArrayLike) -> FloatArray:
        """See Backbone. Linear in the links' tangents."""
        lengths, _ = self._model.at(s)
        return in_blocks(lambda links: lengths @ tangent(links), self._link_orientations, self._model.n_links)

    def orientations(self, s: ArrayLike) -> FloatArray:
        """See Backbone. At a joint, that of the link which ends there."""
        _, link = self._model.at(s)
        return self._link_orientations.take(link, axis=-2)


def in_blocks(function: Callable[[FloatArray], FloatArray], stations: FloatArray, links: int) -> FloatArray:
    """Work through a batch block by block.

    Parameters
    ----------
    function
        of a batch, which gives for each member what it gives for this member alone.
    stations : batch + (n, k)
        what it is called with.
    links
        how many it makes of each member.

    Returns
    -------
    function(stations).
    """
    *batch, n, k = stations.shape
    size = max(1, _BLOCK // links)
    members = math.prod(batch)
    if members <= size:
        return function(stations)
    flat = stations.reshape(members, n, k)
    first = function(flat[:size])
    out = np.empty((members, *first.shape[1:]))
    out[:size] = first
    for i in range(size, members, size):
        out[i : i + size] = function(flat[i : i + size])
    return out.reshape(*batch, *out.shape[1:])


class ChainModel(Model[tuple[FloatArray, np.ndarray]]):
    """A model whose backbone is a chain: it only has to say how its links are oriented."""

    def _set_link_ends(self, link_ends: ArrayLike) -> None:
        self._chain_ends = np.asarray(link_ends, dtype=float)  # on the graph a link may be cut
        super()._set_link_ends(link_ends)

    def _fit(self, measured: Measured) -> Chain:
        return Chain(self, in_blocks(self._orient_links, measured.stations, self.n_links))

    @abstractmethod
    def _orient_links(self, stations: FloatArray) -> FloatArray:
        """Orientations of the links, batch + (links, 4), from those of base and IMUs, batch + (n_imu + 1, 4)."""

    def _precompute(self, s: FloatArray) -> tuple[FloatArray, np.ndarray]:
        """Length of each link that lies before s, (n, links), and the link that s is on, (n,)."""
        starts, lengths = self._chain_ends[:-1], np.diff(self._chain_ends)
        link = np.searchsorted(self._chain_ends[1:-1], s, side='left')
        return np.clip(s[:, None] - starts, 0.0, lengths), link
