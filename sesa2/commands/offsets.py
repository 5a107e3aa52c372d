"""`sesa2 offsets`: offsets of a BNO055 that another program kept, put into a calibration file."""

import argparse
from pathlib import Path

from sesa2.errors import Sesa2Error, shown
from sesa2.sensing.imu.bno055.offsets import load_offsets, offsets_are_there, read_chip_offsets, save_offsets


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        'chips',
        metavar='ID=FILE',
        nargs='+',
        type=_chip,
        help='id of an IMU, and the file with the offsets of its chip: registers 0x55 to 0x6A in hex, JSON or YAML',
    )
    parser.add_argument(
        '--out',
        required=True,
        type=Path,
        metavar='FILE',
        help='calibration file; where it exists, what it says of other IMUs is kept',
    )


def run(options: argparse.Namespace) -> int:
    """Read all, then write, and say what."""
    ids = [imu for imu, _ in options.chips]
    if twice := sorted({imu for imu in ids if ids.count(imu) > 1}):
        raise Sesa2Error(f'IMU {", ".join(map(str, twice))} is given twice, expected one file an IMU')
    read = {imu: read_chip_offsets(path) for imu, path in options.chips}
    before = load_offsets(options.out, ids).missing if offsets_are_there(options.out) else tuple(ids)
    for imu, offsets in read.items():
        save_offsets(options.out, imu, offsets)
        print(f'IMU {imu}: {offsets}' + ('' if imu in before else '; took the place of what was there'))
    print(f'written to {options.out}')
    return 0


def _chip(text: str) -> tuple[int, Path]:
    imu, equals, path = text.partition('=')
    if not (equals and path and imu.isascii() and imu.isdigit() and int(imu) > 0):
        raise argparse.ArgumentTypeError(f'got {shown(text)}, expected ID=FILE, such as 1=registers.txt')
    return int(imu), Path(path)
