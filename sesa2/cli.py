"""The entry point `sesa2`: what it does is its commands, each a few lines that call the rest of the package."""

import argparse
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from sesa2.configuration import Configuration, files
from sesa2.configuration.description import describe
from sesa2.errors import Sesa2Error
from sesa2.nodes.signals import stop_on_signals
from sesa2.nodes.simulation import make_virtual_board


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Returns
    -------
    Exit code: 0 done, 1 failed with a message on standard error, 2 wrong usage.
    """
    # Line by line also into a pipe, so that what was said before a kill is there.
    sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
    options = _parser().parse_args(arguments)
    try:
        return options.command(options)
    except Sesa2Error as error:
        print(f'error: {error}', file=sys.stderr)
        return 1
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print('interrupted', file=sys.stderr)
        return 128 + signal.SIGINT


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='sesa2', description='Shape of a soft continuum arm from the orientations of IMUs along it.'
    )
    commands = parser.add_subparsers(required=True, metavar='COMMAND')

    run = _command(commands, 'run', _run, 'start the nodes that a configuration asks for')
    _add_config(run)
    run.add_argument(
        '--source', choices=('serial', 'sim', 'bag', 'external'), help='where orientations come from'
    )
    run.add_argument(
        '--mode', choices=('stream', 'calibrate'), help='estimate the shape, or calibrate the sensors'
    )
    run.add_argument('--port', help='serial port of the board')
    run.add_argument('--bag', help='recording to play')
    run.add_argument('--rate', type=_positive, help='speed of playing; 1 is real time')
    run.add_argument('--start', type=_not_negative, metavar='S', help='where in the bag to start, s')
    run.add_argument('--loop', action='store_true', default=None, help='play the bag again and again')
    run.add_argument('--clock', action='store_true', default=None, help="publish the bag's time on /clock")
    run.add_argument('--record', metavar='BAG', help='record into this bag')
    run.add_argument('--duration', type=_positive, metavar='S', help='end after this time, s')

    check = _command(commands, 'check', _check, 'validate a configuration and say what it means')
    check.add_argument('config', metavar='F', help='a file, or the name of a shipped configuration')

    board = _command(commands, 'board', _board, 'a virtual board on a pseudo-terminal')
    _add_config(board, 'prototype3_8')
    board.add_argument('--link', metavar='PATH', type=Path, help='name to give the pseudo-terminal')

    replay = _command(commands, 'replay', _replay, 'the estimator over a whole recording, as fast as it can')
    replay.add_argument(
        'source', metavar='IN', type=Path, help='a ROS 2 bag, or a ROS 1 bag of the predecessor'
    )
    _add_config(replay)
    replay.add_argument('--out', required=True, type=Path, help='bag to write; must not exist')
    replay.add_argument(
        '--models', type=lambda text: tuple(text.split(',')), metavar='A,B', help='models to run'
    )
    replay.add_argument(
        '--first-id', type=int, metavar='N', help='id in a ROS 1 bag that is IMU 1 (default: the lowest)'
    )
    return parser


def _command(
    commands: 'argparse._SubParsersAction[argparse.ArgumentParser]',
    name: str,
    function: Callable[[argparse.Namespace], int],
    summary: str,
) -> argparse.ArgumentParser:
    parser = commands.add_parser(name, help=summary, description=summary[0].upper() + summary[1:] + '.')
    parser.set_defaults(command=function)
    return parser


def _add_config(parser: argparse.ArgumentParser, default: str | None = None) -> None:
    parser.add_argument(
        '--config',
        required=default is None,
        default=default,
        metavar='F',
        help='configuration: a file, or the name of a shipped one'
        + (f' (default: {default})' if default else ''),
    )


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float('inf'):
        raise argparse.ArgumentTypeError(f'got {text}, expected a number above 0')
    return value


def _not_negative(text: str) -> float:
    value = float(text)
    if not 0.0 <= value < float('inf'):
        raise argparse.ArgumentTypeError(f'got {text}, expected 0 or more')
    return value


def _load(options: argparse.Namespace) -> Configuration:
    return files.load(files.find(options.config))


def _check(options: argparse.Namespace) -> int:
    print(describe(files.load(files.find(options.config))))
    return 0


def _run(options: argparse.Namespace) -> int:
    c = _load(options)
    given = {k: getattr(options, k) for k in ('source', 'mode', 'bag', 'rate', 'start', 'loop', 'clock')}
    c = replace(c, run=replace(c.run, **{k: v for k, v in given.items() if v is not None}))
    if options.port is not None:
        c = replace(c, serial=replace(c.serial, port=options.port))
    if options.record is not None:
        c = replace(c, record=replace(c.record, file=options.record))
    c = files.parse(files.dump(c), options.config)
    with stop_on_signals() as stop:
        from sesa2.nodes.system import (
            run,
        )  # ROS takes a second to import, which the other commands do without

        run(c, stop, options.duration)
    return 0


def _board(options: argparse.Namespace) -> int:
    with stop_on_signals() as stop, make_virtual_board(_load(options), options.link) as board:
        print(f'virtual board on {board.path}; in another terminal:')
        print(f'  sesa2 run --config {options.config} --source serial --port {board.path}')
        stop.wait()
    return 0


def _replay(options: argparse.Namespace) -> int:
    from sesa2.bags.replay import replay

    began = time.perf_counter()
    summary = replay(
        options.source,
        _load(options),
        options.out,
        models=options.models,
        first_id=options.first_id,
        progress=_progress('replay') if sys.stderr.isatty() else None,
    )
    took = time.perf_counter() - began
    for warning in summary.warnings:
        print(f'warning: {warning}', file=sys.stderr)
    print(
        f'{options.out}: {summary.sweeps} sweeps of {summary.duration:.1f} s in {took:.1f} s '
        f'({summary.duration / took:.0f} × real time), {sum(summary.messages.values())} messages'
    )
    return 0


def _progress(what: str) -> Callable[[int, int], None]:
    def show(done: int, total: int) -> None:
        end = '\n' if done >= total else ''
        print(f'\r{what}: {100 * done // max(total, 1)} %', end=end, file=sys.stderr, flush=True)

    return show


if __name__ == '__main__':
    sys.exit(main())
