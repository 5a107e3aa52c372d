"""A growing arm of one segment, made point by point: racks that slip, a curvature that changes along it, IMUs askew.

Its tip is integrated here, by six-point Gauss, and owes nothing to the package.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from sesa2.bags.recorded_sweeps import RecordedSweeps
from sesa2.configuration import validate
from sesa2.evaluation.trajectory import Trajectory

T0_NS = 1_700_000_000 * 10**9
ANGLES, RADIUS, REST = np.array([0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0]), 0.03, 0.16
AFFINE, SLIP = 0.35, (0.25, 0.08, 0.006)
MOUNT, HEADING = np.deg2rad([1.4, -1.1, 0.0]), np.deg2rad(6.0)


class Made(NamedTuple):
    """What was measured at some poses, and where the tip was."""

    sweeps: RecordedSweeps
    truth: Trajectory


def configuration(racks=True, **more):
    lengths = {'names': ['b1', 'b2', 'b3'], 'angles': ANGLES.tolist(), 'radii': [RADIUS]} if racks else {}
    return validate(
        {
            'arm': {'length': REST},
            'segments': {'lengths': [REST], 'stretch': [0.7, 1.6]},
            'lengths': lengths or {'names': ['string']},
            'imus': {'ids': [1], 'positions': [REST]},
            'markers': {'names': ['tip'], 'positions': [REST]},
            'models': ['pcc_delta'],
            'pcc_delta': {'twist': 'heading'},
        }
        | more
    )


def tips(bend, length, affine):
    x, weights = np.polynomial.legendre.leggauss(6)
    u = 0.5 * (x + 1.0)
    theta = np.linalg.norm(bend, axis=-1, keepdims=True)
    angle = theta * (u + affine * u * (1.0 - u))
    aside, along = 0.5 * np.sin(angle) @ weights, 0.5 * np.cos(angle) @ weights
    return length[:, None] * np.concatenate([aside[:, None] * bend / theta, along[:, None]], axis=-1)


def made(n, seed, *, racks=True, scale=1.04, offset=-0.005, noise=1e-3, spacing=2.0, base_mount=None):
    """n poses of an arm that bends by up to 1.3 rad and is 0.13 to 0.24 m long.

    With `base_mount`, a rotation vector, the base moves, too, and an IMU on it is askew by that.
    """
    rng = np.random.default_rng(seed)
    bend = rng.uniform(-0.9, 0.9, (n, 2))
    length = rng.uniform(0.13, 0.24, n)
    q = Rotation.from_rotvec(np.stack([-bend[:, 1], bend[:, 0], np.zeros(n)], axis=-1))
    # The IMU: askew in its link, its heading off, and white noise.
    moved = Rotation.from_rotvec(0.3 * rng.normal(size=(n, 3)) * (base_mount is not None))
    seen = Rotation.from_rotvec([0.0, 0.0, HEADING]) * moved * q * Rotation.from_rotvec(MOUNT)
    seen = seen * Rotation.from_rotvec(np.deg2rad(0.2) * rng.normal(size=(n, 3)))
    if racks:
        # They bend more than the arm does, and say it too long.
        more = rng.uniform(1.1, 1.7, n)
        theta = np.linalg.norm(bend, axis=-1)
        said = (length + SLIP[0] * (more - 1.0) * theta * RADIUS - SLIP[1] * REST + SLIP[2]) / (1.0 - SLIP[1])
        directions = np.stack([np.cos(ANGLES), np.sin(ANGLES)])
        said = said[:, None] - RADIUS * (more[:, None] * bend) @ directions
    else:
        said = ((length - offset) / scale)[:, None]
    said = said + 2e-4 * rng.normal(size=said.shape)
    stamps = T0_NS + (np.arange(n) * spacing * 1e9).astype(np.int64)
    base = (moved * Rotation.from_rotvec([0.0, 0.0, 0.0] if base_mount is None else base_mount)).as_quat()
    sweeps = RecordedSweeps(stamps, seen.as_quat()[:, None], np.ones((n, 1), bool), base, said, [])
    points = tips(bend, length, AFFINE) + noise * rng.normal(size=(n, 3))
    return Made(sweeps, Trajectory(stamps / 1e9, points[:, None], ('tip',)))
