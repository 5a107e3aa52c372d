"""The shape from magnetometers: errors on the paper's motion as magpylib simulates it, faults found, and speed."""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / 'test'))

from paper_arm import EARTH, NOISE, SIMULATED, PaperArm, as_in_the_paper, errors, flower, lemniscate

from sesa2.shape.coordinate_filter import CoordinateFilter
from sesa2.shape.coordinate_fit import CoordinateFit

# Rows of the paper's Table 1, and Section 4.
ROWS = {
    'one segment': {'segments': 1},
    'two segments': {'segments': 2},
    'three, 9 sensors': {},
    'three, 12 sensors': {'per_segment': 4},
    'three, 18 sensors': {'per_segment': 6},
    'tilt 10°': {'tilt': np.deg2rad(10.0)},
    'at 16 mm': {'radius': 0.016},
    'earth x': {'earth': (EARTH, 0.0, 0.0)},
    'earth y': {'earth': (0.0, EARTH, 0.0)},
    'earth z': {'earth': (0.0, 0.0, EARTH)},
    'affine': {'segments': 1, 'kinematics': 'affine', 'bend_max': 2.6},
}


def row_errors(row, sd, seed=0, **changes):
    """The paper's eq. 13, per cent, of each coordinate."""
    arm = PaperArm(**{**ROWS[row], **changes})
    affine = arm.family == 'affine'
    q = flower() if affine else lemniscate(len(arm.lengths))
    u = arm.simulate(q)
    u = u + sd * np.random.default_rng(seed).normal(size=u.shape)
    found = CoordinateFit(arm.predictor).fit(u).coordinates
    return errors(as_in_the_paper(found), as_in_the_paper(q)) if affine else errors(found, q)


def cold_starts(n=500, segments=3):
    """Share of random shapes up to 90° per axis that are found from straight."""
    arm, rng = PaperArm(segments, bend_max=2.3), np.random.default_rng(1)
    q = np.empty((n, segments, 3))
    q[..., :2] = rng.uniform(-np.pi / 2, np.pi / 2, (n, segments, 2))
    q[..., 2] = rng.uniform(0.11, 0.1155, (n, segments))
    q = q.reshape(n, -1)
    found = CoordinateFit(arm.predictor).fit(arm.simulate(q)).coordinates
    return float(np.mean((np.abs(found - q) < 1e-2 * arm.limits.scales).all(axis=1)))


def faults(change, frames=400, since=100, sensor=2):
    """Share of frames in which a fault of one of twelve sensors is found, others accused, and the worst error."""
    arm = PaperArm(3, 4)
    q = np.tile(lemniscate(3), (max(1, frames // 400), 1))
    rng = np.random.default_rng(0)
    u = np.tile(arm.simulate(lemniscate(3)), (max(1, frames // 400), 1))
    u = u + NOISE * rng.normal(size=u.shape)
    u[since:, sensor] = change(u[since:, sensor], rng)
    follow = CoordinateFilter(arm.predictor)
    steps = [follow.step(k / 40.0, each) for k, each in enumerate(u)]
    found = np.array([step.faults for step in steps]) != 0
    own = found[since:, sensor].mean()
    found[:, sensor] = False
    return own, int(found.any(axis=1).sum()), errors(np.array([s.coordinates for s in steps]), q).max()


def speed(arm, q):
    """Live fits a second from the shape of the instant before, iterations of them, and batched ones from straight."""
    u = arm.predictor.predict(q).readings
    u = u + NOISE * np.random.default_rng(0).normal(size=u.shape)
    fit = CoordinateFit(arm.predictor)
    live, batched = [], []
    many = np.tile(u, (5, 1))
    for _ in range(5):
        last, tried = q[0], 0
        begin = time.process_time()
        for each in u[:200]:
            fitted = fit.fit(each, last)
            last, tried = fitted.coordinates, tried + int(fitted.iterations)
        live.append(200.0 / (time.process_time() - begin))
        begin = time.process_time()
        fit.fit(many)
        batched.append(len(many) / (time.process_time() - begin))
    return max(live), tried / 200.0, max(batched)


def main():
    """Print everything."""
    for title, noise, changes in (
        ("the paper's simulated magnet, no noise", 0.0, {'magnet': SIMULATED}),
        ('the real magnet, 0.71 µT', NOISE, {}),
        ('the real magnet, 0.048 µT', 0.048e-6, {'noise': 0.048e-6}),
    ):
        print(f'\n{title}: errors, %')
        for row in ROWS:
            own = row_errors(row, noise, **changes)
            print(f'  {row:20}', ' '.join(f'{e:.2f}' if noise else f'{e:.4f}' for e in own))
    print(
        f'\ncold starts up to 90° per axis, 500 shapes of three segments: {100 * cold_starts():.1f} % right'
    )
    print('\ntwelve sensors, one fails: found in, others accused in, worst error')
    for name, change in {
        'jumps by 30 µT': lambda u, _: u + 30e-6,
        'next to zero': lambda u, rng: 1e-9 * rng.normal(size=u.shape),
        'saturates': lambda u, _: np.full(u.shape, 5e-3),
        'repeats itself': lambda u, _: np.full(u.shape, u[0]),
    }.items():
        own, others, worst = faults(change)
        print(f'  {name:20} {100 * own:.1f} % {others} frames {worst:.2f} %')
    own, others, worst = faults(lambda u, _: u, frames=10000)
    print(f'  none, 10 000 frames: {round(own * 9900) + others} frames with an alarm, {worst:.2f} %')
    print('\nfits a second of processor time: live, warm (iterations); batched, from straight')
    for name, arm, q in (
        ('1 segment, 3', PaperArm(1), lemniscate(1)),
        ('3 segments, 9', PaperArm(3), lemniscate(3)),
        ('3 segments, 18', PaperArm(3, 6), lemniscate(3)),
        ('affine, 9', PaperArm(**ROWS['affine']), flower()),
    ):
        live, iterations, batched = speed(arm, q)
        print(f'  {name:20} {live:.0f} ({iterations:.1f}); {batched:.0f}')


if __name__ == '__main__':
    main()
