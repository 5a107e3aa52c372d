"""Shapes of an arm that are known, with what its magnetometers read then: what a calibration of magnets learns from."""

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sesa2.bags.magnetometer_log import MagnetometerLog
from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.evaluation.measured_instants import distinct
from sesa2.evaluation.screening import screen
from sesa2.evaluation.time_offset import find_time_offset
from sesa2.evaluation.trajectory import Trajectory
from sesa2.sensing.magnetometry.held_readings import held_readings
from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings
from sesa2.shape.coordinate_fit import CoordinateFit
from sesa2.shape.observability import UNTOLD
from sesa2.shape.point_predictor import PointPredictor
from sesa2.shape.rotations import FloatArray, rotate

# Of the mean of many readings, no less than this part of the noise of one is believed.
_LEAST_NOISE = 0.1
_APART = 0.02  # of the arm: instants of a truth that are nearer to one another tell nothing new
FEWEST_SHAPES = 5
"""Of a truth."""


class KnownShapes(NamedTuple):
    """Shapes, and readings of them.

    Attributes
    ----------
    coordinates, coordinate_errors : (n, n_coordinates)
        rad and m, and how well they are known.
    readings, reading_errors : (n, n_readings)
        T; NaN where nothing was measured.
    notes
        what was found out or left out, one sentence each.
    """

    coordinates: FloatArray
    coordinate_errors: FloatArray
    readings: FloatArray
    reading_errors: FloatArray
    notes: tuple[str, ...]


class PoseSpan(NamedTuple):
    """A pose that was held from one time to another, s from the first reading; its coordinates, (n_coordinates,)."""

    begin: float
    end: float
    coordinates: FloatArray


def read_pose_spans(path: Path, predictor: MagneticReadings) -> list[PoseSpan]:
    """Poses from a CSV with the columns start_s, end_s and all coordinates by name, rad and m.

    Raises
    ------
    Sesa2Error
        it cannot be read, a column is missing or a field is no number; a pose ends before it begins, or is beyond the
        limits of the arm.
    """
    limits = predictor.limits
    names = ('start_s', 'end_s', *limits.kinematics.coordinate_names)
    try:
        with path.open(newline='', encoding='utf-8-sig') as file:
            rows = list(
                csv.DictReader(
                    (line for line in file if line.strip() and line[0] != '#'), skipinitialspace=True
                )
            )
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise Sesa2Error(f'{path}: cannot be read: {getattr(error, "strerror", None) or error}') from None
    expected = f'expected {", ".join(names)} (s, rad, m), a pose a line'
    if not rows:
        raise Sesa2Error(f'{path}: no pose, {expected}')
    if missing := [name for name in names if name not in rows[0]]:
        raise Sesa2Error(f'{path}: no column {missing[0]}, {expected}')
    spans = []
    for k, row in enumerate(rows, 1):
        try:
            begin, end, *q = (float(row[name]) for name in names)
        except (TypeError, ValueError):
            raise Sesa2Error(f'{path}: pose {k} has a field that is no number, {expected}') from None
        if not (np.isfinite([begin, end, *q]).all() and end > begin):
            raise Sesa2Error(
                f'{path}: pose {k} is from {begin:g} to {end:g} s, expected finite numbers, the end later'
            )
        own = np.array(q)
        beyond = np.abs(limits.clip(own) - own) > 1e-3 * limits.scales
        if beyond.any():
            i = int(np.flatnonzero(beyond)[0])
            raise Sesa2Error(
                f'{path}: pose {k} has {names[2 + i]} = {own[i]:g}, beyond segments.bend_max or stretch '
                '(rad and m, not degrees and mm)'
            )
        spans.append(PoseSpan(begin, end, own))
    return spans


def shapes_of_poses(
    log: MagnetometerLog,
    c: Configuration,
    predictor: MagneticReadings,
    spans: list[PoseSpan],
    known: FloatArray,
) -> KnownShapes:
    """Average what was read in each pose.

    Parameters
    ----------
    log
        what was read.
    c
        whose magnetometers these are.
    predictor
        of them.
    spans
        the poses.
    known : (n_coordinates,)
        how well their coordinates are known, rad and m.

    Raises
    ------
    Sesa2Error
        the arm moved during a pose, or nothing was read in it.
    """
    ids, noise = c.magnetometers.ids, c.magnetometers.noise
    means, errors = np.full((2, len(spans), len(ids), 3), np.nan)
    for k, span in enumerate(spans):
        for i, sensor in enumerate(ids):
            if sensor not in log.times or sensor in c.magnetometers.masked:
                continue
            t = log.times[sensor] - log.start
            own = log.fields[sensor][(t >= span.begin) & (t <= span.end)]
            where = (
                f'pose {k + 1}, {span.begin:g} to {min(span.end, float(t[-1])):g} s: magnetometer {sensor}'
            )
            held = held_readings(own, noise, where)
            means[k, i], errors[k, i] = held.mean, np.maximum(held.deviation, _LEAST_NOISE * noise)
    return KnownShapes(
        np.array([span.coordinates for span in spans]),
        np.tile(known, (len(spans), 1)),
        predictor.readings_of(means),
        predictor.readings_of(errors),
        (),
    )


