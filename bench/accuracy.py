"""`make accuracy`: errors on the recordings, as a table in README.md. What is absent is said.

The trials are a simulated one (a Cosserat rod, with errors like a BNO055's: not the paper's arm) and real ones whose
motion-capture frames stand in as perfect IMUs: an arm of three actuated sections, a cable, and a robot that extends and
twists. The paper's figures are of its own arm.
"""

import argparse
import os
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from sesa2.alignment.self_calibration import self_calibrate
from sesa2.bags.replay import replay
from sesa2.configuration import Configuration, files
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep
from sesa2.evaluation.bag_evaluation import evaluate_bag
from sesa2.evaluation.evaluate import evaluate
from sesa2.evaluation.trajectory import Trajectory
from sesa2.shape.arm import Arm
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model

ROOT = Path(__file__).resolve().parents[1]
BEGIN, END = '<!-- accuracy: written by make accuracy -->', '<!-- end of accuracy -->'
DELAY_S = 0.020  # of the simulated sensors
MARKERS = {'M1': 0.36, 'M2': 0.60}


def estimated(c: Configuration, times, orientations):
    """Marker trajectories by model, of IMUs that measured `orientations` (n, n_imu, 4)."""
    all_there = np.ones(orientations.shape[1], bool)
    sweeps = [Sweep(round(t * 1e9), q, all_there, None) for t, q in zip(times, orientations, strict=True)]
    estimate = Estimator(c).estimate(sweeps)
    return {
        name: Trajectory(times, result.markers, tuple(MARKERS)) for name, result in estimate.models.items()
    }


def errors(c, times, orientations, truth):
    """Median error at each marker, % of its arc length, by model, with the known delay taken off."""
    evaluation = evaluate(estimated(c, times, orientations), truth, MARKERS, time_offset=-DELAY_S)
    return {name: [found[m].median_pct for m in MARKERS] for name, found in evaluation.models.items()}


def twin_rows(path):
    """(case, model, M1, M2) on the simulated trial; and how long the self-calibration took, s."""
    with np.load(path) as trial:
        times, q, exact = trial['ti'], trial['q'][:, 1:, [1, 2, 3, 0]], trial['qtrue'][:, 1:, [1, 2, 3, 0]]
        truth = Trajectory(trial['t100'], trial['M100'], tuple(MARKERS))
    c = files.load(ROOT / 'config/prototype3_8.yaml')
    as_in_the_paper = replace(c, models=('rigid',)).with_options('rigid', boundaries='endpoint')
    c = replace(c, models=('rigid', 'pcc', 'pcc_exact', 'spline', 'smooth_rod')).with_options(
        'rigid', boundaries='midpoint'
    )
    began = time.perf_counter()
    found = self_calibrate(times, q, np.ones(q.shape[:2], bool), c.layout, c.base, c.mountings, c.headings)
    took = time.perf_counter() - began
    calibrated = c.with_alignment(found.mountings, found.headings)
    filtered = replace(calibrated, imus=replace(calibrated.imus, heading_filter=True))
    rows = []
    for case, configuration, measured in (
        ("joints as in the paper's Table I, as measured", as_in_the_paper, q),
        ('as measured', c, q),
        ('self-calibrated', calibrated, q),
        ('self-calibrated, heading filter', filtered, q),
        ('sensors without error', c, exact),
    ):
        for model, figures in errors(configuration, times, measured, truth).items():
            midway = ', joints midway' if model == 'rigid' and configuration is not as_in_the_paper else ''
            rows.append((case, f'`{model}`{midway}', *figures))
    return rows, took


def four_imus_rows(path):
    """(case, model, M1, M2) on the simulated trial with every other IMU, self-calibrated."""
    with np.load(path) as trial:
        times, q = trial['ti'], trial['q'][:, 2::2, [1, 2, 3, 0]]
        truth = Trajectory(trial['t100'], trial['M100'], tuple(MARKERS))
    c = files.load(ROOT / 'config/prototype3_4.yaml')
    c = replace(c, models=('pcc_exact', 'spline', 'smooth_rod'))
    found = self_calibrate(times, q, np.ones(q.shape[:2], bool), c.layout, c.base, c.mountings, c.headings)
    calibrated = c.with_alignment(found.mountings, found.headings)
    figures = errors(calibrated, times, q, truth)
    return [('4 IMUs, self-calibrated', f'`{model}`', *of) for model, of in figures.items()]


