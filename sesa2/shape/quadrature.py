"""Integrals of what is smooth between the stations, from its values at fixed nodes."""

import numpy as np
from numpy.polynomial.legendre import leggauss, legint, legval, legvander

from sesa2.shape.rotations import FloatArray

# Panels are at most this fraction of the whole; Gauss's rule of so many nodes on each. For unit tangents of an arm that
# turns by 90° from one of two IMUs to the next this leaves 6 µm of 0.66 m.
_PANEL = 1.0 / 8.0
_NODES = 5


class PanelQuadrature:
    """Integrals up to any place of a function that is smooth between given places, from its values at fixed nodes.

    On each panel the function is the polynomial through its values at the nodes of Gauss's rule, which is integrated.

    Parameters
    ----------
    ends : (n,)
        increasing from 0: where the function need not be smooth, and the last place.

    Attributes
    ----------
    nodes : (n_nodes,)
        where its values are wanted.
    """

    def __init__(self, ends: FloatArray):
        counts = np.ceil(np.diff(ends) / _PANEL - 1e-9).astype(int)
        widths = np.repeat(np.diff(ends) / counts, counts)
        self._widths, self._starts = widths, np.cumsum(widths) - widths
        roots, _ = leggauss(_NODES)
        # A polynomial is a sum of Legendre's; its values at the nodes give their shares.
        self._shares = np.linalg.inv(legvander(roots, _NODES - 1))
        self.nodes = (self._starts[:, None] + 0.5 * widths[:, None] * (1.0 + roots)).ravel()

    def values(self, u: FloatArray) -> FloatArray:
        """Weights of the values at the nodes in the value at each place of u (n,); (n, n_nodes)."""
        panel = np.clip(np.searchsorted(self._starts, u, side='left') - 1, 0, None)
        within = 2.0 * (u - self._starts[panel]) / self._widths[panel] - 1.0
        weights = np.zeros((len(u), len(self._starts), _NODES))
        weights[np.arange(len(u)), panel] = legval(within, self._shares).T
        return weights.reshape(len(u), -1)

    def integrals(self, u: FloatArray) -> FloatArray:
        """Weights of the values at the nodes in the integral from 0 to each place of u (n,); (n, n_nodes)."""
        upto = np.clip((u[:, None] - self._starts) / self._widths, 0.0, 1.0)
        integral = legint(np.eye(_NODES), lbnd=-1.0)
        weights = legval(2.0 * upto - 1.0, integral @ self._shares)
        return (0.5 * self._widths * weights).transpose(1, 2, 0).reshape(len(u), -1)
