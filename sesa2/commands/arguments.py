"""Arguments that several commands share."""

import argparse
import math
import sys
from collections.abc import Callable
from typing import TypeVar

from sesa2.configuration import Configuration, files
from sesa2.configuration.ros_names import is_topic_name
from sesa2.errors import shown
from sesa2.messages.topic_names import TRUTH_MARKERS

_Number = TypeVar('_Number', int, float)


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


def add_truth_options(parser: argparse.ArgumentParser) -> None:
    """What has to be said of a truth where it does not say it itself."""
    parser.add_argument(
        '--truth-topic', metavar='TOPIC', help=f'in a bag (default: {TRUTH_MARKERS}, or what has poses)'
    )
    parser.add_argument(
        '--marker',
        action='append',
        default=[],
        type=_renamed,
        metavar='M1=NAME',
        dest='markers',
        help="a marker's name in the truth, where it differs; once a marker",
    )
    parser.add_argument(
        '--truth-rate', type=positive, metavar='HZ', help='of its frames, where a truth counts them alone'
    )
    parser.add_argument(
        '--time-offset', type=_offset, default=None, metavar='auto|S', help='s, or found (default: auto)'
    )


def load_config(options: argparse.Namespace) -> Configuration:
    """The configuration that `--config` names.

    Raises
    ------
    ConfigurationError
        it is not there, or not valid.
    """
    return files.load_configuration(options.config)


def positive(text: str) -> float:
    """A number above zero, as an argument's type."""
    return _number(text, float, lambda v: 0.0 < v < math.inf, 'a number above 0')


def not_negative(text: str) -> float:
    """A number of at least zero, as an argument's type."""
    return _number(text, float, lambda v: 0.0 <= v < math.inf, 'a number of 0 or more')


def finite(text: str) -> float:
    """A number, as an argument's type."""
    return _number(text, float, math.isfinite, 'a finite number')


def natural(text: str) -> int:
    """A whole number of at least zero, as an argument's type."""
    return _number(text, int, lambda v: v >= 0, 'a whole number of 0 or more')


def port_number(text: str) -> int:
    """A port of the network, as an argument's type."""
    return _number(text, int, lambda v: 0 <= v <= 65535, 'a port, 0 to 65535')


def _number(
    text: str, kind: Callable[[str], _Number], fits: Callable[[_Number], bool], expected: str
) -> _Number:
    try:
        value = kind(text)
    except ValueError:
        value = None
    if value is None or not fits(value):
        raise argparse.ArgumentTypeError(f'got {text}, expected {expected}')
    return value


def namespace(text: str) -> str:
    """A namespace of the ROS graph, as an argument's type; absolute in any case."""
    if text != '/' and not is_topic_name(text):
        expected = 'letters, digits and _ between single slashes, as left or lab/left'
        raise argparse.ArgumentTypeError(f'got {text}, expected a namespace: {expected}')
    return '/' + text.lstrip('/')


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


def _offset(text: str) -> float | None:
    if text == 'auto':
        return None
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'got {shown(text)}, expected auto or a number of seconds') from None


def _renamed(text: str) -> tuple[str, str]:
    ours, equals, theirs = text.partition('=')
    if not (ours and equals and theirs):
        raise argparse.ArgumentTypeError(f'got {shown(text)}, expected MARKER=NAME, such as M1=Arm:tip')
    return ours, theirs
