"""Moments against closed forms, and the bound of what a series leaves out against magpylib."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import eval_legendre

from sesa2.sensing.magnetometry.axial_field import AxialField
from sesa2.sensing.magnetometry.ring_magnet import HIGHEST_ORDER, TOLERANCE, RingMagnet
from sesa2.shape.arm import GeometryError

magpylib = pytest.importorskip('magpylib', reason='magpylib is not installed')

PAPER = RingMagnet(inner_diameter=0.006, outer_diameter=0.012, height=0.006, remanence=1.45)
SIMULATED = RingMagnet(0.012, 0.024, 0.006, 1.45)  # what the paper's Table 1 was computed with
DISC = RingMagnet(0.0, 0.010, 0.003, -1.2)
MAGNETS = [PAPER, SIMULATED, DISC]


def test_the_papers_magnet_on_its_axis():
    """0.694 mT at 55 mm: neither radii for diameters, nor a bottom for a centre, nor mT for T."""
    n = np.arange(1, HIGHEST_ORDER + 1, 2)
    at_55_mm = np.sum(PAPER.moments(HIGHEST_ORDER) * (n + 1) / 0.055 ** (n + 2.0))
    assert at_55_mm == pytest.approx(0.694e-3, abs=0.5e-6)
    n = np.arange(1, 18, 2)
    assert np.sum(SIMULATED.moments(17) * (n + 1) / 0.055 ** (n + 2.0)) == pytest.approx(2.60e-3, abs=5e-6)


@pytest.mark.parametrize('magnet', MAGNETS)
def test_the_first_moment_is_the_dipole(magnet):
    volume = np.pi / 4 * (magnet.outer_diameter**2 - magnet.inner_diameter**2) * magnet.height
    assert magnet.moments(1) == pytest.approx([magnet.remanence * volume / (4 * np.pi)], rel=1e-14)


@pytest.mark.parametrize('magnet', MAGNETS)
def test_moments_are_the_integral_over_the_poles(magnet):
    a = magnet.height / 2
    for i, c in enumerate(magnet.moments(13)):
        n = 2 * i + 1

        def circle(rho, n=n):
            s = np.hypot(rho, a)
            return magnet.remanence * rho * (s / 0.01) ** n * eval_legendre(n, a / s)

        there = quad(circle, magnet.inner_diameter / 2, magnet.outer_diameter / 2, epsabs=0.0, epsrel=1e-13)[
            0
        ]
        assert c / 0.01**n == pytest.approx(there, rel=1e-11, abs=1e-19)


def test_nearest_is_15_mm_for_the_papers_ring_and_grows_with_the_magnet():
    assert PAPER.nearest == pytest.approx(0.015, abs=2e-4)
    double = RingMagnet(0.012, 0.024, 0.012, 1.45)
    assert double.nearest == pytest.approx(2 * PAPER.nearest, rel=1e-9)
    assert RingMagnet(0.006, 0.012, 0.006, -0.3).nearest == pytest.approx(PAPER.nearest, rel=1e-9)


@pytest.mark.parametrize('magnet', MAGNETS)
@pytest.mark.parametrize('beyond', [1.0, 1.3, 2.0, 4.0])
def test_the_chosen_order_leaves_out_no_more_than_promised(magnet, beyond):
    distance = beyond * magnet.nearest
    order = magnet.order_beyond(distance)
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(400, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = distance * rng.uniform(1.0, 1.5, (400, 1)) * directions
    theirs = magpylib.magnet.CylinderSegment(
        polarization=(0, 0, magnet.remanence),
        dimension=(magnet.inner_diameter / 2, magnet.outer_diameter / 2, magnet.height, 0, 360),
    ).getB(points)
    axis = np.array([[0.0, 0.0, 1.0]])

    def worst(order):
        ours = AxialField(magnet.moments(order)[None], [magnet.sphere]).field(points[:, None], axis)[:, 0]
        return (np.linalg.norm(ours - theirs, axis=1) / np.linalg.norm(theirs, axis=1)).max()

    assert worst(order) < TOLERANCE
    assert order == 1 or worst(order - 2) > 0.1 * TOLERANCE  # nor is it far too high


def test_orders_grow_towards_the_magnet():
    orders = [PAPER.order_beyond(d) for d in (0.2, 0.1, 0.055, 0.03, 0.02, 0.0151)]
    assert orders == sorted(orders)
    assert orders[0] == 1 or orders[0] == 3
    assert orders[-1] == HIGHEST_ORDER
    assert PAPER.order_beyond(0.001) == HIGHEST_ORDER


@pytest.mark.parametrize(
    'sizes',
    [
        (0.012, 0.012, 0.006, 1.0),
        (-0.001, 0.01, 0.006, 1.0),
        (0.0, 0.01, 0.0, 1.0),
        (0.0, 0.01, 0.01, np.nan),
    ],
)
def test_magnets_that_cannot_be(sizes):
    with pytest.raises(GeometryError, match='inner diameter at least 0 and less than the outer'):
        RingMagnet(*sizes)
