"""`make bench`: the package's speed as a table, each figure beside its peer or its target, measured in this run."""

import argparse
import os
from itertools import chain
from pathlib import Path

import arms
import hour
import live
import replay
import shape
import viewer
from pcc_loop import MissingCompilerError

import firmware

ROOT = Path(__file__).resolve().parents[1]


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=60.0, help='length of each live measurement')
    parser.add_argument(
        '--beside', type=Path, metavar='CHECKOUT', help='replay the hour with this other version too, in turn'
    )
    options = parser.parse_args()
    seconds = options.seconds
    before = busy()
    show('figure', 'measured', 'peer or target', 'ratio')
    show('---', '---', '---', '---')
    for figure, ours, peer, theirs, target in shape.rows():
        show(
            figure,
            f'{1e6 * ours:.1f} µs',
            f'{peer} {1e6 * theirs:.1f} µs',
            f'{theirs / ours:.1f} (target ≥ {target})',
        )
    try:
        ours, theirs = shape.batched_positions()
        show(
            'positions alone, batched, per sweep, pcc',
            f'{1e6 * ours:.1f} µs',
            f'loop in C {1e6 * theirs:.1f} µs',
            f'{ours / theirs:.1f} × (target ≤ 3)',
        )
    except MissingCompilerError as error:
        show('positions alone, batched, per sweep, pcc', 'not measured', str(error), '')
    data = Path(os.environ.get('SESA2_DATA', ROOT.parent / 'shared/data')) / 'twin/trial_A_bno055_seed1.npz'
    if data.exists():
        for figure, value, target in replay.rows(data):
            show(figure, f'{value:.1f} ×', f'≥ {target} × real time' if target else 'does not grow', '')
    else:
        show('replay', 'not measured', f'{data} is absent', '')
    for figure, value, unit, target in hour.rows(options.beside and options.beside.resolve()):
        show(figure, f'{value:.0f} {unit}', target, '')
    for figure, value, limit in firmware.rows():
        show(figure, value, limit, '')
    for figure, value, unit, limit in chain(live.rows(seconds), arms.rows(seconds), viewer.rows(seconds)):
        show(figure, f'{value:.3g} {unit}', '' if limit is None else f'≤ {limit} {unit}', '')
    print(f'\nProcesses that ran or waited: {before} before, {busy()} after; {os.cpu_count()} processors.')


def busy():
    """Mean number of them over the last 1, 5 and 15 minutes."""
    return ' / '.join(f'{load:.1f}' for load in os.getloadavg())


def show(*cells):
    """A row of the table."""
    print('| ' + ' | '.join(cells) + ' |', flush=True)


if __name__ == '__main__':
    main()
