"""`sesa2 evaluate`: error of estimates against motion capture."""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sesa2.commands.arguments import names, not_negative, warn
from sesa2.configuration import Configuration, files
from sesa2.configuration.description import table
from sesa2.errors import Sesa2Error
from sesa2.evaluation.evaluate import Evaluation, evaluate
from sesa2.evaluation.trajectory import Trajectory
from sesa2.evaluation.truth import read_csv
from sesa2.messages.topic_names import TRUTH_MARKERS, of_model
from sesa2.shape.rotations import conjugate, rotate

IN_MS = 10.0  # s; a larger offset is one between two clocks, and printed in s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        'estimates', metavar='EST', nargs='+', type=Path, help='bags that `replay` or the recorder wrote'
    )
    parser.add_argument(
        '--truth', required=True, type=Path, metavar='T', help='CSV of marker positions, or a bag'
    )
    parser.add_argument(
        '--truth-topic', default=TRUTH_MARKERS, help=f'PoseArray in a bag (default: {TRUTH_MARKERS})'
    )
    parser.add_argument('--models', type=names, metavar='A,B', help='only these models')
    parser.add_argument(
        '--register', choices=('none', 'translation', 'rigid'), default='none', help='fit between the frames'
    )
    parser.add_argument(
        '--fit-fraction',
        type=not_negative,
        default=0.5,
        help='part of the trial it is fitted on (default: 0.5)',
    )
    parser.add_argument(
        '--time-offset', type=_offset, default=None, metavar='auto|S', help='s, or found (default: auto)'
    )
    parser.add_argument('--report', type=Path, metavar='DIR', help='write figures and a page there')
    parser.add_argument('--json', action='store_true', help='print JSON')


def run(options: argparse.Namespace) -> int:
    """Evaluate each estimate, print the errors, write the report."""
    labels = _labels(options.estimates)
    evaluated = []
    for label, path in zip(labels, options.estimates, strict=True):
        estimate = _read_estimate(path, options.models)
        c = estimate.configuration
        truth, frame, left_out = _read_truth(options.truth, options.truth_topic, c.markers.names)
        truth, about_frames = _in_one_frame(truth, frame, estimate, options.register)
        arc_lengths = dict(zip(c.markers.names, c.markers.positions, strict=True))
        evaluation = evaluate(
            estimate.models,
            truth,
            {name: arc_lengths[name] for name in truth.names},
            register=options.register,
            fit_fraction=options.fit_fraction,
            time_offset=options.time_offset,
        )
        evaluation = replace(evaluation, warnings=(*left_out, *about_frames, *evaluation.warnings))
        warn([f'{label}: {w}' if len(labels) > 1 else w for w in evaluation.warnings])
        evaluated.append((label, evaluation, estimate.pose))
    if options.json:
        figures = {label: evaluation.to_json() for label, evaluation, _ in evaluated}
        print(json.dumps(figures[evaluated[0][0]] if len(evaluated) == 1 else figures, indent=2))
    else:
        for label, evaluation, _ in evaluated:
            print('\n'.join(_lines(label, evaluation)))
    if options.report:
        from sesa2.evaluation.drawn_pose import DrawnPose
        from sesa2.evaluation.report import write_report
        from sesa2.evaluation.report_page import EvaluatedTrial

        trials = [
            EvaluatedTrial(label, evaluation, DrawnPose(*pose)) for label, evaluation, pose in evaluated
        ]
        written = write_report(options.report, trials)
        print(f'report: {written}', file=sys.stderr if options.json else sys.stdout)
    return 0


def _offset(text: str) -> float | None:
    if text == 'auto':
        return None
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'got {text!r}, expected auto or a number of seconds') from None


def _labels(paths: Sequence[Path]) -> list[str]:
    """The name of each bag, with as many of the directories it is in as tell it from the others."""
    # A link keeps the name that was given; `.` and `..` are none.
    parts = [(path.resolve() if path.name in ('', '..') else path.absolute()).parts for path in paths]
    labels = []
    for path, own in zip(paths, parts, strict=True):
        if parts.count(own) > 1:
            raise Sesa2Error(f'{path}: given {parts.count(own)} times, expected each bag once')
        n = next(n for n in range(1, len(own) + 1) if sum(p[-n:] == own[-n:] for p in parts) == 1)
        labels.append(str(Path(*own[-n:])))
    return labels


