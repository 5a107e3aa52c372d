"""A soft arm that moves, and what IMUs with a BNO055's errors would measure on it."""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from sesa2.shape.arm import Arm
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.rotations import IDENTITY, from_rotation_vector, multiply, tangent

RATE = 20.0
FINE = 66


class Motion(NamedTuple):
    layout: Arm
    stamps: np.ndarray  # s
    links: np.ndarray  # (n, n_imu, 4), true q_WL
    base: np.ndarray  # (4,)
    tip: np.ndarray  # (n, 3), m


def moving_arm(
    rng, n_imu=8, seconds=100.0, bend=1.2, twist=0.0, base=IDENTITY, length=0.66, sizes=(1.0, 0.6, 0.3)
):
    """Smooth modes of bending that vanish at the tip, each a random function of time; `bend` rad rms in all.

    `sizes` of the modes, that of the longest wave first.
    """
    n = int(seconds * RATE)
    at = np.arange(1, n_imu + 1) * (FINE - 4) // n_imu
    u = (np.arange(FINE) + 0.5) / FINE
    modes = np.cos(np.outer(np.arange(len(sizes)) + 0.5, np.pi * u))

    def wave(*shape):
        w = gaussian_filter1d(rng.normal(size=(n, *shape)), RATE * 0.7, axis=0)
        return w / w.std(axis=0)

    curvature = np.zeros((n, FINE, 3))
    curvature[..., :2] = bend * np.einsum(
        'tma,mf->tfa', wave(len(sizes), 2) * np.array(sizes)[:, None], modes
    )
    curvature[..., 2] = twist * wave(1)  # constant along an arm that bears no couple but at its ends
    turns = from_rotation_vector(curvature / FINE)
    q = np.empty((n, FINE + 1, 4))
    q[:, 0] = base
    for k in range(FINE):
        q[:, k + 1] = multiply(q[:, k], turns[:, k])
    middles = multiply(q[:, :-1], from_rotation_vector(0.5 * curvature / FINE))
    layout = Layout(Arm(length), tuple(length * at / FINE))
    return Motion(
        layout, np.arange(n) / RATE, q[:, at], np.asarray(base), tangent(middles).sum(axis=1) * length / FINE
    )


class Errors(NamedTuple):
    mounting: np.ndarray  # (n_imu, 3), rad
    heading: np.ndarray  # (n, n_imu), rad


def wander(rng, n, std, seconds, n_imu):
    """Ornstein–Uhlenbeck process."""
    kept = np.exp(-1.0 / RATE / seconds)
    x = np.empty((n, n_imu))
    x[0] = rng.normal(size=n_imu)
    for i in range(1, n):
        x[i] = kept * x[i - 1] + np.sqrt(1.0 - kept**2) * rng.normal(size=n_imu)
    return np.deg2rad(std) * x


def measure(rng, links, mounting=1.0, heading=2.0, drift=2.0, tilt=0.8, white=0.2):
    """Orientations as measured, (n, n_imu, 4), and the errors that were put in; standard deviations in degrees."""
    n, n_imu = links.shape[:2]
    mount = np.deg2rad(mounting) * rng.normal(size=(n_imu, 3))
    turn = np.zeros((n, n_imu, 3))
    turn[..., 2] = np.deg2rad(heading) * rng.normal(size=n_imu) + wander(rng, n, drift, 60.0, n_imu)
    lean = np.stack(
        [wander(rng, n, tilt, 20.0, n_imu), wander(rng, n, tilt, 20.0, n_imu), 0.0 * turn[..., 0]], -1
    )
    q = multiply(from_rotation_vector(turn), multiply(from_rotation_vector(lean), links))
    q = multiply(q, from_rotation_vector(mount))
    noise = np.deg2rad(white) * rng.normal(size=(n, n_imu, 3))
    return multiply(q, from_rotation_vector(noise)), Errors(mount, turn[..., 2])


def rms_degrees(a, b):
    """Root mean square angle between rotations."""
    a, b = Rotation.from_quat(a.reshape(-1, 4)), Rotation.from_quat(b.reshape(-1, 4))
    return np.rad2deg(np.sqrt(np.mean((a.inv() * b).magnitude() ** 2)))


def tip_error(model, links, motion):
    """Median, in per cent of the arm's length."""
    tips = model.fit(Measured(links, motion.base)).positions([motion.layout.arm.length])[:, 0]
    return 100.0 * np.median(np.linalg.norm(tips - motion.tip, axis=1)) / motion.layout.arm.length
