"""Mountings from a straight pose: the arm is held straight and still for a few seconds."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sesa2.alignment.earth_frame import BaseComparison
from sesa2.errors import Sesa2Error
from sesa2.sensing.imu.mounting import Mounting
from sesa2.shape.rotations import (
    FloatArray,
    conjugate,
    multiply,
    rotate,
    swing,
    tangent,
    to_rotation_vector,
    wrap,
)

# An arm that is still shows up to 2.7° within a minute, by the tilt and the heading that a BNO055's fusion wanders by.
MAX_SPREAD = np.deg2rad(3.0)
MIN_SAMPLES = 30
# A sensor put on askew is a few degrees off; more is a mounting or a base that the configuration has wrong.
LARGE_TILT = np.deg2rad(30.0)
# A turn about the arm beyond this is more than the headings of calibrated chips differ by.
LARGE_TURN = np.deg2rad(10.0)
# Beyond this angle between the arm and the vertical a heading error looks more like tilt than like twist.
MAX_FROM_VERTICAL = np.deg2rad(60.0)


class AlignmentError(Sesa2Error):
    """A straight pose from which mountings cannot be learnt."""


class Alignment(NamedTuple):
    """What a straight pose told.

    Attributes
    ----------
    mountings : (n_imu, 4)
        new q_LS, x y z w; the old one where the IMU was not heard.
    headings : (n_imu,)
        new headings, rad; the old ones unless asked for.
    corrections : (n_imu, 3)
        of the mounting about the link's x and y, q_LS = exp(x, y, 0) ⊗ old q_LS, then of the heading, rad.
    unexplained : (n_imu,)
        turn about the link's own axis that is left, rad: of an upright arm its heading or its mounting's twist.
    spread : (n_imu,)
        root mean square angle between the samples and their mean, rad; NaN where the IMU was not heard.
    samples : (n_imu,)
        number of samples.
    against_base
        what may be wrong where all IMUs point against the base, for people; else empty.
    """

    mountings: FloatArray
    headings: FloatArray
    corrections: FloatArray
    unexplained: FloatArray
    spread: FloatArray
    samples: np.ndarray
    against_base: str = ''

    def doubts(self, ids: Sequence[int]) -> list[str]:
        """What the user should look at, a sentence each; `ids` of the IMUs."""
        if self.against_base:  # which explains the rest
            return [self.against_base]
        turned = [
            f'IMU {i} is turned by {np.rad2deg(left):+.0f}° about the arm: its heading?'
            for i, left in zip(ids, self.unexplained, strict=True)
            if abs(left) > LARGE_TURN
        ]
        return [*tilt_doubts(self.corrections, ids), *turned]


def tilt_doubts(corrections: FloatArray, ids: Sequence[int]) -> list[str]:
    """A sentence where mountings were corrected by more than a sensor is put on askew; none where all is well.

    Parameters
    ----------
    corrections : (n_imu, k)
        of the mounting about the link's x and y in the first two columns, rad.
    ids
        of the IMUs.
    """
    tilts = np.linalg.norm(corrections[:, :2], axis=1)
    large = [f'IMU {i} by {np.rad2deg(a):.0f}°' for i, a in zip(ids, tilts, strict=True) if a > LARGE_TILT]
    if not large:
        return []
    text = (
        f'mountings are tilted far from those configured ({", ".join(large)}): right if they were not known; '
    )
    return [
        text + 'else check imus.mount_orientations and arm.base_orientation, which says how the arm stands'
    ]


def mean_rotation(q: FloatArray) -> FloatArray:
    """Mean of rotations: the eigenvector of Σ q qᵀ with the greatest eigenvalue.

    Markley et al., Averaging Quaternions, 2007; it is blind to signs.

    Parameters
    ----------
    q : (n, 4)
        x y z w, unit norm.

    Returns
    -------
    (4,), unit norm.
    """
    return np.linalg.eigh(q.T @ q)[1][:, -1]


def align_straight(
    orientations: FloatArray,
    measured: np.ndarray,
    base: FloatArray,
    mountings: FloatArray,
    headings: FloatArray,
    *,
    ids: Sequence[int],
    correct_headings: bool = False,
) -> Alignment:
    """Learn the mountings from the arm held straight, every link then being oriented as the base.

    What relates a link to the base is a twist about the arm, then a swing: base⁻¹ ⊗ link = twist ⊗ swing. The swing is
    always corrected: each link's axis is turned the least onto the base's. The twist may be the heading or the
    mounting's; put into the mounting, an error of heading would become one of tilt as soon as the arm bends. It is left
    alone, or on demand put into the heading. The more the arm lies, the more of a heading is swing and goes with it.

    Parameters
    ----------
    orientations : (n, n_imu, 4)
        q_WS as measured, x y z w, unit norm.
    measured : (n, n_imu)
        true where the IMU has measured.
    base : (4,)
        or (n, 4), q_WB, x y z w.
    mountings : (n_imu, 4)
        q_LS as known so far, x y z w.
    headings : (n_imu,)
        as known so far, rad.
    ids
        of the IMUs, for messages.
    correct_headings
        whether the turn about the axis is heading.

    Raises
    ------
    AlignmentError
        too few samples, the arm moved, or headings are asked for and the arm lies too flat to tell.
    """
    n, n_imu = orientations.shape[:2]
    measured = measured & np.isfinite(orientations).all(axis=-1)
    samples = measured.sum(axis=0)
    few = [f'IMU {i}: {k}' for i, k in zip(ids, samples, strict=True) if 0 < k < MIN_SAMPLES]
    if few or not samples.any():
        raise AlignmentError(
            f'too few samples ({", ".join(few) or "none"}), expected at least {MIN_SAMPLES} of each IMU'
        )
    bases = np.broadcast_to(base, (n, 4))
    links = Mounting(mountings, headings).link_orientations(
        np.where(measured[..., None], orientations, (0.0, 0.0, 0.0, 1.0))
    )
    comparison = BaseComparison()
    comparison.add(links, measured, bases)
    upright = mean_rotation(bases)
    spread, means = np.full(n_imu, np.nan), np.tile(upright, (n_imu, 1))
    for i in np.flatnonzero(samples):
        own = links[measured[:, i], i]
        means[i] = mean_rotation(own)
        spread[i] = _spread(own, means[i])
    _refuse_motion(spread, _spread(bases, upright), ids)
    heading = np.zeros(n_imu)
    if correct_headings:
        heading = np.where(samples > 0, _headings(means, upright), 0.0)
        means = Mounting(np.tile((0.0, 0.0, 0.0, 1.0), (n_imu, 1)), heading).link_orientations(means)
    tilt = swing((0.0, 0.0, 1.0), rotate(conjugate(means), tangent(upright)))
    left = to_rotation_vector(multiply(conjugate(upright), multiply(means, tilt)))[:, 2]
    corrections = to_rotation_vector(conjugate(tilt))
    corrections[:, 2] = heading
    return Alignment(
        mountings=multiply(conjugate(tilt), mountings),
        headings=wrap(headings + heading),
        corrections=corrections,
        unexplained=left,
        spread=spread,
        samples=samples,
        against_base=comparison.doubt,
    )


def _spread(q: FloatArray, mean: FloatArray) -> float:
    angles = np.linalg.norm(to_rotation_vector(multiply(conjugate(mean), q)), axis=-1)
    return float(np.sqrt(np.mean(angles**2)))


def _refuse_motion(spread: FloatArray, base_spread: float, ids: Sequence[int]) -> None:
    moved = [f'IMU {i} by {np.rad2deg(a):.1f}°' for i, a in zip(ids, spread, strict=True) if a > MAX_SPREAD]
    if base_spread > MAX_SPREAD:
        moved.insert(0, f'the base by {np.rad2deg(base_spread):.1f}°')
    if moved:
        raise AlignmentError(
            f'the arm moved: {", ".join(moved)} rms about the mean, expected at most {np.rad2deg(MAX_SPREAD):.1f}°'
        )


def _headings(means: FloatArray, upright: FloatArray) -> FloatArray:
    """Headings ψ after which only tilt is left: conj(mean) ⊗ Rz(ψ) ⊗ upright has no z component."""
    from_vertical = np.arccos(min(1.0, abs(tangent(upright)[2])))
    if from_vertical > MAX_FROM_VERTICAL:
        raise AlignmentError(
            f'the straight arm is {np.rad2deg(from_vertical):.0f}° from the vertical, expected at most '
            f'{np.rad2deg(MAX_FROM_VERTICAL):.0f}° for headings: lying flat, a heading error looks like tilt'
        )
    cosine = multiply(conjugate(means), upright)[:, 2]
    sine = multiply(conjugate(means), multiply((0.0, 0.0, 1.0, 0.0), upright))[:, 2]
    # cosine · cos ψ/2 + sine · sin ψ/2 = 0
    angle = 2.0 * np.arctan2(-cosine, sine)
    return np.arctan2(np.sin(angle), np.cos(angle))
