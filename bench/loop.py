"""`make loop`: the tip of simulated arms driven by what they feel, as tables beside the paper's and a figure.

Hughes, Stella, Della Santina and Rus swept the tip of an arm of 20 cm in x, y and z, open loop by its encoders and
closed loop by its IMUs, each pose five times. The same is done here without clock and ROS, with the estimate of
`pcc_delta` and the controller as the configuration makes them. The simulated arms are not those tuned on.
"""

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from looped_arm import DT, LoopedArm, aligned, taught, with_axis

from sesa2.configuration import files
from sesa2.plant.plant_options import HEAVY, MILD
from sesa2.shape.kinematics.constant_curvature import ConstantCurvature, arc_to
from sesa2.shape.rotations import from_rotation_vector

ROOT = Path(__file__).resolve().parents[1]
PLANTS = {'heavy': HEAVY, 'mild': MILD}
FIRST_SEED = 1001
GAINS = {'rates': 2.5, 'paper': 1.0}
TWIST = 'tip'  # who owns it once the arm is aligned: IMUs are mounted askew about the axis
SIDE = (-0.10, -0.05, 0.0, 0.05, 0.10)
SWEEPS = {
    'x': np.array([(x, 0.03, 0.15) for x in SIDE]),
    'y': np.array([(0.03, y, 0.15) for y in SIDE]),
    'z': np.array([(0.05, 0.03, z) for z in (0.12, 0.14, 0.16, 0.18, 0.20)]),
}
REST_S, AT_REST = 4.0, round(0.5 / DT)

# What is known of the arm: name for people, what is done before, what is fed back.
KNOWN = {
    'none': ('open loop', None, 'none'),
    'paper': ('closed loop, as in the paper', 'eq3', 'model'),
    'aligned': ('+ straight pose aligned', 'aligned', 'model'),
    'unbent': ('+ straight pose aligned, `route: unbent`', 'aligned', 'model'),
    'wrong way': ('+ straight pose aligned, bent before it lengthens', 'aligned', 'model'),
    'ten': ('+ ten known points', 'ten', 'model'),
    'ten unbent': ('+ ten known points, `route: unbent`', 'ten', 'model'),
    'length': ('+ length measured', 'length', 'model'),
    'truth': ('true tip fed back', 'eq3', 'truth'),
}

BOTH_LAWS = ('paper', 'aligned', 'unbent')
SEVERAL = ('none', 'paper', 'aligned', 'truth')


def arm_of(plant, seed, law='rates', segments=1, **controller):
    """The configuration of an arm."""
    c = files.load(ROOT / 'config/tri_backbone.yaml')
    if segments > 1:
        c = of_segments(c, segments)
        controller = {'damping': 0.02, **controller}
    o = PLANTS[plant]
    return replace(
        c,
        plant=replace(c.plant, slip=o.slip, imu_errors=o.imu_errors, seed=seed),
        controller=replace(c.controller, law=law, gain=GAINS[law], **controller),
    )


def of_segments(c, m):
    """The same arm with several segments of 11 cm, which lengthen by a tenth."""
    ends = np.repeat(np.arange(1, m + 1), 3).tolist()
    names = tuple(f'b{i}' for i in range(1, 3 * m + 1))
    length = 0.11
    places = tuple(round(length * k, 9) for k in range(1, m + 1))
    return replace(
        c,
        arm=replace(c.arm, length=round(m * length, 9)),
        segments=replace(c.segments, lengths=(length,) * m, stretch=(0.9, 1.2)),
        lengths=replace(
            c.lengths,
            names=names,
            segments=tuple(ends),
            starts=tuple(ends),
            angles=tuple(np.tile(2.0 * np.pi / 3.0 * np.arange(3), m).tolist()),
        ),
        imus=replace(
            c.imus, ids=tuple(range(2, m + 2)), positions=places, mount_orientations=(0.0, 0.0, 0.0, 1.0)
        ),
        markers=replace(c.markers, names=('tip',), positions=(places[-1],)),
        plant=replace(c.plant, home=(0.11,), travel=(0.02, 0.25)),
        controller=replace(c.controller, names=names, length_limits=(0.03, 0.22)),
    )


