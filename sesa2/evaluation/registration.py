"""What lies between estimated and true positions and is not the shape's: frames, and markers beside the axis."""

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from sesa2.evaluation.trajectory import EvaluationError
from sesa2.shape.rotations import (
    IDENTITY,
    FloatArray,
    from_rotation_vector,
    multiply,
    rotate,
    to_matrix,
    to_rotation_vector,
)

Kind = Literal['none', 'translation', 'rigid', 'offsets', 'rigid+offsets']
KINDS: tuple[Kind, ...] = get_args(Kind)
TURNING: tuple[Kind, ...] = ('rigid', 'rigid+offsets')
WITH_OFFSETS: tuple[Kind, ...] = ('offsets', 'rigid+offsets')

# A rotation is only as good as the spread of the points across it.
MIN_SPREAD = 1e-3  # m, rms
MIN_SPREAD_RATIO = 0.02  # of the spread along the points' main axis

# Offsets that the motion tells less well than this, against the best told, stay 0: an arm that hardly bends turns its
# markers' links too little to tell an offset from a translation.
MIN_TOLD = 0.02
# Where frames turn, too, offsets trade with that turn, which has no natural zero: there they have a prior, m, against
# what is left over. That is the shape's own error and lasts: all samples tell no more than so many independent ones.
_EXPECTED_OFFSET = 0.04
_INDEPENDENT = 25
_SINGULAR = 1e-6  # directions that nothing tells at all, against the best told
MAX_FITTED = 5_000  # samples; more tell nothing new and take longer
_ROUNDS = 30
_SETTLED = 1e-9  # m


@dataclass(frozen=True, eq=False)
class Registration:
    """p_truth = R (p_estimate + q_link ⊗ offset) + t.

    Attributes
    ----------
    kind
        what was fitted.
    translation
        t, (3,), m.
    rotation
        R as a unit quaternion, (4,), x y z w.
    fitted_on
        first and last truth time of the samples it was fitted on, s; None if nothing was.
    offsets : (m, 3) or None
        of the markers, each in its link's frame, m.
    """

    kind: Kind = 'none'
    translation: FloatArray = field(default_factory=lambda: np.zeros(3))
    rotation: FloatArray = field(default_factory=IDENTITY.copy)
    fitted_on: tuple[float, float] | None = None
    offsets: FloatArray | None = None

    def apply(self, p: FloatArray, links: FloatArray | None = None) -> FloatArray:
        """Take estimated positions into the truth's frame.

        Parameters
        ----------
        p : (..., m, 3)
            m.
        links : (..., m, 4) or None
            orientations of the links there, x y z w; needed where there are offsets.
        """
        if self.offsets is not None:
            assert links is not None
            p = p + rotate(links, self.offsets)
        return rotate(self.rotation, p) + self.translation

    @property
    def angle(self) -> float:
        """How far it turns, rad."""
        return float(2.0 * np.arctan2(np.linalg.norm(self.rotation[:3]), abs(self.rotation[3])))

    def told(self) -> str:
        """What it does, for people; empty where nothing was fitted."""
        if self.kind == 'none':
            return ''
        x, y, z = 1e3 * self.translation
        parts = [f'translation {x:+.1f}, {y:+.1f}, {z:+.1f} mm']
        if self.kind in TURNING:
            turn = to_rotation_vector(self.rotation)
            axis = turn / max(float(np.linalg.norm(turn)), 1e-12)
            about = ', '.join(f'{c:+.2f}' for c in axis)
            parts.insert(0, f'rotation by {np.degrees(self.angle):.2f}° about ({about})')
        if self.offsets is not None:
            each = ('(' + ', '.join(f'{1e3 * c:+.1f}' for c in o) + ')' for o in self.offsets)
            parts.append(f'markers beside the axis by {", ".join(each)} mm')
        return ', '.join(parts)


def fit_registration(
    kind: Kind,
    estimate: FloatArray,
    truth: FloatArray,
    fitted_on: tuple[float, float] | None = None,
    links: FloatArray | None = None,
) -> Registration:
    """Least squares over pairs of points, all of the same weight, without scale.

    The rotation is Horn's (1987, "Closed-form solution of absolute orientation using unit quaternions"), which equals
    Kabsch's and Umeyama's with their correction against reflections. With offsets it is refined by Gauss–Newton.

    Parameters
    ----------
    kind
        none, translation, rigid, offsets (the markers' in their links, and a translation, which is the base's) or
        rigid+offsets.
    estimate, truth : (n, m, 3) or (n, 3)
        m, the same points in the two frames; NaN where one is not known.
    fitted_on
        kept in the result.
    links : (n, m, 4)
        orientations of the links that the points are on, x y z w; only for offsets.

    Returns
    -------
    The registration.

    Raises
    ------
    EvaluationError
        no points; for a rotation, points on a line, about which it is free (the message holds the singular values);
        for offsets, no orientations.
    """
    if kind not in KINDS:
        raise EvaluationError(f'registration {kind!r}, expected one of {", ".join(KINDS)}')
    if kind == 'none':
        return Registration()
    known = ~np.isnan(estimate[..., 0] + truth[..., 0])
    if not known.any():
        raise EvaluationError(f'registration {kind} needs samples to fit, got none')
    x, y = estimate[known], truth[known]
    x_mean, y_mean = x.mean(axis=0), y.mean(axis=0)
    rotation = IDENTITY.copy()
    if kind in TURNING:
        x, y = x - x_mean, y - y_mean
        _refuse_a_line(x, 'estimated')
        _refuse_a_line(y, 'true')
        rotation = np.linalg.eigh(horn_matrix(x.T @ y))[1][:, -1]
        rotation *= np.copysign(1.0, rotation[3])
    start = Registration(kind, y_mean - rotate(rotation, x_mean), rotation, fitted_on)
    if kind not in WITH_OFFSETS:
        return start
    if links is None:
        raise EvaluationError(
            f'registration {kind} needs the orientations of the markers, which this estimate does not hold'
        )
    return _with_offsets(start, estimate, truth, links)


