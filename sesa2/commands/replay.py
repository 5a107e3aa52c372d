"""`sesa2 replay`: the estimator over a whole recording, as fast as the machine can."""

import argparse
import time
from pathlib import Path

from sesa2.commands.arguments import add_config, load_config, names, progress, warn


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        'source',
        metavar='IN',
        nargs='+',
        help='a recording; or the log of each IMU, in the order of imus.ids or as ID=FILE',
    )
    add_config(parser)
    parser.add_argument('--out', required=True, type=Path, help='bag to write; must not exist')
    parser.add_argument(
        '--models', type=names, metavar='A,B', help="models to run instead of the configuration's"
    )
    parser.add_argument(
        '--first-id', type=int, metavar='N', help='id in a ROS 1 bag that is IMU 1 (default: the lowest)'
    )


def run(options: argparse.Namespace) -> int:
    """Replay, and say what was read, left out and written."""
    from sesa2.bags.replay import replay
    from sesa2.bags.sensor_logs import assign_logs

    configuration = load_config(options)
    source = assign_logs(options.source, configuration.imus.all_ids)
    began = time.perf_counter()
    summary = replay(
        source,
        configuration,
        options.out,
        models=options.models,
        first_id=options.first_id,
        progress=progress('replay'),
    )
    took = time.perf_counter() - began
    warn(summary.warnings)
    print(
        f'{options.out}: {summary.sweeps + summary.field_sweeps} sweeps of {summary.duration:.1f} s in {took:.1f} s '
        f'({summary.duration / took:.0f} × real time), {sum(summary.messages.values())} messages'
    )
    return 0