def random_points(rng, n, least=0.13, most=0.23):
    """Points of the tip where the arm is bent by up to 70°, (n, 3), m."""
    theta, azimuth = rng.uniform(0.1, 1.22, n), rng.uniform(0.0, 2.0 * np.pi, n)
    q = np.stack([theta * np.cos(azimuth), theta * np.sin(azimuth), rng.uniform(least, most, n)], axis=-1)
    return ConstantCurvature([0.16]).backbone(q).positions([0.16])[:, 0]


def prepared(c, how, seed):
    """The configuration with what is known of the arm."""
    if how == 'length':
        c = with_axis(c)
    if how in ('aligned', 'ten', 'length'):
        c = aligned(c.with_options('pcc_delta', twist=TWIST))
    if how in ('ten', 'length'):
        c = taught(c, random_points(np.random.default_rng(seed + 500), 10))
    return c


def swept(job):
    """Errors at rest of the tip and of its reconstruction, each (3, repeats, 5), m; faults that were no faults."""
    plant, seed, known, law, repeats = job
    _, how, feedback = KNOWN[known]
    path = 'unbent' if known.endswith('unbent') else 'direct'
    c = prepared(arm_of(plant, seed, law, route=path), how, seed)
    tips, rebuilt, held = [], [], []
    for points in SWEEPS.values():
        arm = LoopedArm(c, feedback)
        for _ in range(repeats):
            for point in points:
                if known == 'wrong way':
                    arm.go(bent_already(arm, point), 2.0)
                way = arm.go(point, 2.0 * REST_S if path == 'unbent' else REST_S)
                tips.append(np.linalg.norm(way[-AT_REST:] - point, axis=-1).mean())
                arm.orientations, arm.said = arm.plant.imu_orientations, arm.plant.said_lengths
                rebuilt.append(np.linalg.norm(arm.estimated()[0] - arm.plant.tip))
        held += [arm.held] if arm.held else []
    shape = (len(SWEEPS), repeats, -1)
    return np.reshape(tips, shape), np.reshape(rebuilt, shape), held


def bent_already(arm, point):
    """Where the tip is if the arm is bent as at a point, and as long as it is."""
    q = arc_to(point)
    q[2] = arm.estimated()[1][-1]
    return arm.arcs.backbone(q).positions(arm.end)[0]


def stepped(job):
    """Overshoot, as a share of the way, and time until 5 % of it are left, s, of steps of the target."""
    plant, seed, law, late = job
    arm = LoopedArm(prepared(arm_of(plant, seed, law), 'aligned', seed), 'model', late)
    found = []
    for point in random_points(np.random.default_rng(seed), 5):
        start = arm.plant.tip
        way = arm.go(point, 6.0)
        end = way[-AT_REST:].mean(axis=0)
        far = np.linalg.norm(end - start)
        along = (way - start) @ (end - start) / far**2
        outside = np.flatnonzero(np.linalg.norm(way - end, axis=-1) > max(0.05 * far, 0.003))
        found.append((max(along.max() - 1.0, 0.0), DT * (outside[-1] + 1 if len(outside) else 0)))
    return np.array(found), arm.held


def injured(job):
    """Why it held after an IMU froze, and after one was knocked by 30°; empty where it went on."""
    plant, seed = job
    rng = np.random.default_rng(seed)
    first, second = random_points(rng, 2)
    second[:2] = -first[:2]
    reasons = []
    for fault in ('frozen', 'knocked'):
        arm = LoopedArm(prepared(arm_of(plant, seed), 'aligned', seed))
        arm.go(first, 2.0)
        before = arm.held
        if fault == 'frozen':
            arm.frozen = arm.orientations[-2].copy()
            arm.go(second, 3.0)
        else:
            azimuth = rng.uniform(0.0, 2.0 * np.pi)
            arm.turned_tip = from_rotation_vector(
                np.deg2rad(30.0) * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
            )
            arm.run(1.0)
        reasons.append('' if before else arm.held)
    return reasons


