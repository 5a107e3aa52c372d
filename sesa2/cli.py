"""The entry point `sesa2`."""

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from sesa2.errors import Sesa2Error
from sesa2.faults import fault_line, log_tracebacks

# Modules of Python that Windows does not have.
_POSIX = ('fcntl', 'pty', 'resource', 'termios', 'tty')


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Returns
    -------
    Exit code: 0 done, 1 failed with a message on standard error, 2 wrong usage.
    """
    # Closed ones would be None, and the next file that is opened would stand in for them.
    for name in ('stdin', 'stdout', 'stderr'):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open('r' if name == 'stdin' else 'w'))  # noqa: SIM115
    # Line by line also into a pipe, so that what was said before a kill is there.
    # A terminal that lacks a character gets it escaped.
    sys.stdout.reconfigure(line_buffering=True, errors='backslashreplace')  # type: ignore[union-attr]
    log_tracebacks()
    try:
        options = _parser().parse_args(arguments)
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
    except ModuleNotFoundError as error:
        print(f'error: {_what_is_missing(error)}', file=sys.stderr)
        return 1
    except Exception as error:
        print(f'error: {fault_line(error)}; SESA2_DEBUG=1 shows where it came from', file=sys.stderr)
        return 1


def _what_is_missing(error: ModuleNotFoundError) -> str:
    name = (error.name or '').partition('.')[0]
    if name in _POSIX:
        return f'a serial port and a pseudo-terminal need Linux or macOS: this Python has no module {name}'
    if name == 'rclpy' or name.endswith('_msgs'):
        return f"no ROS 2 here (no module {name}): source that of the machine, or pip install 'sesa2[ros]'"
    if name in ('trimesh', 'viser'):
        return f"no module {name}, which the page needs: pip install 'sesa2[viewer]'"
    return f'{fault_line(error)}; SESA2_DEBUG=1 shows where it came from'


def _parser() -> argparse.ArgumentParser:
    # Here, so that Ctrl-C while the libraries are loaded ends it as at any other time.
    from sesa2.commands import (
        align,
        board,
        budget,
        check,
        evaluate,
        export,
        magnets,
        offsets,
        replay,
        run,
        twin,
        view,
    )

    parser = argparse.ArgumentParser(
        prog='sesa2', description='Shape of a soft continuum arm from the orientations of IMUs along it.'
    )
    commands = parser.add_subparsers(required=True, metavar='COMMAND')
    for name, module, summary in (
        ('run', run, 'start the nodes that a configuration asks for'),
        ('check', check, 'validate a configuration and say what it means'),
        ('replay', replay, 'the estimator over a whole recording, as fast as the machine can'),
        ('align', align, 'mountings and headings from a recording'),
        ('magnets', magnets, 'magnets and magnetometers as they are, from known shapes'),
        ('evaluate', evaluate, 'error against motion capture'),
        ('export', export, 'results as CSV, npz, mat or TUM trajectories'),
        ('view', view, 'a recording as one page with a time line'),
        ('offsets', offsets, 'offsets of a BNO055 that another program kept, into a calibration file'),
        ('budget', budget, 'the error to expect at each marker, by source'),
        ('twin', twin, 'a simulated trial, with the truth'),
        ('board', board, 'a virtual board on a pseudo-terminal'),
    ):
        command = commands.add_parser(name, help=summary, description=f'{summary[0].upper()}{summary[1:]}.')
        module.add_arguments(command)
        command.set_defaults(command=module.run)
    return parser


if __name__ == '__main__':
    sys.exit(main())
