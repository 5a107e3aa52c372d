"""The rotation and translation between the arm's frame and the motion capture's."""

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from sesa2.evaluation.trajectory import EvaluationError
from sesa2.shape.rotations import IDENTITY, FloatArray, rotate

Kind = Literal['none', 'translation', 'rigid']
KINDS: tuple[Kind, ...] = get_args(Kind)

# A rotation is only as good as the spread of the points across it.
MIN_SPREAD = 1e-3  # m, rms
MIN_SPREAD_RATIO = 0.02  # of the spread along the points' main axis


@dataclass(frozen=True, eq=False)
class Registration:
    """p_truth = R p_estimate + t.

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
    """

    kind: Kind = 'none'
    translation: FloatArray = field(default_factory=lambda: np.zeros(3))
    rotation: FloatArray = field(default_factory=IDENTITY.copy)
    fitted_on: tuple[float, float] | None = None

    def apply(self, p: FloatArray) -> FloatArray:
        """Take estimated positions (..., 3), m, into the truth's frame."""
        return rotate(self.rotation, p) + self.translation

    @property
    def angle(self) -> float:
        """How far it turns, rad."""
        return float(2.0 * np.arctan2(np.linalg.norm(self.rotation[:3]), abs(self.rotation[3])))


def fit_registration(
    kind: Kind, estimate: FloatArray, truth: FloatArray, fitted_on: tuple[float, float] | None = None
) -> Registration:
    """Least squares over pairs of points, all of the same weight, without scale.

    The rotation is Horn's (1987, "Closed-form solution of absolute orientation using unit quaternions"), which equals
    Kabsch's and Umeyama's with their correction against reflections.

    Parameters
    ----------
    kind
        none, translation or rigid.
    estimate, truth : (n, 3)
        m, the same points in the two frames.
    fitted_on
        kept in the result.

    Returns
    -------
    The registration.

    Raises
    ------
    EvaluationError
        no points, or for rigid points on a line, whose rotation about that line is free; the
        message holds the singular values.
    """
    if kind not in KINDS:
        raise EvaluationError(f'registration {kind!r}, expected one of {", ".join(KINDS)}')
    if kind == 'none':
        return Registration()
    if not len(estimate):
        raise EvaluationError(f'registration {kind} needs samples to fit, got none')
    estimate_mean, truth_mean = estimate.mean(axis=0), truth.mean(axis=0)
    rotation = IDENTITY.copy()
    if kind == 'rigid':
        estimate, truth = estimate - estimate_mean, truth - truth_mean
        _refuse_a_line(estimate, 'estimated')
        _refuse_a_line(truth, 'true')
        rotation = np.linalg.eigh(horn_matrix(estimate.T @ truth))[1][:, -1]
        rotation *= np.copysign(1.0, rotation[3])
    return Registration(kind, truth_mean - rotate(rotation, estimate_mean), rotation, fitted_on)


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