def undisturbed(job):
    """A minute of sweeps and rests: why it held without reason, or empty."""
    plant, seed, law = job
    rng = np.random.default_rng(seed)
    arm = LoopedArm(arm_of(plant, seed, law))
    for point in random_points(rng, 12):
        arm.go(point, 5.0)
    return arm.held


def of_several(job):
    """Mean error at rest, m, of five random shapes, and the time of one step of the controller, s."""
    plant, seed, m, known = job
    _, how, feedback = KNOWN[known]
    c = prepared(arm_of(plant, seed, segments=m), how, seed)
    arm, rng = LoopedArm(c, feedback), np.random.default_rng(seed)
    errors, steps = [], []
    step = arm.controller.step

    def timed(*now):
        before = time.perf_counter()
        out = step(*now)
        steps.append(time.perf_counter() - before)
        return out

    arm.controller.step = timed
    for _ in range(5):
        theta, azimuth = rng.uniform(0.1, 0.7, m), rng.uniform(0.0, 2.0 * np.pi, m)
        q = np.stack(
            [theta * np.cos(azimuth), theta * np.sin(azimuth), rng.uniform(0.105, 0.125, m)], axis=-1
        )
        point = arm.arcs.backbone(q.ravel()).positions(arm.end)[0]
        way = arm.go(point, 5.0)
        errors.append(np.linalg.norm(way[-AT_REST:] - point, axis=-1).mean())
    return np.mean(errors), np.median(steps) if steps else 0.0, arm.held


def main():
    """Run all, write docs/loop.md and docs/loop.png."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--arms', type=int, default=3, help='arms of each kind, of the table')
    parser.add_argument('--repeats', type=int, default=5, help='of each sweep of the figure')
    parser.add_argument('--minutes', type=int, default=10, help='without a fault, of each kind')
    parser.add_argument('--processes', type=int, default=min(2, os.cpu_count() or 1))
    options = parser.parse_args()
    page = ROOT / 'docs/loop.md'
    lines = ['# The tip driven by what the arm feels', '', INTRODUCTION.strip()]
    begun = time.perf_counter()
    with ProcessPoolExecutor(options.processes) as pool:

        def every(work, jobs):
            """What is found, by job."""
            jobs = list(jobs)
            return dict(zip(jobs, pool.map(work, jobs), strict=True))

        for section in sections(every, options):
            lines += ['', *section]
            print('\n'.join(['', *section]), flush=True)
            page.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    print(f'\n{time.perf_counter() - begun:.0f} s in {options.processes} processes')


def sections(every, options):
    """Parts of the page, each as soon as it is measured."""
    seeds = [FIRST_SEED + k for k in range(options.arms)]
    laws = [(k, law) for k in KNOWN for law in (('paper', 'rates') if k in BOTH_LAWS else ('rates',))]
    one = every(swept, [(p, s, k, law, 1) for p in PLANTS for k, law in laws for s in seeds])
    arms = f'{len(seeds)} arm{"s" * (len(seeds) > 1)} of each kind, each once through the 15 points.'
    yield [
        '## Error at rest',
        '',
        arms,
        '',
        *table_of_errors(one, laws, seeds),
        '',
        *WHICH_LAW.strip().split('\n'),
    ]

    late = every(
        stepped, [(p, s, law, n) for p in PLANTS for law in GAINS for n in (0, 15) for s in seeds[:2]]
    )
    yield ['## On the way', '', *table_of_ways(late)]

    hurt = every(injured, [('mild', 2001 + k) for k in range(15)])
    minutes = range(options.minutes)
    calm = every(undisturbed, [(p, 3001 + k, ('rates', 'paper')[k % 2]) for p in PLANTS for k in minutes])
    yield ['## Faults', '', *table_of_faults(hurt, calm, one.values())]

    compared = (('none', 'rates'), ('paper', 'paper'), ('paper', 'rates'))
    five = every(swept, [('heavy', FIRST_SEED, known, law, options.repeats) for known, law in compared])
    draw(five, ROOT / 'docs/loop.png')
    yield ['## Sweeps repeated on one arm', '', *table_of_sweeps(five, options.repeats)]

    several = every(of_several, [('mild', s, m, k) for m in (2, 3) for k in SEVERAL for s in seeds])
    yield ['## Two and three segments', '', *table_of_several(several, seeds)]


INTRODUCTION = """
Written by `make loop`: simulated arms of one segment (`plant`), swept through five points each in x, y and z. Heavy
slip is sized so that open loop errs as in the paper; mild is less slip, and BNO055s as they are. Errors are those of
the true tip after 4 s at a target (8 s with `route: unbent`), cm, and in brackets the share of open loop. The plant is
ours: its slip law is a guess, and another arm may slip otherwise.

