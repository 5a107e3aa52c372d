"""`sesa2 evaluate`: error of estimates against motion capture."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from sesa2.commands.arguments import add_truth_options, names, not_negative, warn
from sesa2.configuration.description import table
from sesa2.errors import Sesa2Error
from sesa2.evaluation.evaluate import Evaluation
from sesa2.evaluation.registration import KINDS

IN_MS = 10.0  # s; a larger offset is one between two clocks, and printed in s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        'estimates', metavar='EST', nargs='+', type=Path, help='bags that `replay` or the recorder wrote'
    )
    parser.add_argument(
        '--truth',
        required=True,
        type=Path,
        metavar='T',
        help='marker positions: a bag, or an export of motion capture',
    )
    add_truth_options(parser)
    parser.add_argument('--models', type=names, metavar='A,B', help='only these models')
    parser.add_argument(
        '--register',
        choices=KINDS,
        default='none',
        help='fit between the frames, and how far the markers are beside the axis (default: none)',
    )
    parser.add_argument(
        '--fit-fraction',
        type=not_negative,
        default=0.5,
        help='part of the trial it is fitted on (default: 0.5)',
    )
    parser.add_argument('--report', type=Path, metavar='DIR', help='write figures and a page there')
    parser.add_argument('--json', action='store_true', help='print JSON')


def run(options: argparse.Namespace) -> int:
    """Evaluate each estimate, print the errors, write the report."""
    from sesa2.evaluation.bag_evaluation import evaluate_bag

    labels = _labels(options.estimates)
    evaluated = []
    for label, path in zip(labels, options.estimates, strict=True):
        evaluation = evaluate_bag(
            path,
            options.truth,
            truth_topic=options.truth_topic,
            markers=dict(options.markers),
            truth_rate=options.truth_rate,
            models=options.models,
            register=options.register,
            fit_fraction=options.fit_fraction,
            time_offset=options.time_offset,
        )
        warn([f'{label}: {w}' if len(labels) > 1 else w for w in evaluation.warnings])
        evaluated.append((label, evaluation))
    if options.json:
        figures = {label: evaluation.to_json() for label, evaluation in evaluated}
        print(json.dumps(figures[evaluated[0][0]] if len(evaluated) == 1 else figures, indent=2))
    else:
        for label, evaluation in evaluated:
            print('\n'.join(_lines(label, evaluation)))
    if options.report:
        from sesa2.evaluation.report import write_report
        from sesa2.evaluation.report_page import EvaluatedTrial

        trials = [EvaluatedTrial(label, evaluation, evaluation.pose) for label, evaluation in evaluated]
        written = write_report(options.report, trials)
        print(f'report: {written}', file=sys.stderr if options.json else sys.stdout)
    return 0


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


def _lines(label: str, evaluation: Evaluation) -> list[str]:
    offset, registration = evaluation.time_offset, evaluation.registration
    s = offset.seconds
    shift = f'{1e3 * s:+.1f} ms' if abs(s) < IN_MS else f'{s:+.4f} s'
    told = f': {registration.told()}' if registration.kind != 'none' else ''
    lines = [f'{label}: time offset {shift}, registration {registration.kind}{told}']
    if (fit := evaluation.similarity) is not None:
        lines.append(f'  not applied: {fit.told()}')
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
