"""Arguments that several commands share."""

import argparse
import math
import sys
from collections.abc import Callable

from sesa2.configuration import Configuration, files


def add_config(parser: argparse.ArgumentParser, default: str | None = None) -> None:
    """`--config F`."""
    parser.add_argument(
        '--config',
        required=default is None,
        default=default,
        metavar='F',
        help='configuration: a file, or the name of a shipped one'
        + (f' (default: {default})' if default else ''),
    )


def load_config(options: argparse.Namespace) -> Configuration:
    """The configuration that `--config` names.

    Raises
    ------
    ConfigurationError
        it is not there, or not valid.
    """
    return files.load(files.find(options.config))


def positive(text: str) -> float:
    """A number above zero, as an argument's type."""
    value = float(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f'got {text}, expected a number above 0')
    return value


def not_negative(text: str) -> float:
    """A number of at least zero, as an argument's type."""
    value = float(text)
    if not 0.0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f'got {text}, expected 0 or more')
    return value


def natural(text: str) -> int:
    """A whole number of at least zero, as an argument's type."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f'got {text}, expected 0 or more')
    return value


def finite(text: str) -> float:
    """A number, as an argument's type."""
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'got {text}, expected a finite number')
    return value


def port_number(text: str) -> int:
    """A port of the network, as an argument's type."""
    value = int(text)
    if not 0 <= value <= 65535:
        raise argparse.ArgumentTypeError(f'got {text}, expected 0 to 65535')
    return value


def names(text: str) -> tuple[str, ...]:
    """Names with commas between them, as an argument's type."""
    return tuple(text.split(','))


def progress(what: str) -> Callable[[int, int], None] | None:
    """Shows how much of long work is done, where somebody watches: called with what is done and the whole."""
    if not sys.stderr.isatty():
        return None

    def show(done: int, total: int) -> None:
        end = '\n' if done >= total else ''
        print(f'\r{what}: {100 * done // max(total, 1)} %', end=end, file=sys.stderr, flush=True)

    return show


def warn(lines: list[str] | tuple[str, ...]) -> None:
    """Tell of what was not as it should be, on standard error."""
    for line in lines:
        print(f'warning: {line}', file=sys.stderr)