The paper (Hughes, Stella, Della Santina, Rus 2020): on an arm of about 20 cm the closed loop halves the error of the
tip on average; the reconstruction errs by 2.7 ± 1.2 cm.
"""

WHICH_LAW = """
What the racks slip in common no orientation tells, so it stays as an error of length. They slip where the arm is bent:
the way there counts far more than the law. Led directly, `paper` slips less in common than `rates`, as it closes the
length before the slipping bend; which of them ends nearer differs from arm to arm. `rates` with `route: direct` suits
targets that move; `route: unbent` goes by way of the straight arm and takes longer.
"""


def row(*cells):
    """Of a table."""
    return '| ' + ' | '.join(str(cell) for cell in cells) + ' |'


def head(*cells):
    """Of a table."""
    return [row(*cells), row(*['---'] * len(cells))]


def table_of_errors(found, laws, seeds):
    """Mean error of the arms, and share of open loop."""
    lines = head('', 'law', *(f'{p} slip, cm' for p in PLANTS), *(f'{p}: reconstruction, cm' for p in PLANTS))
    for known, law in laws:
        cells, rebuilt = [], []
        for plant in PLANTS:
            at = [found[plant, s, known, law, 1] for s in seeds]
            error = 100.0 * np.mean([tips for tips, _, _ in at])
            if known == 'none':
                cells.append(f'{error:.2f}')
            else:
                opened = 100.0 * np.mean([found[plant, s, 'none', 'rates', 1][0] for s in seeds])
                cells.append(f'{error:.2f} ({100.0 * error / opened:.0f} %)')
            each = 100.0 * np.array([r for _, r, _ in at])
            rebuilt.append('' if known == 'truth' else f'{each.mean():.1f} ± {each.std():.1f}')
        name = KNOWN[known][0]
        lines.append(row(name, '' if known == 'none' else f'`{law}`', *cells, *rebuilt))
    return lines


def table_of_sweeps(found, repeats):
    """By axis: mean error, and the spread over the repeats."""
    lines = head(
        '', *(f'{axis}, cm' for axis in SWEEPS), 'all, cm', 'share', f'spread of {repeats} repeats, cm'
    )
    opened = np.mean(next(iter(found.values()))[0])
    for (_, _, known, law, _), (tips, _, _) in found.items():
        tips = 100.0 * tips
        name = KNOWN[known][0] + ('' if known == 'none' else f', `{law}`')
        share = '' if known == 'none' else f'{tips.mean() / opened:.0f} %'
        lines.append(
            row(
                name,
                *(f'{t.mean():.2f}' for t in tips),
                f'{tips.mean():.2f}',
                share,
                f'{tips.std(axis=1).mean():.2f}',
            )
        )
    return [*lines, '', '![Errors of the sweeps](loop.png)']


def table_of_ways(found):
    """Overshoot and time to settle."""
    lines = head('slip', 'law', 'more latency', 'overshoot, median (worst)', 'settled, median (worst)')
    for plant, law, late in sorted({(p, law, n) for p, _, law, n in found}):
        ways = np.concatenate(
            [w for (p, _, x, n), (w, _) in found.items() if (p, x, n) == (plant, law, late)]
        )
        over, settled = 100.0 * ways[:, 0], ways[:, 1]
        lines.append(
            row(
                plant,
                f'`{law}`',
                f'{1e3 * late * DT:.0f} ms',
                f'{np.median(over):.1f} % ({over.max():.0f} %)',
                f'{np.median(settled):.2f} s ({settled.max():.1f} s)',
            )
        )
    return lines


def table_of_faults(hurt, calm, others):
    """Held where it should, and not where not."""
    frozen, knocked = (sum(bool(reasons[k]) for reasons in hurt.values()) for k in (0, 1))
    wrong = [why for why in calm.values() if why]
    in_sweeps = sum(len(held) for _, _, held in others)
    lines = head('', 'held')
    lines.append(row('IMU at the tip frozen, target moves', f'{frozen} of {len(hurt)}'))
    lines.append(row('IMU at the tip knocked by 30°', f'{knocked} of {len(hurt)}'))
    for plant in PLANTS:
        of_it = [why for (p, _, _), why in calm.items() if p == plant]
        lines.append(
            row(f'{plant} slip, {len(of_it)} minutes of motion and rest', f'{sum(map(bool, of_it))} of 0')
        )
    lines.append(row('all sweeps above', f'{in_sweeps} of 0'))
    return [*lines, *(f'\nHeld without a fault: {why}.' for why in sorted(set(wrong)))]


def table_of_several(found, seeds):
    """Error at rest and time of a step."""
    lines = head('segments', *(KNOWN[k][0] for k in SEVERAL), 'one step')
    for m in (2, 3):
        mean = {k: 100.0 * np.mean([found['mild', s, m, k][0] for s in seeds]) for k in SEVERAL}
        cells = [
            f'{e:.2f} cm' if k == 'none' else f'{e:.2f} cm ({100.0 * e / mean["none"]:.0f} %)'
            for k, e in mean.items()
        ]
        steps = np.median([found['mild', s, m, 'aligned'][1] for s in seeds])
        lines.append(row(m, *cells, f'{1e3 * steps:.2f} ms'))
    return lines


def draw(found, path):
    """Error by position of each sweep, mean and spread of the repeats."""
    import matplotlib

    matplotlib.use('Agg')
    import matplotlib.pyplot as plt

    from sesa2.evaluation.plots import SERIES_COLOURS, STYLE

    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(1, len(SWEEPS), figsize=(9.0, 2.8), sharey=True, layout='constrained')
        for k, (panel, (axis, points)) in enumerate(zip(panels, SWEEPS.items(), strict=True)):
            at = 100.0 * points[:, 'xyz'.index(axis)]
            for colour, ((_, _, known, law, _), (tips, _, _)) in zip(
                (SERIES_COLOURS[1], SERIES_COLOURS[3], SERIES_COLOURS[0]), found.items(), strict=True
            ):
                name = 'open loop' if known == 'none' else f'closed loop, {law}'
                each = 100.0 * tips[k]
                panel.errorbar(
                    at,
                    each.mean(axis=0),
                    each.std(axis=0),
                    color=colour,
                    marker='o',
                    ms=3.5,
                    capsize=2.5,
                    label=name,
                )
            panel.set_xlabel(f'{axis} wanted, cm')
            panel.set_ylim(bottom=0.0)
        panels[0].set_ylabel('error of the tip, cm')
        panels[-1].legend(loc='upper left', fontsize=8)
        figure.savefig(path, metadata={'Software': None})


if __name__ == '__main__':
    main()