def cable_rows(folder):
    """(model, first marker, second) on the real cable with five stations, nothing registered or calibrated."""
    c = files.load(folder / 'arm.yaml')
    c = replace(c, models=('pcc_exact', 'spline', 'smooth_rod'))
    with tempfile.TemporaryDirectory() as out:
        replay(folder / 'imu.csv', c, Path(out) / 'cable')
        models = evaluate_bag(Path(out) / 'cable', folder / 'truth.csv', time_offset=0.0).models
    return [(f'`{name}`', *(of[m].median_pct for m in c.markers.names)) for name, of in models.items()]


def hsa_rows(folder):
    """(what, registration, with a constant length, with its length known), mm, on the second halves."""
    rows = []
    for what, file, twist, register in (
        ('extends', '20221011_174514', 'shared', 'offsets'),
        ('twists', '20221012_103309', 'tip', 'rigid+offsets'),
    ):
        table = np.genfromtxt(folder / f'{file}_mocap_frame_data_history.csv', delimiter=',')
        # Their robot stands along +Y, ours along +z; body 2 is its base, 3 its platform.
        turn = Rotation.from_euler('x', -90.0, degrees=True)
        base, platform = (table[table[:, 1] == body] for body in (2, 3))
        b, p = (Rotation.from_quat(body[:, 2:6]) * turn for body in (base, platform))
        q, place = (b.inv() * p).as_quat()[:, None], b.inv().apply(platform[:, 6:] - base[:, 6:])
        distance = np.linalg.norm(place, axis=1)
        rest = float(np.median(distance))
        layout = Layout(Arm(rest), (rest,), (rest,), stretches=True)
        model = create_model('pcc_delta', layout, twist=twist)
        constant = np.full(len(q), rest)
        bend = model.fit(Measured(q, lengths=constant[:, None])).coordinates[:, :2]
        # Known: the arc whose ends are as far apart as the bodies.
        known = distance / np.sinc(np.linalg.norm(bend, axis=1) / (2.0 * np.pi))
        times, left = np.arange(len(q)) / 40.0, []
        for length, kind in ((constant, 'translation'), (known, register)):
            shape = model.fit(Measured(q, lengths=length[:, None]))
            links = q if twist == 'tip' else shape.orientations([rest])
            estimate = {'pcc_delta': Trajectory(times, shape.positions([rest]), ('tip',), links)}
            truth = Trajectory(times, place[:, None], ('tip',))
            found = evaluate(estimate, truth, {'tip': rest}, register=kind, time_offset=0.0)
            left.append(found.models['pcc_delta']['tip'].median_mm)
        rows.append((what, f'`pcc_delta`, `twist: {twist}`', register, *left))
    return rows


