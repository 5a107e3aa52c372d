"""The field of magnets that are symmetric about their axis, and how it changes with where and how they stand."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Legendre, Polynomial

from sesa2.shape.rotations import FloatArray


class FieldFactors(NamedTuple):
    """Numbers that make the field and its derivatives from the vectors r, magnet to point, and a, along the axis.

    B = F r − H a;  ∂B/∂r = F I + g r rᵀ + k (r aᵀ + a rᵀ) − l a aᵀ;  ∂B/∂a = (k r − l a) rᵀ − H I.

    Nothing here needs a frame of the magnet's own, and on the axis nothing is singular.
    """

    F: FloatArray
    H: FloatArray
    g: FloatArray
    k: FloatArray
    l: FloatArray  # noqa: E741


class AxialField:
    """Fields of magnets by their odd axial moments.

    With u = cos θ, from B = −∇ Σ c_n P_n(u) / r^(n+1) and P′_{n+1} − u P′_n = (n + 1) P_n follow

    F = Σ c_n P′_{n+1} / r^(n+3), H = Σ c_n P′_n / r^(n+2), g = −Σ c_n P″_{n+2} / r^(n+5),
    k = Σ c_n P″_{n+1} / r^(n+4), l = Σ c_n P″_n / r^(n+3).

    Parameters
    ----------
    moments : (n_magnets, n_orders)
        of orders 1, 3, 5 …, T m^(n+2).
    spheres : (n_magnets,)
        m; inside this radius the series diverges: there the factors are those at it.
    """

    def __init__(self, moments: FloatArray, spheres: FloatArray):
        self._moments = np.asarray(moments, dtype=float)
        self._spheres = np.asarray(spheres, dtype=float)
        self._table = _table(self._moments.shape[1])

    def factors(self, r: FloatArray, a: FloatArray) -> FieldFactors:
        """See FieldFactors.

        Parameters
        ----------
        r : (..., n_magnets, 3)
            from each magnet's centre to the point, m.
        a : (..., n_magnets, 3)
            unit vector along each magnet's axis, in the same frame.

        Returns
        -------
        Five of (..., n_magnets).
        """
        n_orders = self._moments.shape[1]
        distance = np.maximum(np.sqrt(np.einsum('...i,...i->...', r, r)), self._spheres)
        u = np.einsum('...i,...i->...', r, a) / distance
        inverse = 1.0 / distance
        # Each factor is u^(0 or 1) r^-k times a polynomial in 1/r² and u²: all five in one product.
        weighted = self._moments * _powers(inverse * inverse, n_orders)
        terms = weighted[..., :, None] * _powers(u * u, n_orders + 1)[..., None, :]
        sums = terms.reshape(*u.shape, -1) @ self._table
        cube = inverse * inverse * inverse
        fourth = cube * inverse
        odd = u * fourth
        return FieldFactors(
            F=odd * sums[..., 0],
            H=cube * sums[..., 1],
            g=-odd * inverse * inverse * sums[..., 2],
            k=fourth * inverse * sums[..., 3],
            l=odd * sums[..., 4],
        )

    def field(self, r: FloatArray, a: FloatArray) -> FloatArray:
        """Field of each magnet at points, (..., n_magnets, 3), T; parameters as of `factors`."""
        F, H, *_ = self.factors(r, a)
        return F[..., None] * r - H[..., None] * a


def _powers(x: FloatArray, n: int) -> FloatArray:
    out = np.empty((*x.shape, n))
    out[..., 0] = 1.0
    for i in range(1, n):
        np.multiply(out[..., i - 1], x, out=out[..., i])
    return out


@lru_cache(maxsize=16)
def _table(n_orders: int) -> FloatArray:
    """Coefficients of the five polynomials, (n_orders · (n_orders + 1), 5): by powers of 1/r², then of u²."""
    table = np.zeros((n_orders, n_orders + 1, 5))
    for i in range(n_orders):
        n = 2 * i + 1
        for j, (degree, times) in enumerate([(n + 1, 1), (n, 1), (n + 2, 2), (n + 1, 2), (n, 2)]):
            own = Legendre.basis(degree).convert(kind=Polynomial).deriv(times).coef[(degree - times) % 2 :: 2]
            table[i, : len(own), j] = own
    flat = table.reshape(-1, 5)
    flat.setflags(write=False)
    return flat
