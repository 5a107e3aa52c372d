"""`sesa2 check`: validate a configuration and say what it means."""

import argparse

from sesa2.configuration import files
from sesa2.configuration.description import describe


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument('config', metavar='F', help='a file, or the name of a shipped configuration')


def run(options: argparse.Namespace) -> int:
    """Print the table, or raise with every mistake."""
    print(describe(files.load_configuration(options.config)))
    return 0
