"""`sesa2 check`: validate a configuration and say what it means."""

import argparse

from sesa2.commands.arguments import warn
from sesa2.commands.check_magnets import check_magnets
from sesa2.configuration import Configuration, files
from sesa2.configuration.description import describe, table
from sesa2.sensing.imu.bno055.offsets import load_offsets, offsets_are_there


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument('config', metavar='F', help='a file, or the name of a shipped configuration')


def run(options: argparse.Namespace) -> int:
    """Print the table, or raise with every mistake."""
    c = files.load_configuration(options.config)
    print(describe(c))
    if c.calibration.file:
        print('\n'.join(['', *_offsets(c)]))
    if c.magnetometers.ids:
        check_magnets(c)
    return 0


def _offsets(c: Configuration) -> list[str]:
    """What the calibration file says, as a run reads it."""
    path = c.calibration.file
    if not offsets_are_there(path):
        warn([f'calibration file {path} is not there; `sesa2 run --mode calibrate` makes one'])
        return [f'Offsets    {path}', '  none']
    saved = load_offsets(path, c.imus.all_ids)
    if saved.missing:
        warn([f'{path} has no offsets of IMU {", ".join(map(str, saved.missing))}: not calibrated'])
    head = ('id', 'accel x y z', 'mag x y z', 'gyro x y z', 'radii accel mag')
    rows = [
        (
            i,
            *(' '.join(map(str, vector)) for vector in (o.accel_offset, o.mag_offset, o.gyro_offset)),
            f'{o.accel_radius} {o.mag_radius}',
        )
        for i, o in saved.offsets.items()
    ]
    return [f"Offsets    {path}, in the registers' units", *table(head, rows)]
