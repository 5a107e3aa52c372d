"""Ring and disc magnets: their multipole moments, and how near to them a series of these can be trusted."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from sesa2.shape.arm import GeometryError
from sesa2.shape.rotations import FloatArray

# Of the field, the worst that a series of moments may leave out: 0.02 µT of 1 mT.
TOLERANCE = 2e-5
# Orders beyond this lose digits to cancellation and cost more than they give.
HIGHEST_ORDER = 13
_TAIL = 61  # the highest order of the bound on what is left out


@dataclass(frozen=True)
class RingMagnet:
    """A ring, or a disc where the inner diameter is 0, magnetised along its axis; its position is its centre.

    Attributes
    ----------
    inner_diameter, outer_diameter, height
        m. Diameters, not radii.
    remanence
        magnetic polarisation, T; negative where the north pole looks towards the base.
    """

    inner_diameter: float
    outer_diameter: float
    height: float
    remanence: float

    def __post_init__(self) -> None:
        sizes = (self.inner_diameter, self.outer_diameter, self.height, self.remanence)
        if not (
            np.isfinite(sizes).all()
            and 0.0 <= self.inner_diameter < self.outer_diameter
            and self.height > 0.0
        ):
            raise GeometryError(
                f'a magnet with inner and outer diameter, height {sizes[:3]} m and remanence {sizes[3]} T, expected '
                'finite sizes, inner diameter at least 0 and less than the outer, height more than 0'
            )

    @property
    def sphere(self) -> float:
        """Radius of the sphere about its centre that holds it, m: inside, the series of moments diverges."""
        return 0.5 * float(np.hypot(self.outer_diameter, self.height))

    def moments(self, order: int) -> FloatArray:
        """Axial multipole moments of orders 1, 3, 5 … `order`; even ones vanish.

        The field outside is −∇ Σ c_n P_n(cos θ) / r^(n+1). The poles are two annuli of charge; a circle of charge at
        distance s, height a has s^n P_n(a/s), so c_n = J ∫ ρ s^n P_n(a/s) dρ, a polynomial in ρ² that Gauss' rule
        integrates exactly.

        Returns
        -------
        (n_orders,), T m^(n+2).
        """
        return self.remanence * _moments(self.inner_diameter, self.outer_diameter, self.height, order)

    @property
    def nearest(self) -> float:
        """Distance from its centre, m, nearer than which a series to HIGHEST_ORDER leaves out more than TOLERANCE."""
        return _nearest(self)

    def order_beyond(self, distance: float) -> int:
        """The lowest odd order whose series leaves out at most TOLERANCE of the field from a distance, m, onwards.

        Where none up to HIGHEST_ORDER does, that one.
        """
        left_out = _left_out(self, max(distance, 1.001 * self.sphere))
        good = np.flatnonzero(left_out <= TOLERANCE)
        return HIGHEST_ORDER if not len(good) else min(2 * int(good[0]) + 1, HIGHEST_ORDER)

    def left_out(self, order: int, distance: float) -> float:
        """At most how much of the field a series to an odd order leaves out, in parts of the dipole's least field."""
        return float(_left_out(self, max(distance, 1.001 * self.sphere))[(order - 1) // 2])


@lru_cache(maxsize=64)
def _moments(inner_diameter: float, outer_diameter: float, height: float, order: int) -> FloatArray:
    """Of a remanence of 1 T."""
    inner, outer, a = 0.5 * inner_diameter, 0.5 * outer_diameter, 0.5 * height
    n = np.arange(1, order + 1, 2)
    nodes, weights = legendre.leggauss(order // 4 + 2)
    square = 0.5 * (outer**2 + inner**2) + 0.5 * (outer**2 - inner**2) * nodes  # ρ², and ρ dρ is half of dρ²
    s = np.sqrt(square + a * a)
    along = legendre.legvander(a / s, order)[:, 1::2] * s[:, None] ** n
    moments: FloatArray = 0.25 * (outer**2 - inner**2) * (weights @ along)
    moments.setflags(write=False)
    return moments


def _left_out(magnet: RingMagnet, distance: float) -> FloatArray:
    """Of each order, 1, 3, 5 …: a bound of the field of all higher ones, in parts of the dipole's least field."""
    n = np.arange(1, _TAIL + 1, 2)
    # |B_n| ≤ |c_n| (n + 1) / r^(n+2): the worst of a zonal field is on the axis. The dipole's least is c_1 / r³.
    moments = np.abs(_moments(magnet.inner_diameter, magnet.outer_diameter, magnet.height, _TAIL))
    part = moments / moments[0] * (n + 1.0) / distance ** (n - 1.0)
    return np.append(np.cumsum(part[:0:-1])[::-1], 0.0)


@lru_cache(maxsize=64)
def _nearest(magnet: RingMagnet) -> float:
    at = (HIGHEST_ORDER - 1) // 2
    low, high = 1.001 * magnet.sphere, 20.0 * magnet.sphere
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _left_out(magnet, middle)[at] <= TOLERANCE else (middle, high)
    return high
