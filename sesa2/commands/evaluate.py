"""`sesa2 evaluate`: error of estimates against motion capture."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sesa2.commands.arguments import names, not_negative, warn
from sesa2.configuration import Configuration, files
from sesa2.configuration.description import table
from sesa2.errors import Sesa2Error
from sesa2.evaluation.evaluate import Evaluation, evaluate
from sesa2.evaluation.trajectory import Trajectory
from sesa2.evaluation.truth import read_csv


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        'estimates', metavar='EST', nargs='+', type=Path, help='bags that `replay` or the recorder wrote'
    )
    parser.add_argument(
        '--truth', required=True, type=Path, metavar='T', help='CSV of marker positions, or a bag'
    )
    parser.add_argument(
        '--truth-topic', default='truth/markers', help='PoseArray in a bag (default: truth/markers)'
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
    evaluated = []
    for path in options.estimates:
        c, estimates, backbone = _read_estimate(path, options.models)
        truth, left_out = _read_truth(options.truth, options.truth_topic, c.markers.names)
        warn(left_out)
        arc_lengths = dict(zip(c.markers.names, c.markers.positions, strict=True))
        evaluation = evaluate(
            estimates,
            truth,
            arc_lengths,
            register=options.register,
            fit_fraction=options.fit_fraction,
            time_offset=options.time_offset,
        )
        warn(evaluation.warnings)
        evaluated.append((path.name, evaluation, backbone))
    if options.json:
        figures = {label: evaluation.to_json() for label, evaluation, _ in evaluated}
        print(json.dumps(figures[evaluated[0][0]] if len(evaluated) == 1 else figures, indent=2))
    else:
        for label, evaluation, _ in evaluated:
            print('\n'.join(_lines(label, evaluation)))
    if options.report:
        from sesa2.evaluation.backbone import Backbone
        from sesa2.evaluation.page import Trial
        from sesa2.evaluation.report import write_report

        trials = [Trial(label, evaluation, Backbone(*pose)) for label, evaluation, pose in evaluated]
        print(f'report: {write_report(options.report, trials)}')
    return 0


def _offset(text: str) -> float | None:
    return None if text == 'auto' else float(text)


def _read_estimate(
    path: Path, models: Sequence[str] | None
) -> tuple[Configuration, dict[str, Trajectory], tuple[np.ndarray, np.ndarray]]:
    """Configuration, marker trajectories by model, and a pose: arc lengths and positions of a bent backbone."""
    from sesa2.bags.reading import read_configuration, read_path, read_poses
    from sesa2.shape.models import create_model

    text = read_configuration(path)
    if text is None:
        raise Sesa2Error(f'{path}: has no topic configuration, expected a bag that sesa2 wrote')
    c = files.parse(text, f'configuration in {path}')
    if not c.markers.names:
        raise Sesa2Error(f'{path}: its configuration has no markers, expected at least one to compare')
    chosen = models or c.models
    estimates = {}
    for name in chosen:
        poses = read_poses(path, f'{name}/markers')
        times, positions = _increasing(poses.times_s, poses.positions)
        estimates[name] = Trajectory(times, positions, c.markers.names)
    # For the figures: a pose that shows the arm well bent, its last marker being a median distance from the base.
    model = create_model(chosen[-1], c.geometry, **c.model_options(chosen[-1]))
    reach = np.linalg.norm(poses.positions[:, -1], axis=-1)
    pose = read_path(path, f'{chosen[-1]}/shape', int(np.argsort(reach)[len(reach) // 2]))
    return c, estimates, (model.link_ends, pose)


def _read_truth(path: Path, topic: str, markers: Sequence[str]) -> tuple[Trajectory, tuple[str, ...]]:
    if path.suffix == '.csv':
        return read_csv(path, markers)
    from sesa2.bags.reading import read_poses

    poses = read_poses(path, topic)
    if poses.positions.shape[1] != len(markers):
        raise Sesa2Error(
            f'{path}: {topic} has {poses.positions.shape[1]} poses, expected {len(markers)}: {", ".join(markers)}'
        )
    times, positions = _increasing(poses.times_s, poses.positions)
    return Trajectory(times, positions, tuple(markers)), ()


def _increasing(times: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Without what was recorded a second time: of a bag that was looped, the first round."""
    first = np.concatenate([[True], times[1:] > np.maximum.accumulate(times)[:-1]])
    return times[first], positions[first]


def _lines(label: str, evaluation: Evaluation) -> list[str]:
    offset, registration = evaluation.time_offset, evaluation.registration
    lines = [f'{label}: time offset {1e3 * offset.seconds:+.1f} ms, registration {registration.kind}']
    rows = [
        (
            model,
            marker,
            f'{e.median_mm:.1f} ({e.median_pct:.2f} %)',
            f'{e.q3_mm:.1f} ({e.q3_pct:.2f} %)',
            f'{e.rmse_mm:.1f}',
            e.n,
        )
        for model, errors in evaluation.models.items()
        for marker, e in errors.items()
    ]
    return lines + table(('model', 'marker', 'median [mm]', 'Q3 [mm]', 'RMSE [mm]', 'n'), rows)