def softarm_rows(path):
    """(case, tip %) of `pcc_exact` on the real arm; fitted on the first half, scored on the second."""
    lines = np.genfromtxt(path, delimiter=',', skip_header=1)[:, 1:]
    frames = lines.reshape(len(lines), 4, 6)
    p = frames[..., :3]
    R = Rotation.from_euler('ZYX', frames[..., [5, 4, 3]].reshape(-1, 3), degrees=True)
    # Their arm lies along +Y, ours along +z.
    q = (R * Rotation.from_euler('x', -90.0, degrees=True)).as_quat().reshape(len(lines), 4, 4)
    along = Rotation.from_quat(q.reshape(-1, 4)).apply([0.0, 0.0, 1.0]).reshape(len(lines), 4, 3)
    chord = np.linalg.norm(p[:, 3] - p[:, 2], axis=1)
    bend = np.degrees(np.arccos(np.clip((along[:, 3] * along[:, 2]).sum(axis=1), -1.0, 1.0)))
    tracked = (chord >= 0.195) & (chord <= 0.212) & (bend <= 60.0)
    p, q = p[tracked], q[tracked]
    ends = np.cumsum([0.2116, 0.2103, 0.2092])
    model = create_model('pcc_exact', Layout(Arm(float(ends[-1])), tuple(ends.tolist())))
    half = len(p) // 2
    times = np.arange(len(p), dtype=float)
    names = ('low', 'middle', 'up')
    truth = Trajectory(times, p[:, 1:], names)

    def shape(offsets):
        """Ends of the sections; offsets: turns of the four frames against the arm, base first, (4, 3), rad."""
        frames = [
            (Rotation.from_quat(q[:, k]) * Rotation.from_rotvec(offset)).as_quat()
            for k, offset in enumerate(offsets)
        ]
        return model.fit(Measured(np.stack(frames[1:], axis=1), frames[0])).positions(ends) + p[:, :1]

    def tip(points, register):
        estimate = {'pcc_exact': Trajectory(times, points, names)}
        arc_lengths = dict(zip(names, ends, strict=True))
        found = evaluate(estimate, truth, arc_lengths, register=register, fit_fraction=0.5, time_offset=0.0)
        return found.models['pcc_exact']['up'].median_pct

    def placed(x):
        """Where the frames should be: x holds their turns, (4, 3), rad, and places beside the axis, (4, 3), m."""
        turns, beside = x.reshape(2, 4, 3)
        away = [Rotation.from_quat(q[:, k]).apply(beside[k]) for k in range(4)]
        return shape(turns) - away[0][:, None] + np.stack(away[1:], axis=1)

    # The norm is soft, so that rows which were mistracked do not pull.
    fit = least_squares(
        lambda x: (placed(x) - p[:, 1:])[:half].ravel(), np.zeros(24), loss='soft_l1', f_scale=0.005
    ).x
    second = np.linalg.norm((placed(fit) - p[:, 1:])[half:, 2], axis=1)
    return [
        ('raw', tip(shape(np.zeros((4, 3))), 'none')),
        ('translation', tip(shape(np.zeros((4, 3))), 'translation')),
        ("the frames' offsets", 100.0 * float(np.median(second)) / float(ends[-1])),
    ]


def table(data):
    """The table, as lines of Markdown."""
    lines = [
        '| median error, % of arc length | M1 (0.36 m) | M2 (0.60 m) | where |',
        '|---|---|---|---|',
        '| the paper: rigid, 8 IMUs | 13.3 | 11.8 | its real arm, Table II |',
        '| the paper: PCC-extended, 16 segments | 10.2 | 9.1 | its real arm, Table II |',
    ]
    trial = data / 'twin/trial_A_bno055_seed1.npz'
    if trial.exists():
        rows, took = twin_rows(trial)
        lines += [
            f'| {model}, {case} | {m1:.2f} | {m2:.2f} | simulated trial, 250 s |'
            for case, model, m1, m2 in [*rows, *four_imus_rows(trial)]
        ]
        print(f'self-calibration of 250 s: {took:.1f} s', file=sys.stderr)
    else:
        lines.append(f'| not measured: {trial.name} is absent | | | |')
    real = data / 'softarm/optitrack_first_1500_rows.csv'
    if real.exists():
        lines += [
            f'| `pcc_exact`, registration: {case} | | tip {figure:.2f} | real arm of three sections, second half |'
            for case, figure in softarm_rows(real)
        ]
    else:
        lines.append(f'| not measured: {real.name} is absent | | | |')
    cable = data / 'cable'
    if cable.is_dir():
        lines += [
            f'| {model}, five stations (markers at 0.50 and 0.91 m) | {m1:.2f} | {m2:.2f} | real cable, 1.01 m |'
            for model, m1, m2 in cable_rows(cable)
        ]
    else:
        lines.append('| not measured: the cable is absent | | | |')
    hsa = data / 'hsa'
    if hsa.is_dir():
        lines += [
            f'| {model}, registration: {register} | | tip {known:.2f} mm with its length known '
            f'(a constant one and a translation: {constant:.1f} mm) | real robot that {what}, 0.13 m, second half |'
            for what, model, register, constant, known in hsa_rows(hsa)
        ]
    else:
        lines.append('| not measured: the robot that extends and twists is absent | | | |')
    return lines


def main():
    """Measure, print, and write into the README."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--dry', action='store_true', help='print only')
    dry = parser.parse_args().dry
    lines = table(Path(os.environ.get('SESA2_DATA', ROOT.parent / 'shared/data')))
    print('\n'.join(lines))
    if not dry:
        readme = ROOT / 'README.md'
        before, _, rest = readme.read_text().partition(BEGIN)
        _, _, after = rest.partition(END)
        readme.write_text('\n'.join([before + BEGIN, *lines, END + after]))


if __name__ == '__main__':
    main()
