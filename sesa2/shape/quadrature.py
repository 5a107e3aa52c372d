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
        self._roots, _ = leggauss(_NODES)
        self.nodes = (self._starts[:, None] + 0.5 * widths[:, None] * (1.0 + self._roots)).ravel()

    def integrals(self, u: FloatArray) -> FloatArray:
        """Weights of the values at the nodes in the integral from 0 to each place of u (n,); (n, n_nodes)."""
        upto = np.clip((u[:, None] - self._starts) / self._widths, 0.0, 1.0)
        # A polynomial is a sum of Legendre's, whose integrals are known; its values at the nodes give their shares.
        integral = legint(np.eye(_NODES), lbnd=-1.0)
        shares = np.linalg.inv(legvander(self._roots, _NODES - 1))
        weights = legval(2.0 * upto - 1.0, integral @ shares)
        return (0.5 * self._widths * weights).transpose(1, 2, 0).reshape(len(u), -1)
