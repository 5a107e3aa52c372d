"""`make magnetic`: Table 1 and Section 4 of Baaij et al., theirs beside ours, written into docs/magnetic.md.

The paper's networks are replaced by the magnets' exact field, and its descent by least squares. Readings are simulated
by magpylib, which the package does not use.
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / 'test'))

from paper_arm import EARTH, NOISE, SIMULATED, PaperArm, as_in_the_paper, errors, flower, lemniscate

from sesa2.sensing.magnetometry.build_parameters import BuildErrors, BuildParameters
from sesa2.sensing.magnetometry.magnet_calibration import calibrate_magnets
from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings
from sesa2.shape.coordinate_fit import CoordinateFit

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'docs/magnetic.md'
SEEDS = (0, 1, 2)
# What the paper has: e_u, mT, and of each segment Δx, Δy, δL, % (mean of three trained networks); the arm.
TABLE = {
    'n_b = 1, n_s = 3': (0.015, '1.7 1.8 2.8', {'segments': 1}),
    'n_b = 2, n_s = 6': (0.015, '4.2 3.9 6.3 2.3 2.2 4.1', {'segments': 2}),
    'n_b = 3, n_s = 9': (0.015, '3.7 4.7 6.0 2.6 2.5 5.5 1.6 1.6 2.7', {}),
    'n_s = 6': (0.015, '3.9 24.4 8.4 2.5 53.2 6.0 1.5 52.3 3.1', {'per_segment': 2}),
    'n_s = 12': (0.015, '3.7 3.9 4.6 2.6 2.6 4.4 1.6 1.5 2.5', {'per_segment': 4}),
    'n_s = 18': (0.016, '3.2 3.5 4.2 2.4 2.5 4.4 1.5 1.3 2.5', {'per_segment': 6}),
    'sensors tilted by 10°': (0.015, '8.1 6.4 4.7 5.1 3.8 5.6 2.8 1.9 4.1', {'tilt': np.deg2rad(10.0)}),
    'sensors at 16 mm': (0.017, '3.4 4.0 6.2 2.6 2.8 6.7 1.6 1.6 4.0', {'radius': 0.016}),
    'earth along x': (0.012, '2.0 2.4 4.3 1.8 1.9 3.6 1.5 1.6 3.2', {'earth': (EARTH, 0.0, 0.0)}),
    'earth along y': (0.012, '1.9 2.5 3.8 1.9 2.0 3.4 1.5 1.6 3.3', {'earth': (0.0, EARTH, 0.0)}),
    'earth along z': (0.012, '2.0 2.6 4.1 1.6 1.7 4.9 1.5 1.4 3.9', {'earth': (0.0, 0.0, EARTH)}),
}
AFFINE = (0.025, '5.4 4.0 1.3 3.8', {'segments': 1, 'kinematics': 'affine', 'bend_max': 2.6})
# Standard deviations of errors that are even within ± 3 %, 0.3 mm, 1°, 1 %, 2 µT.
UNIFORM = 1.0 / np.sqrt(3.0)
LIMITS = {
    'strength': 0.03,
    'shift': 3e-4,
    'position': 3e-4,
    'tilt': np.deg2rad(1.0),
    'gain': 0.01,
    'offset': 2e-6,
}
CAPTURE = (2.3e-3, 0.1e-3)  # how well motion capture knows bends, rad, and lengths, m

TEXT = """# Shape from magnets: the paper, and ours

<!-- Written by `make magnetic` (bench/magnetic_paper.py). -->

Baaij and others (*Learning 3D shape proprioception for continuum soft robots with multiple magnetic sensors*) learn
what magnetometers read of a shape, and descend to the shape that explains the readings. Here the magnets' field is
computed, and least squares find the shape. Errors are RMSE over range (their eq. 13), %, on their motions: a lemniscate
of ± 45° with an elongation of 0 to 5.5 mm, and for affine curvature a flower; 10 s at 40 Hz. Readings are simulated by
magpylib, which the package does not use.

- **paper**: their Table 1 and Section 4, means of three networks.
- **their magnet, no noise**: like for like. Their simulation handed diameters to a function that wants radii: its ring
  is 24/12/6 mm, with 3.7 times the field of the real one.
