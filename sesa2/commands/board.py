"""`sesa2 board`: virtual boards on pseudo-terminals."""

import argparse
from contextlib import ExitStack
from pathlib import Path

from sesa2.commands.arguments import add_config, load_config
from sesa2.ros.signals import stop_on_signals


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_config(parser, 'prototype3_8')
    parser.add_argument(
        '--link',
        metavar='PATH',
        type=Path,
        help='name to give the pseudo-terminal; the second board has it with a 2 after it',
    )


def run(options: argparse.Namespace) -> int:
    """Serve until Ctrl-C or SIGTERM."""
    # Here, since the other commands run where there are no pseudo-terminals too.
    from sesa2.system.virtual_source import make_virtual_boards

    with stop_on_signals() as stop, ExitStack() as stack:
        boards = make_virtual_boards(load_config(options), options.link)
        for board in boards:
            stack.callback(board.close)
            print(f'virtual board on {board.path}')
        ports = ','.join(board.path for board in boards)
        print(f'in another terminal:\n  sesa2 run --config {options.config} --source serial --port {ports}')
        stop.wait()
    return 0