def shapes_of_truth(
    log: MagnetometerLog,
    c: Configuration,
    predictor: MagneticReadings,
    truth: Trajectory,
    error: float,
    time_offset: float | None,
) -> KnownShapes:
    """Coordinates that explain the markers of a truth, and what was read at these instants.

    Parameters
    ----------
    log, c, predictor
        see `shapes_of_poses`.
    truth
        positions of the configuration's markers in the clamp's frame.
    error
        of a component of a marker, m.
    time_offset
        truth time − time of the readings, s; None: found from the motion.

    Raises
    ------
    Sesa2Error
        the markers do not tell the coordinates, the truth is of another motion or in another frame, or too few
        instants are left.
    """
    limits, notes = predictor.limits, []
    at = dict(zip(c.markers.names, c.markers.positions, strict=True))
    markers = PointPredictor(limits, truth.names, [at[name] for name in truth.names], error)
    rough = _estimated(log, c, predictor, markers)
    screened = screen(truth, rough, max(at[name] for name in truth.names), time_offset)
    if screened.scale != 1.0:
        notes.append('the truth was in millimetres and was converted')
    if screened.exchanged_throughout:
        pairs = ', '.join(' and '.join(pair) for pair in screened.exchanged_throughout)
        raise Sesa2Error(
            f'the truth fits only with the names of {pairs} exchanged: --marker says which is which'
        )
    truth = screened.truth
    if time_offset is None:
        time_offset = find_time_offset(rough, truth).seconds
        notes.append(f'time offset {time_offset:+.4f} s, found from the motion')
    times = truth.times - time_offset
    readings = predictor.readings_of(log.at(times, c.magnetometers.ids))
    usable = truth.seen.all(axis=1) & np.isfinite(readings).any(axis=1)
    if (left := int((~usable).sum())) > 0:
        notes.append(
            f'{left} of {len(usable)} instants of the truth not used: a marker was not seen, or nothing was read'
        )
    points, readings = truth.positions[usable], readings[usable]
    which = distinct(points, _APART * c.arm.length) if len(points) else np.zeros(0, dtype=int)
    points, readings = points[which], readings[which]
    fitted = CoordinateFit(markers).fit(markers.readings_of(points))
    deviations = np.sqrt(np.diagonal(fitted.covariance(limits.scales), axis1=-2, axis2=-1))
    off = np.sqrt(np.mean(fitted.residuals**2, axis=-1)) * error
    good = fitted.converged & (off < max(5.0 * error, 0.02 * c.arm.length))
    if good.sum() < FEWEST_SHAPES:
        typical = f', which miss the markers by {1e3 * float(np.median(off)):.1f} mm' if len(off) else ''
        raise Sesa2Error(
            f'{int(good.sum())} shapes of {limits.kinematics.name} explain the markers at {len(off)} different instants'
            f'{typical}, expected at least {FEWEST_SHAPES}: positions in the frame of the clamp, in m'
        )
    if not good.all():
        notes.append(
            f'{int((~good).sum())} of {len(good)} instants not used: no shape explains their markers'
        )
    untold = np.median(deviations[good] / limits.scales, axis=0) > UNTOLD
    if untold.any():
        names = [limits.kinematics.coordinate_names[i] for i in np.flatnonzero(untold)]
        raise Sesa2Error(
            f'the markers {", ".join(truth.names)} do not tell {", ".join(names)}: expected a marker at the end of '
            'each segment (affine: another in its middle)'
        )
    return KnownShapes(
        fitted.coordinates[good],
        deviations[good],
        readings[good],
        np.broadcast_to(predictor.noise, readings[good].shape),
        tuple(notes),
    )


def _estimated(
    log: MagnetometerLog, c: Configuration, predictor: MagneticReadings, markers: PointPredictor
) -> Trajectory:
    """Where the markers were by magnets and magnetometers as described: good enough to find the clock by."""
    times = max(log.times.values(), key=len)
    readings = predictor.readings_of(log.at(times, c.magnetometers.ids))
    found = CoordinateFit(predictor).fit(readings, base=c.base).coordinates
    there = np.isfinite(found).all(axis=1) & np.isfinite(readings).any(axis=1)
    if not there.any():
        raise Sesa2Error(
            'magnets and magnetometers as described explain no reading: check units and places first'
        )
    points = markers.predict(found[there]).readings.reshape(int(there.sum()), -1, 3)
    return Trajectory(times[there], points, markers.names)


def in_clamp(truth: Trajectory, frame: str, c: Configuration) -> Trajectory:
    """A truth in the clamp's frame; one of unknown frame is in that of the results.

    Raises
    ------
    Sesa2Error
        its frame is another, or the base turns.
    """
    frames = c.frame('base_link'), c.frame('world')
    if frame and frame not in frames:
        raise Sesa2Error(f'the truth is in frame {frame}, expected {frames[0]} or {frames[1]}')
    if (frame or c.frame_id) == frames[0]:
        return truth
    turned = rotate(c.base * [-1.0, -1.0, -1.0, 1.0], truth.positions)
    return Trajectory(truth.times, turned, truth.names)
