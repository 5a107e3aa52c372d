"""`sesa2 export`: results as arrays that other programs read."""

import argparse
from pathlib import Path

from sesa2.commands.arguments import names, warn
from sesa2.errors import Sesa2Error


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument('estimate', metavar='EST', type=Path, help='bag that `replay` or the recorder wrote')
    parser.add_argument(
        '--out',
        required=True,
        type=Path,
        metavar='F',
        help='file to write, .csv, .npz, .mat or .tum; must not exist. A .tum is the tip by the first model, with the '
        'others and the markers in files beside it',
    )
    parser.add_argument('--models', type=names, metavar='A,B', help='only these models')


def run(options: argparse.Namespace) -> int:
    """Read and write."""
    from sesa2.bags.array_files import write_arrays
    from sesa2.bags.estimate_arrays import read_estimate

    if options.out.exists():  # before an hour's recording is read
        raise Sesa2Error(f'{options.out}: exists already, expected the name of a new file')
    estimate = read_estimate(options.estimate, options.models)
    written = write_arrays(estimate, options.out)
    warn(estimate.problems)
    for path in written:
        print(
            f'{path}: {len(estimate.stamps_ns)} instants, {", ".join(estimate.models)}, in {estimate.frame}'
        )
    return 0