class _Estimate(NamedTuple):
    """What is in a bag of estimates.

    Attributes
    ----------
    configuration
        that was in force.
    models
        marker trajectories by model.
    frame
        in which they are.
    pose
        of a bent backbone: arc lengths and positions.
    """

    configuration: Configuration
    models: dict[str, Trajectory]
    frame: str
    pose: tuple[np.ndarray, np.ndarray]


def _read_estimate(path: Path, models: Sequence[str] | None) -> _Estimate:
    from sesa2.bags.reading import read_backbone, read_configuration, read_poses

    text = read_configuration(path)
    if text is None:
        raise Sesa2Error(f'{path}: has no topic configuration, expected a bag that sesa2 wrote')
    c = files.parse(text, f'configuration in {path}')
    if not c.markers.names:
        raise Sesa2Error(f'{path}: its configuration has no markers, expected at least one to compare')
    chosen = models or c.models
    estimates = {}
    for name in chosen:
        poses = read_poses(path, of_model(name, 'markers'))
        times, positions = _increasing(poses.times_s, poses.positions)
        estimates[name] = Trajectory(times, positions, c.markers.names)
    # For the figures: a pose that shows the arm well bent, its last marker being a median distance from the base.
    model = c.create_model(chosen[-1])
    reach = np.linalg.norm(poses.positions[:, -1], axis=-1)
    pose = read_backbone(path, of_model(chosen[-1], 'shape'), int(np.argsort(reach)[len(reach) // 2]))
    return _Estimate(c, estimates, poses.frame, (model.link_ends, pose))


def _read_truth(path: Path, topic: str, markers: Sequence[str]) -> tuple[Trajectory, str, tuple[str, ...]]:
    """Truth, its frame (empty where it is not known), and what was left out."""
    if path.suffix.lower() == '.csv':
        truth, left_out = read_csv(path, markers)
        return truth, '', left_out
    from sesa2.bags.reading import read_poses

    poses = read_poses(path, topic)
    if poses.positions.shape[1] != len(markers):
        raise Sesa2Error(
            f'{path}: {topic} has {poses.positions.shape[1]} poses, expected {len(markers)}: {", ".join(markers)}'
        )
    times, positions = _increasing(poses.times_s, poses.positions)
    return Trajectory(times, positions, tuple(markers)), poses.frame, ()


def _in_one_frame(
    truth: Trajectory, frame: str, estimate: _Estimate, register: str
) -> tuple[Trajectory, tuple[str, ...]]:
    """The truth in the estimate's frame where the way there is known, and what a reader has to know about it."""
    c = estimate.configuration
    if not frame or not estimate.frame or frame == estimate.frame:
        return truth, ()
    if {frame, estimate.frame} == {'world', 'base_link'} and not c.imus.base_id:
        q = c.base if frame == 'base_link' else conjugate(c.base)  # both have their origin at the clamp
        if abs(q[3]) == 1.0:
            return truth, ()
        done = "the truth was turned by arm.base_orientation of the estimate's configuration"
        truth = Trajectory(truth.times, rotate(q, truth.positions), truth.names)
    elif register == 'rigid':
        return truth, ()
    else:
        done = 'the way from one to the other is not known; --register rigid fits it'
    return truth, (f'The truth is in frame {frame}, the estimate in {estimate.frame}: {done}.',)


def _increasing(times: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Without what was recorded a second time: of a bag that was looped, the first round."""
    first = np.concatenate([[True], times[1:] > np.maximum.accumulate(times)[:-1]])
    return times[first], positions[first]


def _lines(label: str, evaluation: Evaluation) -> list[str]:
    offset, registration = evaluation.time_offset, evaluation.registration
    s = offset.seconds
    shift = f'{1e3 * s:+.1f} ms' if abs(s) < IN_MS else f'{s:+.4f} s'
    lines = [f'{label}: time offset {shift}, registration {registration.kind}']
    rows = [
        (
            model,
            marker,
            f'{e.median_mm:.1f} ({e.median_pct:.2f} %)',
            f'{e.q3_mm:.1f} ({e.q3_pct:.2f} %)',
            f'{e.rmse_mm:.1f}',
            e.n,
        )
        if e.n
        else (model, marker, '–', '–', '–', 0)
        for model, errors in evaluation.models.items()
        for marker, e in errors.items()
    ]
    return lines + table(('model', 'marker', 'median [mm]', 'Q3 [mm]', 'RMSE [mm]', 'n'), rows)
