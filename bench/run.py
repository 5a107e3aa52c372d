"""`make bench`: the package's speed as a table, each figure beside its peer or its target, measured in this run."""

import argparse
import os
from itertools import chain
from pathlib import Path

import live
import replay
import shape
import viewer

import firmware

ROOT = Path(__file__).resolve().parents[1]


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=60.0, help='length of each live measurement')
    seconds = parser.parse_args().seconds
    show('figure', 'measured', 'peer or target', 'ratio')
    show('---', '---', '---', '---')
    for figure, ours, peer, theirs, target in shape.rows():
        show(
            figure,
            f'{1e6 * ours:.1f} µs',
            f'{peer} {1e6 * theirs:.1f} µs',
            f'{theirs / ours:.1f} (target ≥ {target})',
        )
    data = Path(os.environ.get('SESA2_DATA', ROOT.parent / 'shared/data')) / 'twin/trial_A_bno055_seed1.npz'
    if data.exists():
        for figure, value, target in replay.rows(data):
            show(figure, f'{value:.1f} ×', f'≥ {target} × real time' if target else 'does not grow', '')
    else:
        show('replay', 'not measured', f'{data} is absent', '')
    for figure, value, limit in firmware.rows():
        show(figure, value, limit, '')
    for figure, value, unit, limit in chain(live.rows(seconds), viewer.rows(seconds)):
        show(figure, f'{value:.3g} {unit}', '' if limit is None else f'≤ {limit} {unit}', '')


def show(*cells):
    """A row of the table."""
    print('| ' + ' | '.join(cells) + ' |', flush=True)


if __name__ == '__main__':
    main()
