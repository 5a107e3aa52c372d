"""Sensors' errors from positions that are known: what `sesa2 align --truth` does, as a function."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sesa2.alignment.map_estimate import MapEstimate, map_estimate
from sesa2.alignment.shape_prior import INDEPENDENCE_TIME
from sesa2.bags.recorded_sweeps import RecordedSweeps
from sesa2.configuration import Configuration
from sesa2.evaluation.arm_unknowns import ArmUnknowns, Unknown
from sesa2.evaluation.measured_instants import LONGEST_GAP, MeasuredInstants, at_truth, distinct, shape_at
from sesa2.evaluation.registration import TURNING, WITH_OFFSETS, Kind, Registration, fit_registration
from sesa2.evaluation.screening import screen
from sesa2.evaluation.time_offset import MirroredTruthError, correlations, find_time_offset, refuse_mirrored
from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.shape.rotations import FloatArray, from_rotation_vector, multiply, rotate

FEWEST_POINTS = 4
# A truth with more instants is a recording of motion, whose clock may be another.
_FEW = 50
_DISTINCT = 0.02  # of the arm: instants that are nearer to one another in all markers tell nothing new
# Of a component of a point: expected to be left over, of its arc length.
_NOISE = 0.005
_EXPECTED_OFFSET = 0.02  # m, of a marker beside the axis
_LEAST_CORRELATION = 0.6
# Median distance that is left, of the arm: more explains nothing, and is doubtful.
_UNEXPLAINED, _POORLY = 0.10, 0.04
_MUCH = 3.0  # standard deviations of what is expected
_TURNED = np.deg2rad(10.0)


class Learnt(NamedTuple):
    """What known points told.

    Attributes
    ----------
    configuration
        with what was told; the rest is as it was.
    model
        that agrees best with the points then; what was learnt suits it.
    unknowns
        in order.
    estimate
        of these, and behind them of the registration.
    instants, points
        that were used: number of instants, and of positions of markers.
    before, after
        median distance of the points, m, without what was learnt and with it; the registration is fitted to both.
    time_offset
        truth time − estimate time, s.
    notes
        what was found out about the truth, for people.
    doubts
        what should be looked at, for people.
    """

    configuration: Configuration
    model: str
    unknowns: tuple[Unknown, ...]
    estimate: MapEstimate
    instants: int
    points: int
    before: float
    after: float
    time_offset: float
    notes: tuple[str, ...]
    doubts: tuple[str, ...]

    @property
    def told(self) -> list[tuple[Unknown, float, float]]:
        """Unknowns that were told: each with its correction and standard deviation."""
        return [one for one, told in zip(self._all(), self.estimate.told, strict=False) if told]

    @property
    def untold(self) -> list[tuple[Unknown, float]]:
        """Unknowns that the points hardly tell, with the standard deviation that is left; they stay as they were."""
        return [(u, s) for (u, _, s), told in zip(self._all(), self.estimate.told, strict=False) if not told]

    def _all(self) -> list[tuple[Unknown, float, float]]:
        return [
            (u, float(v), float(s))
            for u, v, s in zip(self.unknowns, self.estimate.values, self.estimate.std, strict=False)
        ]


def learn_from_points(
    c: Configuration,
    sweeps: RecordedSweeps,
    truth: Trajectory,
    *,
    models: Sequence[str] | None = None,
    register: Kind = 'none',
    time_offset: float | None = None,
) -> Learnt:
    """Learn mountings, headings, affine curvature, and scale, offset and slip of lengths from known positions.

    Each of the models is corrected; that which leaves least is taken. Corrections are the maximum a posteriori about
    the configuration, and what the points do not tell stays as it is.

    Parameters
    ----------
    c
        the configuration that is corrected.
    sweeps
        of the recording.
    truth
        positions of the configuration's markers in the frame of its results, unless a registration is fitted; some
        instants are enough.
    models
        names of models; those of the configuration where it is None.
    register
        what to fit besides between the frames.
    time_offset
        truth time − estimate time, s; None: found where the truth is a recording of motion, else 0.

    Raises
    ------
    Sesa2Error
        too few points, or a truth that is mirrored, in another unit, of another motion or in another frame.
    """
    at = dict(zip(c.markers.names, c.markers.positions, strict=True))
    s = np.array([at[name] for name in truth.names])
    names = tuple(models or c.models)
    notes = []
    whole = MeasuredInstants.of(sweeps, c)
    usable = whole.usable(c)
    if not usable.any():
        raise EvaluationError(
            'no sweep has an orientation and, where lengths are measured, the length of each segment'
        )
    whole = whole.chosen(usable)
    estimates = {
        name: Trajectory(whole.times, shape_at(c, name, whole, s)[0], truth.names).select(truth.names)
        for name in names
    }
    truth, offset, more = _in_time(estimates, truth, float(s.max()), time_offset)
    notes += more
    instants = at_truth(whole, truth, offset)
    n_seen = int(truth.seen.any(axis=1).sum())
    if len(instants.times) < n_seen:
        notes.append(
            f'{n_seen - len(instants.times)} of {n_seen} instants of the truth not used: no sweep within '
            f'{LONGEST_GAP:g} s, or something not measured then'
        )
    chosen = distinct(instants.points, _DISTINCT * c.arm.length) if len(instants.times) > _FEW else None
    seconds = float(np.ptp(instants.times)) if len(instants.times) else 0.0
    share = 1.0
    if chosen is not None:
        instants = instants.chosen(chosen)
        share = min(1.0, seconds / INDEPENDENCE_TIME / len(chosen))
    points = int((~np.isnan(instants.points[..., 0])).sum())
    if points < FEWEST_POINTS:
        raise EvaluationError(f'{points} points to learn from, expected at least {FEWEST_POINTS}')
    _refuse_another(estimates, truth, offset)
    found = [_learn(c, name, instants, s, register, share) for name in names]
    learnt = min(found, key=lambda one: one.estimate.noise)
    return learnt._replace(
        time_offset=offset, notes=tuple(notes), doubts=_doubts(learnt, c, register, instants, s)
    )


def _learn(
    c: Configuration, model: str, instants: MeasuredInstants, s: FloatArray, register: Kind, share: float
) -> Learnt:
    unknowns = ArmUnknowns(c, model, instants.measured.any(axis=0))
    seen = ~np.isnan(instants.points[..., 0])
    truth = instants.points[seen]
    marker = np.nonzero(seen)[1]
    before, links = shape_at(c, model, instants, s)
    start = Registration()
    if register != 'none':
        start = fit_registration('rigid' if register in TURNING else 'translation', before, instants.points)
    k = len(unknowns.items)
    beside = 3 * len(s) if register in WITH_OFFSETS else 0
    frames = [3.0] * (3 if register in TURNING else 0) + [10.0] * (3 if register != 'none' else 0)
    expected = np.concatenate([unknowns.expected, frames, np.full(beside, _EXPECTED_OFFSET)])

    def residuals(x: FloatArray) -> FloatArray:
        p, links = shape_at(unknowns.corrected(x[:k]), model, instants, s)
        p, rest = p[seen], x[k:]
        if beside:
            p = p + rotate(links[seen], rest[len(frames) :].reshape(-1, 3)[marker])
        q, t = start.rotation, start.translation
        if register in TURNING:
            q, rest = multiply(from_rotation_vector(rest[:3]), q), rest[3:]
        if register != 'none':
            t = t + rest[:3]
        return rotate(q, p) + t - truth

    estimate = map_estimate(residuals, expected, _NOISE * float(s.max()), share)
    first = fit_registration(register, before, instants.points, None, links) if register != 'none' else start
    off = np.linalg.norm((first.apply(before, links) - instants.points)[seen], axis=-1)
    left = float(np.median(np.linalg.norm(estimate.left, axis=-1)))
    return Learnt(
        unknowns.corrected(estimate.values[:k]),
        model,
        unknowns.items,
        estimate,
        len(instants.times),
        len(truth),
        float(np.median(off)),
        left,
        0.0,
        (),
        (),
    )


def _in_time(
    estimates: Mapping[str, Trajectory], truth: Trajectory, reach: float, time_offset: float | None
) -> tuple[Trajectory, float, list[str]]:
    """The truth in metres without what cannot be true, the time between the clocks, and what is to be known."""
    notes = []
    few = len(truth.times) <= _FEW
    first = next(iter(estimates.values()))
    screened = screen(truth, first, reach, time_offset if time_offset is not None or not few else 0.0)
    if screened.scale != 1.0:
        notes.append('the truth was in millimetres and was converted')
    for what in ('lost', 'held', 'exchanged', 'untold', 'jumped'):
        if n := sum(getattr(screened, what).values()):
            notes.append(f'{n} positions of the truth left out: {what}')
    if screened.exchanged_throughout:
        pairs = ', '.join(' and '.join(pair) for pair in screened.exchanged_throughout)
        raise EvaluationError(
            f'the truth fits only with the names of {pairs} exchanged: --marker says which is which'
        )
    truth = screened.truth
    if time_offset is not None:
        return truth, time_offset, notes
    if few:
        notes.append(
            f'the truth has {len(truth.times)} instants: its clock is taken for that of the recording (--time-offset)'
        )
        return truth, 0.0, notes
    found, refused = [], []
    for estimate in estimates.values():
        try:
            found.append(find_time_offset(estimate, truth))
        except MirroredTruthError as error:
            raise _mirrored(error) from None
        except EvaluationError as error:
            refused.append(error)
    if not found:
        raise refused[0]
    best = max(found, key=lambda one: one.correlation or 0.0)
    return truth, best.seconds, notes


def _mirrored(error: MirroredTruthError) -> EvaluationError:
    return EvaluationError(f'{error.finding}. Export it with right-handed axes')


def _refuse_another(estimates: Mapping[str, Trajectory], truth: Trajectory, offset: float) -> None:
    """A truth that is mirrored, or of another motion."""
    agree = max(correlations(e.at(truth.times - offset), truth.positions) for e in estimates.values())
    try:
        refuse_mirrored(agree[1], agree[0])
    except MirroredTruthError as error:
        raise _mirrored(error) from None
    if agree[0] < _LEAST_CORRELATION:
        raise EvaluationError(
            f'the truth does not move as the arm does (correlation {agree[0]:.2f}, expected at least '
            f'{_LEAST_CORRELATION:g}): is it of this recording, and are clocks and names of markers right?'
        )


def _doubts(
    learnt: Learnt, c: Configuration, register: Kind, instants: MeasuredInstants, s: FloatArray
) -> tuple[str, ...]:
    """What should be looked at; refuses what nothing explains."""
    left = f'{1e3 * learnt.after:.1f} mm ({100.0 * learnt.after / c.arm.length:.1f} % of the arm)'
    turned = _turned(c, learnt, instants, s) if register not in TURNING else ''
    if learnt.after > _UNEXPLAINED * c.arm.length:
        asked = ': is it of this arm, in the frame of the results, and are names and positions of the markers right?'
        raise EvaluationError(
            f'nothing that can be learnt explains the truth: {left} are left (median){turned or asked}'
        )
    if not any(told for told in learnt.estimate.told[: len(learnt.unknowns)]):
        raise EvaluationError('the points tell nothing of the sensors: expected more of them, farther apart')
    doubts = []
    if turned:
        doubts.append(f'{left} are left (median){turned}')
    elif learnt.after > _POORLY * c.arm.length:
        doubts.append(f'the points are explained poorly: {left} are left (median)')
    if wrong := int(learnt.estimate.wrong.sum()):
        doubts.append(f'{wrong} of {learnt.points} points disagree with the rest and hardly count')
    doubts += [
        f'{u.name} is corrected by {u.told(v)}{u.unit}, far more than expected (±{u.told(u.expected)}{u.unit})'
        for u, v, _ in learnt.told
        if abs(v) > _MUCH * u.expected
    ]
    return tuple(doubts)


def _turned(c: Configuration, learnt: Learnt, instants: MeasuredInstants, s: FloatArray) -> str:
    """Where the truth is in another frame, how far it is turned."""
    p, _ = shape_at(c, learnt.model, instants, s)
    try:
        found = fit_registration('rigid', p, instants.points)
    except EvaluationError:
        return ''
    off = np.linalg.norm(found.apply(p) - instants.points, axis=-1)
    if found.angle < _TURNED or np.nanmedian(off) > 0.7 * learnt.after:
        return ''
    return f': the truth seems turned by {np.rad2deg(found.angle):.0f}°; --register rigid fits that'