def _with_offsets(
    start: Registration, estimate: FloatArray, truth: FloatArray, links: FloatArray
) -> Registration:
    """Gauss–Newton over a small turn (where the kind has one), the translation and every marker's offset.

    With a turn it is the maximum a posteriori: what is left over says how much the offsets' prior weighs.
    """
    stride = -(-len(estimate) // MAX_FITTED)
    p, y, R_link = estimate[::stride], truth[::stride], to_matrix(links[::stride])
    m = p.shape[1]
    marker = np.nonzero(~np.isnan(p[..., 0] + y[..., 0]))
    p, y, R_link, marker_of = p[marker], y[marker], R_link[marker], marker[1]
    turning = start.kind in TURNING
    q, t, offsets = start.rotation, start.translation, np.zeros((m, 3))
    size = float(np.sqrt(np.mean(np.sum(p**2, axis=1))))  # so that turns count in metres, as all else
    prior = np.zeros((3 * m, 6 + 3 * m))
    for _ in range(_ROUNDS if turning else 1):
        R = to_matrix(q)
        turned = R @ R_link
        reached = rotate(q, p) + np.einsum('nij,nj->ni', turned, offsets[marker_of])
        A = np.zeros((len(p), 3, 6 + 3 * m))
        A[:, :, 3:6] = np.eye(3)
        if turning:  # d/dω of exp(ω) v is −[v]×
            vx, vy, vz = reached.T / size
            A[:, 0, 1], A[:, 0, 2], A[:, 1, 2] = vz, -vy, vx
            A[:, 1, 0], A[:, 2, 0], A[:, 2, 1] = -vz, vy, -vx
        for k in range(m):
            A[marker_of == k, :, 6 + 3 * k : 9 + 3 * k] = turned[marker_of == k]
        residual = (y - reached - t).ravel()
        if turning:
            left = np.linalg.norm(residual) / np.sqrt(min(len(p), _INDEPENDENT))
            prior[:, 6:] = np.eye(3 * m) * left / _EXPECTED_OFFSET
            rows = np.concatenate([A.reshape(len(residual), -1), prior])
            step = least_squares_step(
                rows, np.concatenate([residual, -prior[:, 6:] @ offsets.ravel()]), _SINGULAR
            )
        else:
            step = least_squares_step(A.reshape(len(residual), -1), residual, MIN_TOLD)
        q = multiply(from_rotation_vector(step[:3] / size), q)
        t = t + step[3:6]
        offsets = offsets + step[6:].reshape(m, 3)
        if np.abs(step).max() < _SETTLED:
            break
    q = q * np.copysign(1.0, q[3])
    return Registration(start.kind, t, q, start.fitted_on, offsets)


def least_squares_step(A: FloatArray, residual: FloatArray, min_told: float) -> FloatArray:
    """Shortest x of least |A x − residual|, where directions that A tells less well stay 0.

    Parameters
    ----------
    A : (n, k)
        tall.
    residual : (n,)
        of any unit.
    min_told
        least singular value that counts, against the largest.

    Returns
    -------
    (k,), by the normal equations, which for tall matrices take a fraction of the time of a decomposition.
    """
    values, vectors = np.linalg.eigh(A.T @ A)
    told = values > min_told**2 * values[-1]
    step: FloatArray = vectors[:, told] @ ((vectors[:, told].T @ (A.T @ residual)) / values[told])
    return step


def horn_matrix(covariance: FloatArray) -> FloatArray:
    """Matrix N whose largest eigenvalue is max over rotations R of Σ b · R a, its eigenvector the quaternion of R.

    Parameters
    ----------
    covariance : (..., 3, 3)
        Σ a bᵀ.

    Returns
    -------
    (..., 4, 4), symmetric, x y z w. Horn 1987, section 4.A, with the scalar moved last.
    """
    S = np.asarray(covariance)
    trace = np.trace(S, axis1=-2, axis2=-1)
    N = np.empty((*S.shape[:-2], 4, 4))
    N[..., :3, :3] = S + np.swapaxes(S, -1, -2) - trace[..., None, None] * np.eye(3)
    N[..., 3, 3] = trace
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        N[..., i, 3] = N[..., 3, i] = S[..., j, k] - S[..., k, j]
    return N


def _refuse_a_line(centred: FloatArray, which: str) -> None:
    singular = np.linalg.svd(centred, compute_uv=False)
    spread = np.zeros(3)
    spread[: len(singular)] = singular / np.sqrt(len(centred))
    if spread[1] < max(MIN_SPREAD, MIN_SPREAD_RATIO * spread[0]):
        raise EvaluationError(
            f'a rigid registration cannot be found: the {which} marker positions lie on a '
            f'{"line" if spread[0] >= MIN_SPREAD else "point"}, so that a rotation about it is free. Singular values '
            f'{", ".join(f"{1e3 * s:.2f}" for s in spread)} mm rms ({len(centred)} points), expected the second above '
            f'{1e3 * MIN_SPREAD:g} mm and {100 * MIN_SPREAD_RATIO:g} % of the first. Bend the arm in more than one '
            f'direction, or register by translation'
        )
