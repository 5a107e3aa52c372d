"""`sesa2 board`: a virtual board on a pseudo-terminal."""

import argparse
from pathlib import Path

from sesa2.commands.arguments import add_config, load_config
from sesa2.ros.signals import stop_on_signals
from sesa2.system.virtual_source import make_virtual_board


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_config(parser, 'prototype3_8')
    parser.add_argument('--link', metavar='PATH', type=Path, help='name to give the pseudo-terminal')


def run(options: argparse.Namespace) -> int:
    """Serve until Ctrl-C or SIGTERM."""
    with stop_on_signals() as stop, make_virtual_board(load_config(options), options.link) as board:
        print(f'virtual board on {board.path}; in another terminal:')
        print(f'  sesa2 run --config {options.config} --source serial --port {board.path}')
        stop.wait()
    return 0
