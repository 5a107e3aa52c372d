"""Mountings and heading offsets of all IMUs together, from any recording in which the arm moves.

The shape is not known, but a soft arm's curvature changes smoothly along it and it hardly twists (`shape_prior`). An
IMU that disagrees with its neighbours in the same way whatever the shape is mounted askew, or its heading is off.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sesa2.alignment.heading_filter import DRIFT_STD, DRIFT_TIME
from sesa2.alignment.joint_estimate import HeadingWindows, JointEstimate
from sesa2.alignment.shape_prior import INDEPENDENCE_TIME
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

# What is expected of an arm put together with care, rad.
MOUNTING_STD = np.deg2rad(1.5)
HEADING_STD = np.deg2rad(5.0)

MIN_SECONDS = 10.0
MIN_SHAPES = 20
MAX_FRAMES = 250
_MAX_TRIED = 5000
_DISTINCT = np.deg2rad(5.0)
_TOLD = 0.7
# Of a heading about its mean, against what a sound chip's wanders by: of each, and of all together (as the mean of n).
_MOST_WANDER = 2.5
_MOST_TOGETHER = 1.5
# Simulated arms have a misfit of 0.05 to 0.2; with two IMUs exchanged 0.4 where they bend little, up to 4 else.
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
    drift : (n_windows, n_imu)
        what each heading changed by about its mean while the recording lasted, rad.
    windows
        in which that was taken as constant.
    misfit
        squared disagreement of the typical frame with every smooth shape, per measured value and its assumed variance:
        0.05 to 0.2 where the configuration is right.
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
    drift: FloatArray
    windows: HeadingWindows
    misfit: float
    twist: float
    shapes: int
    seconds: float

    @property
    def told(self) -> np.ndarray:
        """Whether the motion has told each correction: less than half the expected variance is left; (n_imu, 4)."""
        return self.std < _TOLD * self.expected

    @property
    def wander(self) -> FloatArray:
        """Root mean square of each IMU's drift over the recording, (n_imu,), rad."""
        return np.sqrt(self.windows.share @ self.drift**2)

    def disturbance(self, ids: Sequence[int]) -> str | None:
        """Why the headings are no constants that could be taken off, by the IMUs' ids; None where they are.

        A mean would put a part of an error that lasts half of the recording into all of it. The IMUs wander each on
        its own; what all do together weighs more, since it turns the whole arm against its base.
        """
        usual = DRIFT_STD * np.sqrt(min(1.0, self.seconds / DRIFT_TIME))
        large = [
            f'IMU {i} by {np.rad2deg(a):.0f}°'
            for i, a in zip(ids, self.wander, strict=True)
            if a > _MOST_WANDER * usual
        ]
        shared = self.drift.mean(axis=1)
        together = float(np.sqrt(self.windows.share @ shared**2))
        if not large and together > _MOST_TOGETHER * usual / np.sqrt(len(ids)):
            large = [
                f'IMU {", ".join(map(str, ids))} together, against the base, by {np.rad2deg(together):.1f}°'
            ]
        if not large:
            return None
        steps = np.abs(np.diff(self.drift, axis=0)).max(axis=1)
        return (
            f'headings changed within the recording: {", ".join(large)} rms about the mean, most of it about '
            f'{self.windows.begins[1 + np.argmax(steps)]:.0f} s into it: a magnetic disturbance?'
        )

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

    Corrections β, what the headings change by from window to window and the curvature of every frame are found jointly
    by Gauss–Newton, the curvature marginalised in the normal equations of the others; the prior's widths and the twist
    are learnt on the way (empirical Bayes). Headings that change so much that their mean is no correction are found as
    well as others: `disturbance` tells.

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
    windows = HeadingWindows.of(stamps[tried], np.array(chosen))
    expected = mounting_std, heading_std
    solver = JointEstimate(layout, links[chosen], there[chosen], bases[chosen], windows, expected)
    solver.weight = min(1.0, seconds / INDEPENDENCE_TIME / len(chosen))
    solver.solve()
    if solver.misfit > _NO_FIT:
        raise CalibrationError(
            f'no smooth shape agrees with these IMUs (misfit {solver.misfit:.1f}, expected 0.05 to 0.2): '
            'check their ids, positions and mountings; are two exchanged?'
        )
    beta = solver.corrections + np.outer(coarse, [0.0, 0.0, 0.0, 1.0])
    return SelfCalibration(
        mountings=multiply(from_rotation_vector(beta[:, :3]), mountings),
        headings=wrap(headings + beta[:, 3]),
        corrections=beta,
        std=solver.std,
        drift=solver.drift - windows.share @ solver.drift,
        windows=windows,
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
