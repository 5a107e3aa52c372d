"""Mountings and heading offsets of all IMUs together, from any recording in which the arm moves.

The shape is not known, but a soft arm's curvature changes smoothly along it and it hardly twists (`shape_prior`). An
IMU that disagrees with its neighbours in the same way whatever the shape is mounted askew, or its heading is off.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sesa2.alignment.shape_prior import INDEPENDENCE_TIME, TWIST, ShapePrior, likelier_twist
from sesa2.errors import Sesa2Error
from sesa2.sensing.imu.mounting import Mounting
from sesa2.shape.layout import Layout
from sesa2.shape.missing import fill_missing
from sesa2.shape.rotations import (
    FloatArray,
    conjugate,
    from_rotation_vector,
    multiply,
    rotate,
    tangent,
    wrap,
)

# What is expected of an arm put together with care, rad. The widths are learnt from all IMUs together, in which these
# count as much as so many parameters.
MOUNTING_STD = np.deg2rad(1.5)
HEADING_STD = np.deg2rad(5.0)
_COUNTS_AS = 6

MIN_SECONDS = 10.0
MIN_SHAPES = 20
MAX_FRAMES = 250
_MAX_TRIED = 5000
_DISTINCT = np.deg2rad(5.0)
_ITERATIONS = 25
_SETTLED = np.deg2rad(0.003)
_TOLD = 0.7
# Simulated arms have a misfit of 0.1 to 0.2; with two IMUs exchanged 0.2 to 0.8 where they bend little, else 0.4 to 3.
_NO_FIT = 1.0
_FAR_OFF = np.deg2rad(45.0)  # the solver itself finds back from nearer


class CalibrationError(Sesa2Error):
    """A recording from which nothing can be learnt."""


class SelfCalibration(NamedTuple):
    """What self-calibration found.

    Columns of (n_imu, 4) are the mounting's rotation about the link's x, y and z and the heading, rad.

    Attributes
    ----------
    mountings : (n_imu, 4)
        new q_LS, x y z w.
    headings : (n_imu,)
        new headings, rad, the mean over the recording.
    corrections : (n_imu, 4)
        by which they differ from the old: q_LS = exp(x, y, z) ⊗ old q_LS.
    std : (n_imu, 4)
        their uncertainty, one standard deviation.
    expected : (4,)
        errors expected of an IMU that the motion tells nothing of, one standard deviation: of an arm put together
        with care, or as learnt from all IMUs where they are larger.
    misfit
        squared disagreement of the typical frame with every smooth shape, per measured value and its assumed variance:
        0.1 to 0.2 where the configuration is right.
    twist
        standard deviation of the twist of the whole arm, as learnt, rad.
    shapes
        number of distinct shapes that were used.
    seconds
        length of the recording.
    """

    mountings: FloatArray
    headings: FloatArray
    corrections: FloatArray
    std: FloatArray
    expected: FloatArray
    misfit: float
    twist: float
    shapes: int
    seconds: float

    @property
    def told(self) -> np.ndarray:
        """Whether the motion has told each correction: less than half the expected variance is left; (n_imu, 4)."""
        return self.std < _TOLD * self.expected

    def untold(self, ids: Sequence[int]) -> list[str]:
        """What the motion was too poor to tell: a line for each IMU that has such, by its id."""
        names = ('mounting about x', 'about y', 'about z', 'heading')
        lines = []
        for i, told in enumerate(self.told):
            if not told.all():
                parts = [
                    f'{names[k]} (±{np.rad2deg(self.std[i, k]):.1f}° of ±{np.rad2deg(self.expected[k]):.1f}°)'
                    for k in np.flatnonzero(~told)
                ]
                lines.append(f'IMU {ids[i]}: the motion hardly tells {", ".join(parts)}')
        return lines


def self_calibrate(
    stamps: FloatArray,
    orientations: FloatArray,
    measured: np.ndarray,
    layout: Layout,
    base: FloatArray,
    mountings: FloatArray,
    headings: FloatArray,
    *,
    mounting_std: float = MOUNTING_STD,
    heading_std: float = HEADING_STD,
    seed: int = 0,
) -> SelfCalibration:
    """Estimate every IMU's mounting and heading.

    Corrections β and the curvature of every frame are found jointly by Gauss–Newton, the curvature marginalised in the
    normal equations of β; the prior's widths and the twist are learnt on the way (empirical Bayes).

    Parameters
    ----------
    stamps : (n,)
        s.
    orientations : (n, n_imu, 4)
        q_WS as measured, x y z w, unit norm.
    measured : (n, n_imu)
        true where the IMU has measured.
    layout
        the arm and its IMUs.
    base : (4,)
        or (n, 4), q_WB, x y z w. It is taken as exact: a heading that all IMUs and the base share cannot be seen.
    mountings : (n_imu, 4)
        q_LS as known so far, x y z w.
    headings : (n_imu,)
        as known so far, rad.
    mounting_std, heading_std
        errors expected of these, rad; of the mounting about each axis.
    seed
        of the choice of frames.

    Raises
    ------
    CalibrationError
        too short, too few distinct shapes, or IMUs that agree with no smooth shape.
    """
    stamps = np.asarray(stamps, dtype=float)
    measured = measured & np.isfinite(orientations).all(axis=-1)
    some = measured.any(axis=-1)
    seconds = float(np.ptp(stamps[some])) if some.any() else 0.0
    if seconds < MIN_SECONDS:
        raise CalibrationError(
            f'the recording has {seconds:.1f} s of orientations, expected at least {MIN_SECONDS:g} s'
        )
    rng = np.random.default_rng(seed)
    tried = rng.permutation(np.flatnonzero(some))[:_MAX_TRIED]
    there = measured[tried]
    links = np.where(there[..., None], orientations[tried], (0.0, 0.0, 0.0, 1.0))
    bases = np.broadcast_to(base, (len(stamps), 4))[tried]
    coarse = _coarse_headings(Mounting(mountings, headings).link_orientations(links), there, bases)
    links = Mounting(mountings, headings + coarse).link_orientations(links)
    links = fill_missing(links, there, layout, bases)
    chosen = _distinct_shapes(links, bases)
    if len(chosen) < MIN_SHAPES:
        raise CalibrationError(
            f'the arm took {len(chosen)} shapes that differ by more than {np.rad2deg(_DISTINCT):.0f}° somewhere, '
            f'expected at least {MIN_SHAPES}: move it more'
        )
    solver = _Solver(layout, links[chosen], there[chosen], bases[chosen], (mounting_std, heading_std))
    solver.weight = min(1.0, seconds / INDEPENDENCE_TIME / len(chosen))
    solver.solve()
    if solver.misfit > _NO_FIT:
        raise CalibrationError(
            f'no smooth shape agrees with these IMUs (misfit {solver.misfit:.1f}, expected 0.1 to 0.2): '
            'check their ids, positions and mountings; are two exchanged?'
        )
    beta = solver.beta + np.outer(coarse, [0.0, 0.0, 0.0, 1.0])
    return SelfCalibration(
        mountings=multiply(from_rotation_vector(beta[:, :3]), mountings),
        headings=wrap(headings + beta[:, 3]),
        corrections=beta,
        std=np.sqrt(np.diag(solver.covariance)).reshape(-1, 4),
        expected=solver.expected,
        misfit=solver.misfit,
        twist=solver.twist,
        shapes=len(chosen),
        seconds=seconds,
    )


def _coarse_headings(links: FloatArray, measured: np.ndarray, bases: FloatArray) -> FloatArray:
    """Headings far off, from which the solver would not find back; (n_imu,), rad, 0 where there is no need.

    A chip without north starts with any heading. Station by station from the base, ψ is put where the rotation from
    the station before is smallest over all frames. Its scalar part is w = a cos ψ/2 + b sin ψ/2, so that the greatest
    mean of w² has a closed form.
    """
    found = np.zeros(links.shape[1])
    before = bases
    for i in range(len(found)):
        heard, own = measured[:, i], links[:, i]
        turned = np.stack([own[:, 1], -own[:, 0], -own[:, 3], own[:, 2]], axis=-1)  # −k ⊗ own
        a, b = (np.einsum('ni,ni->n', before[heard], q[heard]) for q in (own, turned))
        found[i] = np.arctan2(2.0 * a @ b, a @ a - b @ b)
        corrected = np.cos(0.5 * found[i]) * own + np.sin(0.5 * found[i]) * turned
        before = np.where(heard[:, None], corrected, before)
    return np.where(np.abs(found) > _FAR_OFF, found, 0.0)


def _distinct_shapes(links: FloatArray, bases: FloatArray) -> list[int]:
    """Frames whose tangents differ somewhere from those of every other: a shape seen twice tells nothing new.

    Tangents, not orientations, since a drifting heading does not turn those of an upright arm that stands still.
    """
    tangents = rotate(conjugate(bases)[:, None], tangent(links))
    chosen: list[int] = []
    kept = np.empty((MAX_FRAMES, *tangents.shape[1:]))
    for i, t in enumerate(tangents):
        cosines = np.einsum('nik,ik->ni', kept[: len(chosen)], t)
        if (cosines.min(axis=-1) < np.cos(_DISTINCT)).all():
            kept[len(chosen)] = t
            chosen.append(i)
            if len(chosen) == MAX_FRAMES:
                break
    return chosen


class _Solver:
    """The joint estimate. With β = (μ, ψ) of an IMU, its link is oriented as q_WL = Rz(−ψ) ⊗ measured ⊗ exp(−μ)."""

    def __init__(
        self,
        layout: Layout,
        links: FloatArray,
        measured: np.ndarray,
        bases: FloatArray,
        expected: tuple[float, float],
    ):
        n_imu = links.shape[1]
        self._prior = ShapePrior(layout)
        self._links, self._measured, self._bases = links, measured, bases
        self._rows = 3 * measured.sum(axis=-1)
        self._heard = measured.any(axis=0)
        self._nominal = np.square([expected[0]] * 3 + [expected[1]])
        self._prior_variances = self._nominal
        self.beta = np.zeros((n_imu, 4))
        self.covariance = np.diag(np.tile(self._nominal, n_imu))
        self.twist = TWIST
        self.misfit = np.inf
        self.weight = 1.0
        self._curvature = self._prior.first_guess(links, bases)

    @property
    def expected(self) -> FloatArray:
        return np.sqrt(np.maximum(self._nominal, self._prior_variances))

    def solve(self) -> None:
        for iteration in range(_ITERATIONS):
            step = self._step(learn=iteration > 1)
            if iteration > 4 and np.abs(step).max() < _SETTLED:
                break

    def _step(self, learn: bool) -> FloatArray:
        n, n_imu = self._links.shape[:2]
        unturn = Mounting(from_rotation_vector(self.beta[:, :3]), self.beta[:, 3])
        y, J, shape = self._prior.linearise(
            self._curvature, unturn.link_orientations(self._links), self._bases
        )
        marginal = self._prior.marginalise(J, self._measured, self.twist)
        # d = H β: mountings turn about the link's axes, headings about the world's z.
        H = np.zeros((n, 3 * n_imu, 4 * n_imu))
        each, per_imu = np.arange(n_imu), H.reshape(n, n_imu, 3, n_imu, 4)
        per_imu[:, each, :, each, :3] = rotate(shape[:, :, None], np.eye(3)).transpose(1, 0, 3, 2)
        per_imu[:, each, 2, each, 3] = 1.0
        WH = marginal.precision @ H
        Wy = np.einsum('nrs,ns->nr', marginal.precision, y)
        # A frame that fits nothing, from a damaged sample, is weighted down.
        misfit = np.einsum('nr,nr->n', y, Wy) / self._rows
        self.misfit = float(np.median(misfit))
        trust = 1.0 / np.maximum(misfit, 1.0)
        scaled = self.weight * trust[:, None, None] * WH
        information = np.einsum('nri,nrj->ij', H, scaled)
        precision = np.diag(1.0 / np.tile(self._prior_variances, n_imu))
        self.covariance = np.linalg.inv(information + precision)
        beta = self.beta.ravel()
        step = self.covariance @ (np.einsum('nri,nr->i', scaled, y) - precision @ beta)
        self.beta = (beta + step).reshape(n_imu, 4)
        weighed = Wy - WH @ step
        self._curvature = self._prior.most_likely(J, weighed, self.twist)
        if learn:
            self.twist = likelier_twist(self.twist, marginal, np.sqrt(trust)[:, None] * weighed)
            self._learn_widths()
        return step

    def _learn_widths(self) -> None:
        """Expectation step for the prior's widths, over the IMUs that were heard."""
        seen = (self.beta**2 + np.diag(self.covariance).reshape(-1, 4))[self._heard]
        mounting = (_COUNTS_AS * self._nominal[0] + seen[:, :3].sum()) / (_COUNTS_AS + seen[:, :3].size)
        heading = (_COUNTS_AS * self._nominal[3] + seen[:, 3].sum()) / (_COUNTS_AS + len(seen))
        self._prior_variances = np.array([mounting] * 3 + [heading])
