"""The field against magpylib and the elliptic integrals of a solenoid, its derivatives against differences."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ellipe, ellipk

from sesa2.sensing.magnetometry.axial_field import AxialField
from sesa2.sensing.magnetometry.ring_magnet import RingMagnet

PAPER = RingMagnet(0.006, 0.012, 0.006, 1.45)
DISC = RingMagnet(0.0, 0.010, 0.003, -1.2)
FIELD = AxialField(np.array([m.moments(13) for m in (PAPER, DISC)]), [m.sphere for m in (PAPER, DISC)])


@pytest.fixture
def points():
    """r and a of the two magnets for 200 points 20 to 80 mm away, some on the axis, some beside the magnet."""
    rng = np.random.default_rng(5)
    r, a = rng.normal(size=(2, 200, 2, 3))
    a /= np.linalg.norm(a, axis=-1, keepdims=True)
    r[:20] = a[:20] * rng.choice([-1.0, 1.0], (20, 2, 1))
    r[20:40] = np.cross(r[20:40], a[20:40])
    r *= rng.uniform(0.02, 0.08, (200, 2, 1)) / np.linalg.norm(r, axis=-1, keepdims=True)
    return r, a


def loop_field(radius, rho, z):
    """B_ρ and B_z of a circular current, per μ0 I (the elliptic form)."""
    alpha2, beta2 = (radius - rho) ** 2 + z * z, (radius + rho) ** 2 + z * z
    m = 1.0 - alpha2 / beta2
    E, K = ellipe(m), ellipk(m)
    common = 1.0 / (2.0 * np.pi * alpha2 * np.sqrt(beta2))
    b_rho = common * z / rho * ((radius**2 + rho**2 + z * z) * E - alpha2 * K) if rho else 0.0
    return b_rho, common * ((radius**2 - rho**2 - z * z) * E + alpha2 * K)


def ring_by_solenoids(magnet, rho, z):
    """Two solenoids of surface currents J / μ0: the outer one less the inner."""
    total = np.zeros(2)
    for sign, diameter in ((1.0, magnet.outer_diameter), (-1.0, magnet.inner_diameter)):
        for i in range(2):
            if diameter:
                total[i] += (
                    sign
                    * quad(
                        lambda h, i=i, d=diameter: loop_field(d / 2, rho, z - h)[i],
                        -magnet.height / 2,
                        magnet.height / 2,
                        epsrel=1e-12,
                    )[0]
                )
    return magnet.remanence * total


@pytest.mark.parametrize('magnet', [PAPER, DISC])
def test_against_the_elliptic_form(magnet):
    field = AxialField(magnet.moments(13)[None], [magnet.sphere])
    for rho, z in [(0.0, 0.03), (0.02, 0.0), (0.02, -0.03), (0.013, 0.055), (0.05, 0.04)]:
        ours = field.field(np.array([[rho, 0.0, z]]), np.array([[0.0, 0.0, 1.0]]))[0]
        b_rho, b_z = ring_by_solenoids(magnet, rho, z)
        np.testing.assert_allclose(ours, [b_rho, 0.0, b_z], rtol=2e-6, atol=1e-12)


def test_against_magpylib_in_any_frame(points):
    magpylib = pytest.importorskip('magpylib', reason='magpylib is not installed')
    r, a = points
    ours = FIELD.field(r, a)
    for i, magnet in enumerate((PAPER, DISC)):
        source = magpylib.magnet.CylinderSegment(
            polarization=(0, 0, magnet.remanence),
            dimension=(magnet.inner_diameter / 2, magnet.outer_diameter / 2, magnet.height, 0, 360),
        )
        for k in range(0, 200, 7):
            axis = a[k, i]
            x = np.cross(axis, [0.3, -0.5, 0.8])
            x /= np.linalg.norm(x)
            frame = np.stack([x, np.cross(axis, x), axis])  # B's components to the magnet's
            theirs = frame.T @ source.getB(frame @ r[k, i])
            np.testing.assert_allclose(ours[k, i], theirs, rtol=0.0, atol=1e-5 * np.linalg.norm(theirs))


def test_derivatives_against_differences_and_maxwell(points):
    r, a = points
    F, H, g, k, l = (f[..., None, None] for f in FIELD.factors(r, a))  # noqa: E741
    rr, ra = r[..., :, None] * r[..., None, :], r[..., :, None] * a[..., None, :]
    aa, ar, eye = a[..., :, None] * a[..., None, :], a[..., :, None] * r[..., None, :], np.eye(3)
    by_r = F * eye + g * rr + k * (ra + ar) - l * aa
    by_a = (k * r[..., :, None] - l * a[..., :, None]) * r[..., None, :] - H * eye
    size = np.abs(by_r).max(axis=(-1, -2))
    assert (np.abs(np.trace(by_r, axis1=-2, axis2=-1)) < 1e-12 * size).all()  # no sources
    steps = np.array([-3, -2, -1, 1, 2, 3])
    weights = np.array([-1, 9, -45, 45, -9, 1]) / 60.0
    h = 2e-5
    for i in range(3):
        shift = h * np.eye(3)[i]
        moved = sum(w * FIELD.field(r + s * shift, a) for w, s in zip(weights, steps, strict=True)) / h
        assert (np.abs(moved - by_r[..., i]).max(axis=-1) < 1e-8 * size).all()
        # An axis turns: a changes at right angles to itself.
        w = np.eye(3)[i]
        h_turn = 1e-2
        turned = (
            sum(c * FIELD.field(r, _rotated(a, s * h_turn * w)) for c, s in zip(weights, steps, strict=True))
            / h_turn
        )
        ours = np.einsum('...ij,...j->...i', by_a, np.cross(w, a))
        scale = np.abs(FIELD.field(r, a)).max(axis=-1, keepdims=True)
        assert (np.abs(turned - ours) < 1e-7 * np.maximum(scale, np.abs(ours))).all()


def _rotated(v, w):
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(w).apply(v.reshape(-1, 3)).reshape(v.shape)


def test_inside_the_sphere_nothing_runs_off():
    axis = np.array([[0.0, 0.0, 1.0]] * 2)
    for distance in (0.0, 1e-9, 1e-3, 5e-3):
        there = FIELD.field(distance * axis, axis)
        assert np.isfinite(there).all()
        assert np.abs(there).max() < 2.0
    assert all(np.isfinite(f).all() for f in FIELD.factors(0.0 * axis, axis))