- **real magnet, 0.71 µT**: a ring of 12/6/6 mm, and the noise of the experiment (3.55 mV at 5 V/mT).
- **built**: real magnet, that noise, and a build that is off, evenly within ± 3 % of a magnet's strength, 0.3 mm of its
  place, 0.3 mm of a sensor's along each axis, 1° about two axes, 1 % of gain and 2 µT of offset, all at once.
  *As described*: not calibrated. *Straight pose*: after 50 readings of the straight arm, the earth's field known.
  *100 poses*: of motion capture, known to {bend:g} mrad and {length:g} mm, the earth's field not known. *All known*:
  what the noise leaves.

Ours: mean ± standard deviation of three seeds of noise and build. e_u: how far predicted readings are off.
With two sensors a segment the bend across them is not told: what stands there is the prior (`check` says so).

## Table 1

{table}

## Section 4: affine curvature

{section}

## Four sensors a segment, one of each removed in flight (Fig. 4b)

Real magnet, 0.71 µT. Worst bend and elongation before: {before}; after: {after}.

## After a straight pose alone

Medians of twenty builds, %:

| | bends, worst | bends, mean | elongations, worst | elongations, mean |
| --- | --- | --- | --- | --- |
{straight}
"""


class Case:
    """One row: an arm, its motion, and what is asked of it."""

    def __init__(self, changes):
        self.changes = changes
        self.affine = changes.get('kinematics') == 'affine'
        self.arm = PaperArm(**changes)
        self.unanswered = 0  # frames in which no minimum was found
        self.q = flower() if self.affine else lemniscate(len(self.arm.lengths))

    def errors_of(self, predictor, u):
        """Eq. 13 of each coordinate, %."""
        found = CoordinateFit(predictor).fit(u).coordinates
        answered = np.isfinite(found).all(axis=1)
        self.unanswered += int((~answered).sum())
        found, q = found[answered], self.q[answered]
        return errors(as_in_the_paper(found), as_in_the_paper(q)) if self.affine else errors(found, q)

    def exact(self):
        """With the magnet of their simulation, without noise: e_u, T, and errors."""
        arm = PaperArm(**{**self.changes, 'magnet': SIMULATED})
        u = arm.simulate(self.q)
        e_u = np.sqrt(np.mean((arm.predictor.predict(self.q).readings - u) ** 2))
        return e_u, self.errors_of(arm.predictor, u)

    def noisy(self, seed):
        """With the real magnet and noise."""
        u = self.arm.simulate(self.q)
        return self.errors_of(self.arm.predictor, self._read(u, np.random.default_rng(seed)))

    def built(self, seed, with_poses=True):
        """Of one build: as described, calibrated from the straight pose, from 100 poses; and as it really is."""
        rng, p = np.random.default_rng([seed, 1]), self.arm.predictor
        known = BuildErrors(**{name: UNIFORM * size for name, size in LIMITS.items()}, earth=0.0)
        unknown = BuildErrors(**{name: UNIFORM * size for name, size in LIMITS.items()}, earth=50e-6)
        build = BuildParameters(p, known)
        real = build.changed(build.deviations / UNIFORM * rng.uniform(-1.0, 1.0, len(build.names)))
        u = self._read(self.arm.simulate_build(real, self.q), rng)
        rest = np.tile(self.arm.limits.kinematics.rest, (50, 1))
        straight = calibrate_magnets(
            p, rest, self._read(self.arm.simulate_build(real, rest), rng), before=known
        ).predictor
        of = [p, straight, *([self._captured(real, unknown, rng)] if with_poses else []), real]
        return [self.errors_of(each, u) for each in of]

    def _captured(self, real, before, rng):
        """As 100 poses of motion capture tell."""
        poses = self.arm.limits.draw(100, rng)
        if self.affine:  # the simulated arm bends in a plane
            first = np.linalg.norm(poses[:, :2], axis=1, keepdims=True)
            size = np.linalg.norm(poses[:, 2:4], axis=1, keepdims=True) * rng.choice([-1.0, 1.0], (100, 1))
            poses[:, 2:4] = size * poses[:, :2] / first
        lengths = np.array(['length' in name for name in self.arm.limits.kinematics.coordinate_names])
        error = np.where(lengths, CAPTURE[1], CAPTURE[0])
        seen = poses + error * rng.normal(size=poses.shape)
        p = self.arm.predictor
        return calibrate_magnets(
            MagneticReadings(p.limits, p.magnets, p.magnetometers),
            seen,
            self._read(self.arm.simulate_build(real, poses), rng),
            before=before,
            coordinate_errors=error,
        ).predictor

    @staticmethod
    def _read(u, rng):
        return u + NOISE * rng.normal(size=u.shape)


def lines_of(name, e_u, theirs, changes):
    """Rows of one case."""
    case = Case(changes)
    exact_u, exact = case.exact()
    noisy = [case.noisy(seed) for seed in SEEDS]
    builds = np.array([case.built(seed) for seed in SEEDS])
    who = [
        ('paper', f'{1e3 * e_u:.0f}', theirs.split()),
        ('their magnet, no noise', f'{1e6 * exact_u:.1e}', [f'{e:.4f}' for e in exact]),
        ('real magnet, 0.71 µT', '', cells(noisy)),
        ('built, as described', '', cells(builds[:, 0])),
        ('built, straight pose', '', cells(builds[:, 1])),
        ('built, 100 poses', '', cells(builds[:, 2])),
        ('built, all known', '', cells(builds[:, 3])),
    ]
    n = 4 if case.affine else 9
    if case.unanswered:
        name += (
            f' ({case.unanswered} of {len(case.q) * (1 + 5 * len(SEEDS))} frames without an answer left out)'
        )
    print(f'{name}: exact {exact.max():.4f} %, noisy {np.mean(noisy, axis=0).max():.2f} %', flush=True)
    return [
        f'| {name if k == 0 else ""} | {what} | {u} | {" | ".join([*own, *[""] * (n - len(own))])} |'
        for k, (what, u, own) in enumerate(who)
    ]


def cells(values):
    """Mean ± standard deviation over seeds."""
    return [
        f'{m:.2f} ± {s:.2f}' if m < 10.0 else f'{m:.0f} ± {s:.0f}'
        for m, s in zip(np.mean(values, axis=0), np.std(values, axis=0, ddof=1), strict=True)
    ]


def failing():
    """Fig. 4(b): the fourth sensor of each segment is gone from the middle of the motion on; errors of both halves."""
    arm, q = PaperArm(3, 4), lemniscate(3)
    u = arm.simulate(q) + NOISE * np.random.default_rng(0).normal(size=(len(q), 12))
    u[200:, [3, 7, 11]] = np.nan
    found = CoordinateFit(arm.predictor).fit(u).coordinates
    span = np.ptp(q, axis=0)
    return [
        100.0 * np.sqrt(np.mean((found[of] - q[of]) ** 2, axis=0)) / span
        for of in (slice(200), slice(200, None))
    ]


def straight_pose(segments, per_segment=3, builds=20):
    """Errors of many builds after a straight pose: worst and mean of the bends, of elongations; medians of builds."""
    case = Case({'segments': segments, 'per_segment': per_segment})
    rows = []
    for seed in range(100, 100 + builds):
        e = case.built(seed, with_poses=False)[1].reshape(-1, 3)
        rows.append((e[:, :2].max(), e[:, :2].mean(), e[:, 2].max(), e[:, 2].mean()))
    return np.median(rows, axis=0)


def main():
    """Measure, print, write the page."""
    begin = time.monotonic()
    rows = []
    for name, (e_u, theirs, changes) in TABLE.items():
        rows += lines_of(name, e_u, theirs, changes)
    affine = lines_of('affine', *AFFINE)
    before, after = failing()
    head = ['| simulation | who | e_u [µT] |', '| --- | --- | --- |']
    coordinates = [f'{of}{k}' for k in (1, 2, 3) for of in ('Δx', 'Δy', 'δL')]
    table = [head[0] + ''.join(f' {c} |' for c in coordinates), head[1] + ' --- |' * 9, *rows]
    section = [head[0] + ' κ0 | κ1 | φ | δL |', head[1] + ' --- |' * 4, *affine]
    straight = [
        f'| {name} | {" | ".join(f"{e:.2f}" for e in own)} |'
        for name, own in (
            ('one segment, 3 sensors', straight_pose(1)),
            ('three segments, 9 sensors', straight_pose(3)),
            ('three segments, 18 sensors', straight_pose(3, 6)),
        )
    ]
    PAGE.write_text(
        TEXT.format(
            bend=1e3 * CAPTURE[0],
            length=1e3 * CAPTURE[1],
            table='\n'.join(table),
            section='\n'.join(section),
            before=of_half(before),
            after=of_half(after),
            straight='\n'.join(straight),
        )
    )
    print(f'written to {PAGE.relative_to(ROOT)} in {time.monotonic() - begin:.0f} s')


def of_half(e):
    """Worst bend and elongation of a part of the motion, as text."""
    e = e.reshape(-1, 3)
    return f'{e[:, :2].max():.2f} and {e[:, 2].max():.2f} %'


if __name__ == '__main__':
    main()
