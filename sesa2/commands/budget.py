"""`sesa2 budget`: the error to expect at each marker, by source, before the arm is built (thesis 5.5)."""

import argparse
import json

import numpy as np

from sesa2.commands.arguments import add_config, load_config, natural, positive


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_config(parser)
    parser.add_argument(
        '--bend', type=positive, default=140.0, metavar='DEG', help='how far the arm bends, ° (default: 140)'
    )
    parser.add_argument(
        '--speed', type=positive, default=0.2, metavar='M/S', help='of the farthest marker (default: 0.2)'
    )
    parser.add_argument(
        '--samples', type=int, default=2000, metavar='N', help='shapes to draw (default: 2000)'
    )
    parser.add_argument('--seed', type=natural, default=0, metavar='K', help='of the draws (default: 0)')
    parser.add_argument('--json', action='store_true', help='print JSON')


def run(options: argparse.Namespace) -> int:
    """Simulate and print."""
    from sesa2.evaluation.budget import draw_budget

    budget = draw_budget(
        load_config(options),
        bend=float(np.deg2rad(options.bend)),
        speed=options.speed,
        samples=options.samples,
        seed=options.seed,
    )
    print(json.dumps(budget.json(), indent=2) if options.json else budget.table())
    return 0
