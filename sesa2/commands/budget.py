"""`sesa2 budget`: the error to expect at each marker, by source, before the arm is built (thesis 5.5)."""

import argparse
import json
from typing import TYPE_CHECKING

import numpy as np

from sesa2.commands.arguments import add_config, load_config, natural, positive
from sesa2.configuration import Configuration
from sesa2.configuration.description import table

if TYPE_CHECKING:
    from sesa2.evaluation.magnetic_budget import MagneticBudget

# Of magnets, whose budget is exact at each shape.
_MOST_SHAPES = 500


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
    """Simulate and print: of the IMUs, of the magnetometers, or of both."""
    from sesa2.evaluation.budget import draw_budget
    from sesa2.evaluation.magnetic_budget import draw_magnetic_budget

    c = load_config(options)
    said, texts = {}, []
    if c.imus.ids:
        budget = draw_budget(
            c,
            bend=float(np.deg2rad(options.bend)),
            speed=options.speed,
            samples=options.samples,
            seed=options.seed,
        )
        said = budget.json()
        texts.append(budget.table())
    if c.magnetometers.ids:
        magnetic = draw_magnetic_budget(c, samples=min(options.samples, _MOST_SHAPES), seed=options.seed)
        said['magnetic'] = magnetic.json()
        texts.append(_magnetic_table(c, magnetic))
    print(json.dumps(said, indent=2) if options.json else '\n\n'.join(texts))
    return 0


def _magnetic_table(c: Configuration, budget: 'MagneticBudget') -> str:
    build = budget.build
    of = (
        f'strength {100 * build.strength:g} %, shift {1e3 * build.shift:g} mm, position {1e3 * build.position:g} mm an '
        f'axis, tilt {np.rad2deg(build.tilt):.1f}° about two, gain {100 * build.gain:g} %, offset '
        f'{1e6 * build.offset:g} µT, earth {1e6 * build.earth:g} µT an axis'
    )
    head = (
        f'Median error (standard deviation) of {budget.samples} shapes from magnetometers, bent up to '
        f'{np.rad2deg(c.segments.bend_max):.0f}° a segment; noise {1e6 * budget.noise:.2g} µT.'
    )
    foot = 'To first order: of large errors it is less than they are. `sesa2 magnets` calibrates.'
    lines = [head, f'Build: {of}.', *table(*budget.rows()), foot]
    return '\n'.join(line.rstrip() for line in lines)
