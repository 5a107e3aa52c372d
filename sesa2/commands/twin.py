"""`sesa2 twin`: a simulated trial of the configured arm, with IMUs that err like real ones and the truth."""

import argparse
import math
import os
from dataclasses import fields, replace
from pathlib import Path

from sesa2.commands.arguments import add_config, finite, load_config, natural, positive, progress
from sesa2.errors import Sesa2Error
from sesa2.sensing.imu.error_model import Bno055Errors


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_config(parser, 'prototype3_8')
    parser.add_argument(
        '--out', required=True, type=Path, metavar='TRIAL', help='bag to write; must not exist'
    )
    parser.add_argument('--seconds', type=positive, default=250.0, metavar='N', help='length (default: 250)')
    parser.add_argument(
        '--seed', type=natural, default=1, metavar='K', help='of motion and errors (default: 1)'
    )
    parser.add_argument(
        '--twist', type=finite, default=0.0, metavar='RAD', help='twist that the hand applies besides, rad'
    )
    parser.add_argument(
        '--error',
        action='append',
        default=[],
        metavar='SOURCE=VALUE',
        help='size of an error, SI units; 0 turns it off. Sources: '
        + ', '.join(f.name for f in fields(Bno055Errors)),
    )


def run(options: argparse.Namespace) -> int:
    """Simulate and write."""
    from sesa2.bags.trial_bag import MeasuredLengths, write_trial
    from sesa2.twin.growing import simulate_growing
    from sesa2.twin.simulation import simulate

    c = load_config(options)
    if options.out.exists():
        raise Sesa2Error(f'{options.out}: exists already, expected the name of a new trial')
    folder = options.out.resolve().parent
    if not os.access(folder, os.W_OK | os.X_OK):  # before minutes are spent
        raise Sesa2Error(f'{options.out}: cannot be written: {folder} is no folder that may be written into')
    show = progress('twin')
    report = (lambda done: show(round(1000 * done), 1000)) if show else None
    errors = replace(Bno055Errors(), **dict(map(_error, options.error)))
    if c.has_lengths:
        if options.twist:
            raise Sesa2Error(
                '--twist: the arm whose lengths are measured has no hand that twists it, expected 0'
            )
        grown = simulate_growing(c, options.seconds, options.seed, report, errors=errors)
        trial, lengths = grown.trial, MeasuredLengths(grown.length_times, grown.lengths)
    else:
        trial, lengths = (
            simulate(c, options.seconds, options.seed, report, errors=errors, twist=options.twist),
            None,
        )
    write_trial(trial, c, options.out, lengths)
    print(f'{options.out}: {options.seconds:g} s, {len(trial.stamps)} sweeps, truth on /truth/markers')
    return 0


def _error(text: str) -> tuple[str, float]:
    name, equals, value = text.partition('=')
    known = {f.name for f in fields(Bno055Errors)}
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if name not in known or not equals or not number >= 0.0:
        raise Sesa2Error(
            f'--error {text}: expected SOURCE=VALUE, a number of 0 or more, SOURCE one of {", ".join(sorted(known))}'
        )
    return name, number
