"""`sesa2 align`: what a recording tells about the sensors, written into a new configuration."""

import argparse
from pathlib import Path

import numpy as np

from sesa2.commands.align_accelerometers import align_accelerometers
from sesa2.commands.align_points import align_points
from sesa2.commands.arguments import add_config, add_truth_options, load_config, names, positive, warn
from sesa2.configuration import Configuration, files
from sesa2.configuration.description import table
from sesa2.errors import Sesa2Error
from sesa2.evaluation.registration import KINDS
from sesa2.partial_files import write_whole
from sesa2.sensing.imu.accelerometer_calibration import STANDARD_GRAVITY
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

# A twist of the whole arm beyond this (rad) is more than silicone does by itself, and is hard to tell from headings.
_MUCH_TWIST = 0.1
_POOR_FIT = 0.25


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        'source',
        metavar='IN',
        nargs='+',
        help='recording of the arm held straight, with --self of motion, with --truth of known points; or the log of '
        'each IMU, in the order of imus.ids or as ID=FILE',
    )
    add_config(parser)
    result = parser.add_mutually_exclusive_group(required=True)
    result.add_argument('--out', type=Path, metavar='F2', help='configuration to write; must not exist')
    result.add_argument(
        '--accelerometers',
        action='store_true',
        help="from IMUs that were held still with each side up: the accelerometers' bias, scale and misalignment, kept "
        'in calibration.file',
    )
    parser.add_argument(
        '--gravity',
        type=positive,
        default=STANDARD_GRAVITY,
        metavar='G',
        help='with --accelerometers, m/s² (%(default)s)',
    )
    parser.add_argument(
        '--headings', action='store_true', help='take the turn about the arm as error of heading'
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument(
        '--self',
        action='store_true',
        dest='motion',
        help='from any motion, knowing that the arm bends smoothly and hardly twists',
    )
    how.add_argument(
        '--truth',
        type=Path,
        metavar='T',
        help='from known positions of markers, of which ten are enough (a bag, or an export of motion capture): '
        'mountings, headings, affine curvature, and scale, offset and slip of lengths',
    )
    add_truth_options(parser)
    parser.add_argument('--models', type=names, metavar='A,B', help='with --truth: only by these models')
    parser.add_argument(
        '--register',
        choices=KINDS,
        default='none',
        help='with --truth: fit between the frames (default: none)',
    )
    parser.add_argument(
        '--start', type=float, default=0.0, metavar='S', help='use the recording from here, s'
    )
    parser.add_argument(
        '--duration', type=float, default=float('inf'), metavar='S', help='use so much of it, s'
    )
    parser.add_argument(
        '--first-id', type=int, metavar='N', help='id in a ROS 1 bag that is IMU 1 (default: the lowest)'
    )


def run(options: argparse.Namespace) -> int:
    """Learn, report, write."""
    from sesa2.bags.recorded_sweeps import read_sweeps
    from sesa2.bags.sensor_logs import assign_logs

    if options.accelerometers:
        return align_accelerometers(options)
    if options.truth:
        if options.headings:
            raise Sesa2Error('--headings is for a straight pose; --truth tells the headings anyway')
        return align_points(options)
    c = load_config(options)
    if options.out.exists():
        raise Sesa2Error(f'{options.out}: exists already, expected the name of a new configuration')
    source = assign_logs(options.source, c.imus.all_ids)
    sweeps = read_sweeps(source, c, options.first_id)
    warn(sweeps.problems)
    t = (sweeps.stamps_ns - sweeps.stamps_ns[0]) / NS
    chosen = (t >= options.start) & (t < options.start + options.duration)
    if not chosen.any():
        raise Sesa2Error(
            f'{" ".join(options.source)}: no sweep from {options.start:g} s on; the recording has {t[-1]:.1f} s'
        )
    learn = _from_motion if options.motion else _from_straight_pose
    mountings, headings = learn(
        c,
        t[chosen],
        sweeps.orientations[chosen],
        sweeps.measured[chosen],
        sweeps.base[chosen],
        options.headings,
    )
    try:
        write_whole(options.out, files.dump(c.with_alignment(mountings, headings)))
    except OSError as error:
        raise Sesa2Error(f'{options.out}: cannot be written: {error.strerror}') from None
    print(f'written to {options.out}')
    return 0


def _from_straight_pose(
    c: Configuration, t: FloatArray, q: FloatArray, measured: np.ndarray, base: FloatArray, headings: bool
) -> tuple[FloatArray, FloatArray]:
    from sesa2.alignment.straight_pose import align_straight

    found = align_straight(
        q, measured, base, c.mountings, c.headings, ids=c.imus.ids, correct_headings=headings
    )
    degrees = np.rad2deg(found.corrections)
    rows = [
        (i, n, f'{x:+.2f} {y:+.2f}', f'{h:+.2f}', f'{np.rad2deg(left):+.2f}', f'{np.rad2deg(spread):.2f}')
        for i, n, (x, y, h), left, spread in zip(
            c.imus.ids, found.samples, degrees, found.unexplained, found.spread, strict=True
        )
    ]
    head = ('IMU', 'samples', 'mounting x y [°]', 'heading [°]', 'left about z [°]', 'spread [°]')
    print(f'straight pose of {t[-1] - t[0]:.1f} s')
    print('\n'.join(table(head, rows)))
    unheard = [
        f'IMU {i}: no sample; its mounting is left as it was'
        for i, n in zip(c.imus.ids, found.samples, strict=True)
        if not n
    ]
    warn(unheard)
    warn(found.doubts(c.imus.ids))
    return found.mountings, found.headings


def _from_motion(
    c: Configuration, t: FloatArray, q: FloatArray, measured: np.ndarray, base: FloatArray, headings: bool
) -> tuple[FloatArray, FloatArray]:
    from sesa2.alignment.earth_frame import BaseComparison
    from sesa2.alignment.self_calibration import self_calibrate
    from sesa2.alignment.straight_pose import tilt_doubts
    from sesa2.sensing.imu.mounting import Mounting

    if headings:
        raise Sesa2Error(
            '--headings is for a straight pose; with --self the motion tells the headings anyway'
        )
    found = self_calibrate(t, q, measured, c.layout, base, c.mountings, c.headings)
    rows = [
        (
            i,
            *(f'{np.rad2deg(v):+.2f} ± {np.rad2deg(s):.2f}' for v, s in zip(values, std, strict=True)),
            f'{np.rad2deg(wander):.2f}',
        )
        for i, values, std, wander in zip(c.imus.ids, found.corrections, found.std, found.wander, strict=True)
    ]
    twist = np.rad2deg(found.twist)
    print(
        f'{found.shapes} shapes in {found.seconds:.1f} s of motion; twist of the arm {twist:.1f}° rms; '
        f'misfit {found.misfit:.2f} (0.05 to 0.2 where the configuration is right)'
    )
    print('\n'.join(table(('IMU', 'mounting x [°]', 'y [°]', 'z [°]', 'heading [°]', 'wander [°]'), rows)))
    disturbance = found.disturbance(c.imus.ids)
    if disturbance:
        raise Sesa2Error(f'{disturbance} Nothing is written; expected a part without (--start, --duration)')
    warn(found.untold(c.imus.ids))
    if found.misfit > _POOR_FIT:
        text = 'check ids, positions, mountings and arm.base_orientation'
        warn(
            [
                f'the shapes of a smooth arm fit poorly (misfit {found.misfit:.2f}, expected 0.05 to 0.2): {text}'
            ]
        )
    comparison = BaseComparison()
    comparison.add(Mounting(c.mountings, c.headings).link_orientations(q), measured, base)
    warn([comparison.doubt] if comparison.doubt else tilt_doubts(found.corrections, c.imus.ids))
    if found.twist > _MUCH_TWIST:
        warn([f'the arm seems to twist by {twist:.1f}° rms; a steady twist looks like errors of heading'])
    return found.mountings, found.headings
