"""`sesa2 magnets`: magnets and magnetometers as they are, from shapes that are known, into a new configuration."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sesa2.commands.arguments import add_config, add_truth_options, load_config, not_negative, positive, warn
from sesa2.configuration import Configuration, files
from sesa2.configuration.description import table
from sesa2.errors import Sesa2Error
from sesa2.partial_files import write_whole
from sesa2.shape.models.magnetic import Magnetic

if TYPE_CHECKING:
    from sesa2.bags.magnetometer_log import MagnetometerLog
    from sesa2.evaluation.known_shapes import KnownShapes
    from sesa2.sensing.magnetometry.build_parameters import BuildErrors
    from sesa2.sensing.magnetometry.magnet_calibration import MagnetCalibration
    from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings
    from sesa2.sensing.magnetometry.ring_magnet import RingMagnet

# Of what is left over what is expected: more is doubtful, or no calibration of these magnets.
_DOUBTFUL, _REFUSED = 3.0, 20.0
# Of a parameter's expected error, what a calibration must have taken off to have told it.
_TOLD = 0.2
_EARTH_UNKNOWN, _EARTH_GIVEN = 50e-6, 2e-6  # T
_FEW_SHAPES = 5
_ROUNDS = 3
_WEAKEST, _STRONGEST = 0.05, 1.7  # T, of any material
_UNITS = {
    'strength': (100.0, '%'),
    'gain': (100.0, '%'),
    'shift': (1e3, 'mm'),
    'position': (1e3, 'mm'),
    'tilt': (float(np.rad2deg(1.0)), '°'),
    'offset': (1e6, 'µT'),
    'earth_field': (1e6, 'µT'),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        'source',
        metavar='IN',
        type=Path,
        help='bag with magnetometer_<id>/field, or CSV with time_s and magnetometer_<id>_x, _y, _z (T), or '
        'magnetometer_<id> of one that measures along z',
    )
    add_config(parser)
    parser.add_argument(
        '--out', type=Path, required=True, metavar='F2', help='configuration to write; must not exist'
    )
    shapes = parser.add_mutually_exclusive_group(required=True)
    shapes.add_argument('--straight', action='store_true', help='the arm hangs or lies straight, at rest')
    shapes.add_argument(
        '--poses',
        type=Path,
        metavar='FILE',
        help='CSV of poses that were held: start_s, end_s (from the first reading) and each coordinate by its name',
    )
    shapes.add_argument(
        '--truth', type=Path, metavar='T', help='markers in the frame of the clamp: a bag, or motion capture'
    )
    add_truth_options(parser)
    parser.add_argument(
        '--truth-error', type=positive, default=3e-4, metavar='M', help='of a marker, m (default: 0.0003)'
    )
    parser.add_argument(
        '--bend-error',
        type=not_negative,
        default=2e-3,
        metavar='RAD',
        help='how well bends of poses and of the straight arm are known (default: 0.002)',
    )
    parser.add_argument(
        '--length-error',
        type=not_negative,
        default=1e-4,
        metavar='M',
        help='and their lengths (default: 0.0001)',
    )
    parser.add_argument(
        '--earth-error',
        type=not_negative,
        metavar='T',
        help="of each component of the earth's field (default: 2e-6 where earth_field is given, else 5e-5)",
    )
    parser.add_argument(
        '--fit-magnet',
        action='store_true',
        help="the magnets' sizes are not known: fit the ring that has their field; all magnets are of one kind",
    )
    parser.add_argument('--start', type=not_negative, default=0.0, metavar='S', help='use IN from here, s')
    parser.add_argument(
        '--duration', type=positive, default=float('inf'), metavar='S', help='use so much of it, s'
    )


def run(options: argparse.Namespace) -> int:
    """Calibrate, report, write."""
    from sesa2.bags.magnetometer_log import read_magnetometers
    from sesa2.sensing.magnetometry.build_parameters import USUAL_BUILD
    from sesa2.sensing.magnetometry.held_readings import refuse_unlike
    from sesa2.sensing.magnetometry.magnet_calibration import calibrate_magnets

    c = load_config(options)
    if options.out.exists():
        raise Sesa2Error(f'{options.out}: exists already, expected the name of a new configuration')
    if not c.magnetometers.ids:
        raise Sesa2Error(f'{options.config}: has no magnetometers, expected magnets and magnetometers')
    if c.imus.base_id:
        raise Sesa2Error(
            'imus.base_id is given: expected an arm on a base that stands still, arm.base_orientation'
        )
    if options.fit_magnet and options.straight:
        raise Sesa2Error('--fit-magnet needs several shapes, expected --poses or --truth, not --straight')
    model = c.create_model('magnetic')
    assert isinstance(model, Magnetic)
    predictor = model.predictor
    log = read_magnetometers(options.source, c.magnetometers.ids).part(options.start, options.duration)
    warn(log.problems)
    shapes = _known_shapes(options, c, predictor, log)
    warn(shapes.notes)
    described = predictor.predict(shapes.coordinates, c.base).readings
    earth = options.earth_error
    if earth is None:
        earth = _EARTH_GIVEN if predictor.earth_field.any() else _EARTH_UNKNOWN
    before = replace(USUAL_BUILD, earth=earth)
    if options.fit_magnet:
        predictor = _with_fitted_magnet(c, predictor, shapes, before)
        described = predictor.predict(shapes.coordinates, c.base).readings
    refuse_unlike(predictor, shapes.readings, described)
    found = calibrate_magnets(
        predictor,
        shapes.coordinates,
        shapes.readings,
        c.base,
        before=before,
        coordinate_errors=shapes.coordinate_errors[:, None, :],
        reading_errors=shapes.reading_errors,
    )
    off = shapes.readings - described
    left = shapes.readings - found.predictor.predict(shapes.coordinates, c.base).readings
    head = (
        f'{len(shapes.coordinates)} shapes, {np.isfinite(off).sum()} readings: off by {_rms(off):.2f} µT as described, '
        f'{_rms(left):.2f} µT as calibrated, {found.residual:.2f} times what is expected; '
        f"the earth's field was known to {1e6 * earth:g} µT"
    )
    lines = [head, *_told(found)]
    print('\n'.join(line.rstrip() for line in lines))
    if found.residual > _REFUSED:
        raise Sesa2Error(
            f'what is left is {found.residual:.0f} times what is expected: the shapes, or what the magnets and '
            'magnetometers are, are not as described. Nothing is written'
        )
    if found.residual > _DOUBTFUL:
        warn(
            [
                f'what is left is {found.residual:.1f} times what is expected: shapes less well known, iron nearby?'
            ]
        )
    text = files.dump(c.with_magnets(found.predictor))
    files.parse(text, str(options.out))
    comments = '\n'.join(f'# {line}'.rstrip() for line in ['Calibrated by sesa2 magnets:', *lines])
    try:
        write_whole(options.out, f'{comments}\n{text}')
    except OSError as error:
        raise Sesa2Error(f'{options.out}: cannot be written: {error.strerror}') from None
    print(f'written to {options.out}')
    return 0


def _known_shapes(
    options: argparse.Namespace, c: Configuration, predictor: 'MagneticReadings', log: 'MagnetometerLog'
) -> 'KnownShapes':
    from sesa2.evaluation.known_shapes import (
        PoseSpan,
        in_clamp,
        read_pose_spans,
        shapes_of_poses,
        shapes_of_truth,
    )
    from sesa2.evaluation.truth import read_truth

    kinematics = predictor.limits.kinematics
    if options.truth:
        if not c.markers.names:
            raise Sesa2Error(f'{options.config}: has no markers, expected those whose positions are known')
        read = read_truth(
            options.truth,
            c.markers.names,
            topic=options.truth_topic,
            given=dict(options.markers),
            rate=options.truth_rate,
        )
        warn([*read.notes, *([read.axes] if read.axes else [])])
        truth = in_clamp(read.trajectory, read.frame, c)
        return shapes_of_truth(log, c, predictor, truth, options.truth_error, options.time_offset)
    straight = [PoseSpan(0.0, np.inf, kinematics.rest)]
    spans = read_pose_spans(options.poses, predictor) if options.poses else straight
    lengths = np.array(['length' in name for name in kinematics.coordinate_names])
    known = np.where(lengths, options.length_error, options.bend_error)
    return shapes_of_poses(log, c, predictor, spans, known)


def _with_fitted_magnet(
    c: Configuration, predictor: 'MagneticReadings', shapes: 'KnownShapes', before: 'BuildErrors'
) -> 'MagneticReadings':
    """With the ring whose field the readings show, whatever else of the build is off."""
    from sesa2.sensing.magnetometry.build_parameters import BuildParameters
    from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings
    from sesa2.sensing.magnetometry.moment_fit import fit_moments, ring_of_moments

    n = len(shapes.coordinates)
    if n < _FEW_SHAPES:
        raise Sesa2Error(f'--fit-magnet: {n} shapes, expected at least {_FEW_SHAPES}')
    bases, q = np.tile(c.base, (n, 1)), shapes.coordinates

    def with_ring(ring: 'RingMagnet') -> MagneticReadings:
        magnets = replace(predictor.magnets, magnets=(ring,) * len(predictor.magnets.magnets))
        return MagneticReadings(predictor.limits, magnets, predictor.magnetometers, predictor.earth_field)

    described = predictor.magnets.magnets[0]
    first = fit_moments(predictor, q, shapes.readings, 1, bases).moments[0]
    ring = replace(described, remanence=described.remanence * first / described.moments(1)[0])
    for _ in range(_ROUNDS):  # what errors of the build do depends on the magnet
        now = with_ring(ring)
        parameters = BuildParameters(now, before)
        by_build = parameters.look(np.zeros(len(parameters.names)), q, bases)[1] * parameters.deviations
        by_shape = now.predict(q, bases).jacobian * shapes.coordinate_errors[:, None, :]
        errors = np.sqrt(shapes.reading_errors**2 + np.sum(by_shape**2, axis=-1))
        fitted = fit_moments(now, q, shapes.readings, 3, bases, errors, by_build)
        ring = ring_of_moments(described, fitted.moments)
    (first, third), (by, by_third) = fitted.moments, fitted.deviations
    print(
        f'magnet: moments {first:.4g} ± {by:.1g} T m³ and {third:.4g} ± {by_third:.1g} T m⁵, as of a ring of '
        f'{1e3 * ring.outer_diameter:.2f} mm outside and {ring.remanence:.3f} T'
    )
    if not _WEAKEST < abs(ring.remanence) < _STRONGEST:
        raise Sesa2Error(
            f'--fit-magnet: a remanence of {ring.remanence:.3g} T, expected {_WEAKEST:g} to {_STRONGEST:g} T: readings '
            'in another unit than tesla, or magnets.heights and inner_diameters that are not those of the magnets'
        )
    return with_ring(ring)


def _told(found: 'MagnetCalibration') -> list[str]:
    """A table of what was told, and the names of what was not."""
    rows, untold = [], []
    for name, change, deviation, told in zip(
        found.names, found.changes, found.deviations, found.told, strict=True
    ):
        scale, unit = next(of for kind, of in _UNITS.items() if kind in name)
        if told >= _TOLD:
            before = deviation / (1.0 - told)
            rows.append(
                (
                    name,
                    f'{scale * change:+.3g} ± {scale * deviation:.2g} {unit}',
                    f'± {scale * before:.2g} {unit}',
                )
            )
        else:
            untold.append(name)
    lines = table(('learnt', 'differs by', 'expected'), rows)
    if untold:
        lines.append(f'{len(untold)} of {len(found.names)} hardly told by these shapes: {", ".join(untold)}')
    return lines


def _rms(values: np.ndarray) -> float:
    return float(1e6 * np.sqrt(np.nanmean(values**2)))
