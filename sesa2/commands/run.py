"""`sesa2 run`: start the nodes that a configuration asks for."""

import argparse
from dataclasses import replace
from pathlib import Path

from sesa2.commands.arguments import (
    add_config,
    load_config,
    names,
    namespace,
    not_negative,
    port_number,
    positive,
)
from sesa2.configuration import Configuration, files
from sesa2.errors import Sesa2Error
from sesa2.ros.signals import stop_on_signals


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command; what is given overrides the configuration."""
    add_config(parser)
    parser.add_argument(
        '--source', choices=('serial', 'sim', 'bag', 'external'), help='where orientations come from'
    )
    parser.add_argument(
        '--mode', choices=('stream', 'calibrate'), help='estimate the shape, or calibrate the sensors'
    )
    parser.add_argument(
        '--port',
        type=names,
        action='extend',
        metavar='PORT[,PORT…]',
        help='serial port of the board; of several boards all, in their order',
    )
    parser.add_argument('--bag', help='recording to play')
    parser.add_argument(
        '--trial', metavar='TRIAL', help='with --source sim: play the motion of this simulated trial'
    )
    parser.add_argument('--rate', type=positive, help='speed of playing; 1 is real time')
    parser.add_argument('--start', type=not_negative, metavar='S', help='where in the bag to start, s')
    parser.add_argument('--loop', action='store_true', default=None, help='play the bag again and again')
    parser.add_argument('--clock', action='store_true', default=None, help="publish the bag's time on /clock")
    parser.add_argument('--record', metavar='BAG', help='record into this bag')
    parser.add_argument(
        '--viewer',
        nargs='?',
        const=8080,
        type=port_number,
        metavar='PORT',
        help='show a page with the arm and a control panel (on port 8080; 0: any that is free)',
    )
    parser.add_argument(
        '--files',
        type=Path,
        metavar='DIR',
        help='with --viewer: files may be chosen on the page under this folder (default: the present one)',
    )
    parser.add_argument(
        '--namespace',
        type=namespace,
        default='/',
        metavar='NS',
        help='of all nodes and topics, one for each arm',
    )
    parser.add_argument('--duration', type=positive, metavar='S', help='end after this time, s')


def run(options: argparse.Namespace) -> int:
    """Run until Ctrl-C, SIGTERM, the end of the bag or the given time."""
    c = _override(load_config(options), options)
    if options.files and not options.files.is_dir():
        raise Sesa2Error(f'--files {options.files}: no such folder')
    with stop_on_signals() as stop:
        from sesa2.system.run import run as run_system

        run_system(
            c,
            stop,
            options.duration,
            viewer_port=options.viewer,
            namespace=options.namespace,
            origin=files.origin(options.config),
            folder=options.files,
        )
    return 0


def _override(c: Configuration, options: argparse.Namespace) -> Configuration:
    given = {
        k: getattr(options, k) for k in ('source', 'mode', 'bag', 'rate', 'start', 'loop', 'clock', 'trial')
    }
    c = replace(c, run=replace(c.run, **{k: v for k, v in given.items() if v is not None}))
    if options.port is not None:
        c = replace(c, serial=c.serial.on(options.port))
    if options.record is not None:
        c = replace(c, record=replace(c.record, file=options.record))
    return files.parse(files.dump(c), f'{options.config} with the command line')
