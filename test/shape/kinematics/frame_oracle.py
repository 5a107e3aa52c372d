"""Poses and Jacobians by other means than the package's: the frame's differential equation and differences."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation


def along(curvature, length, fractions):
    """Position and matrix at fractions of one segment, then at its end: R′ = R [Ω]ₓ, p′ = length · R e_z, by scipy."""

    def rate(v, y):
        kx, ky = curvature(v)
        hat = np.array([[0.0, 0.0, kx], [0.0, 0.0, ky], [-kx, -ky, 0.0]])
        R = y[3:].reshape(3, 3)
        return np.concatenate([length * R[:, 2], (R @ hat).ravel()])

    y0 = np.concatenate([np.zeros(3), np.eye(3).ravel()])
    at, inverse = np.unique([*fractions, 1.0], return_inverse=True)
    found = solve_ivp(rate, (0.0, 1.0), y0, method='DOP853', rtol=1e-12, atol=1e-14, t_eval=at).y.T[inverse]
    return found[:, :3], found[:, 3:].reshape(-1, 3, 3)


def chain(curvatures, lengths, sections, fractions):
    """Position and matrix at places (segment, fraction), segments in a chain."""
    start, turn = np.zeros(3), np.eye(3)
    p, R = np.empty((len(sections), 3)), np.empty((len(sections), 3, 3))
    for k, (curvature, length) in enumerate(zip(curvatures, lengths, strict=True)):
        own = np.flatnonzero(np.asarray(sections) == k)
        local, frames = along(curvature, length, np.asarray(fractions)[own])
        p[own] = start + local[:-1] @ turn.T
        R[own] = turn @ frames[:-1]
        start, turn = start + turn @ local[-1], turn @ frames[-1]
    return p, R


def differences(kinematics, q, s, step=2e-3):
    """The Jacobian by central differences, extrapolated to the sixth order; turns by scipy's logarithm."""

    def central(h):
        columns = []
        for c in range(kinematics.n_coordinates):
            move = np.zeros(kinematics.n_coordinates)
            move[c] = h
            plus, minus = kinematics.backbone(q + move), kinematics.backbone(q - move)
            dp = plus.positions(s) - minus.positions(s)
            after, before = (Rotation.from_quat(b.orientations(s).reshape(-1, 4)) for b in (plus, minus))
            turn = (after * before.inv()).as_rotvec().reshape(dp.shape)
            columns.append(np.concatenate([dp, turn], axis=-1) / (2.0 * h))
        return np.stack(columns, axis=-1)

    coarse, middle, fine = central(4 * step), central(2 * step), central(step)
    first, second = (4.0 * middle - coarse) / 3.0, (4.0 * fine - middle) / 3.0
    return (16.0 * second - first) / 15.0
