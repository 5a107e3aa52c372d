"""A whole evaluation: estimates of one or more models against one truth."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sesa2.evaluation.accuracy import MarkerError, marker_error
from sesa2.evaluation.drawn_pose import DrawnPose
from sesa2.evaluation.registration import Kind, Registration, fit_registration
from sesa2.evaluation.screening import Screened, screen
from sesa2.evaluation.time_offset import (
    MirroredTruthError,
    TimeOffset,
    correlations,
    find_time_offset,
    refuse_mirrored,
)
from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.shape.rotations import FloatArray

DOUBTFUL_CORRELATION = 0.9
LARGE_PCT = 15.0  # median error at every marker; more than models that fit the arm leave
RIGID_LEAVES = 1.0 / 3.0  # of it, if the frames were what was wrong
FEW = 30  # samples; with fewer, quartiles are chance


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The errors, and everything that was removed before they were measured.

    Attributes
    ----------
    models
        errors by model and marker.
    time_offset
        between the clocks; truth time = estimate time + offset.
    registration
        between the frames.
    time_offset_from
        the model that the time offset was found with; None if it was given.
    registration_from
        the model that the registration was fitted with; None if there is none.
    screened
        what was left out of the truth.
    warnings
        what a reader of the figures has to know, one sentence each.
    pose
        of the arm, to draw the errors around; None where only its markers are known.
    """

    models: Mapping[str, Mapping[str, MarkerError]]
    time_offset: TimeOffset
    registration: Registration
    time_offset_from: str | None
    registration_from: str | None
    screened: Screened
    warnings: tuple[str, ...]
    pose: DrawnPose | None = None

    def to_json(self) -> dict[str, Any]:
        """The figures as `sesa2 evaluate --json` prints them; a figure of no samples is None."""
        figures = ('median_mm', 'q3_mm', 'rmse_mm', 'median_pct', 'q3_pct', 'n')

        def value(error: MarkerError, figure: str) -> float | int | None:
            number = getattr(error, figure)
            return None if math.isnan(number) else number

        registration = self.registration
        return {
            'models': {
                model: {
                    marker: {figure: value(error, figure) for figure in figures}
                    for marker, error in errors.items()
                }
                for model, errors in self.models.items()
            },
            'time_offset_s': self.time_offset.seconds,
            'registration': {
                'kind': registration.kind,
                'translation_m': registration.translation.tolist(),
                'rotation_xyzw': registration.rotation.tolist(),
                'fitted_on_s': None if registration.fitted_on is None else list(registration.fitted_on),
            },
        }


def evaluate(
    estimates: Mapping[str, Trajectory],
    truth: Trajectory,
    arc_lengths: Mapping[str, float],
    *,
    register: Kind = 'none',
    fit_fraction: float = 0.5,
    time_offset: float | None = None,
) -> Evaluation:
    """Compare estimates with motion capture.

    The estimate is interpolated to the truth's times (thesis 4.5.4). All models share one time offset and one
    registration, since these belong to the clocks and frames of the laboratory: each is taken from the model
    that agrees best with the truth, so that no model hides its own error in them and a worse model beside it
    changes nothing.

    Parameters
    ----------
    estimates
        by model, each with at least the markers of `arc_lengths`, m.
    truth
        with the same markers; NaN where one was not seen.
    arc_lengths
        of the markers to compare, m.
    register
        what to fit between the frames, on the first part of the trial; the rest is scored. `none` scores all.
    fit_fraction
        how much of the trial (by time) the registration is fitted on, between 0 and 1.
    time_offset
        s, added to the estimates' times; None to find it.

    Returns
    -------
    The errors and what was removed.

    Raises
    ------
    EvaluationError
        the recordings do not belong together, or too little is in them; the truth is a mirror image of the estimate
        and no rotation is fitted, which would make it scorable.
    """
    try:
        return _evaluate(estimates, truth, arc_lengths, register, fit_fraction, time_offset)
    except MirroredTruthError as mirrored:
        if register != 'rigid':
            raise
        # After a rotation, all mirror images are the same.
        image = Trajectory(truth.times, -truth.positions, truth.names)
        evaluation = _evaluate(estimates, image, arc_lengths, register, fit_fraction, time_offset)
        said = f'T{mirrored.finding[1:]}. It was mirrored and scored so.'
        return replace(evaluation, warnings=(said, *evaluation.warnings))


def _evaluate(
    estimates: Mapping[str, Trajectory],
    truth: Trajectory,
    arc_lengths: Mapping[str, float],
    register: Kind,
    fit_fraction: float,
    time_offset: float | None,
) -> Evaluation:
    _check(estimates, arc_lengths, fit_fraction, time_offset)
    arc_lengths = {name: float(s) for name, s in arc_lengths.items()}
    names = tuple(arc_lengths)
    estimates = {model: _complete(model, trajectory.select(names)) for model, trajectory in estimates.items()}
    screened = screen(
        truth.select(names), next(iter(estimates.values())), max(arc_lengths.values()), time_offset
    )
    truth = screened.truth

    time_offset_from = registration_from = None
    if time_offset is None:
        offset, time_offset_from = _shared_time_offset(estimates, truth)
    else:
        offset = TimeOffset(float(time_offset))
    matched = {model: trajectory.at(truth.times - offset.seconds) for model, trajectory in estimates.items()}
    known = ~np.isnan(np.stack([m[..., 0] for m in matched.values()])) & truth.seen
    if not known.any():
        raise _no_overlap(estimates, truth, offset)
    if time_offset is not None:
        agree = max(correlations(positions, truth.positions) for positions in matched.values())
        refuse_mirrored(agree[1], agree[0])

    registration = Registration()
    scored = np.ones(len(truth.times), dtype=bool)
    if register != 'none':
        when = truth.times[known.any(axis=(0, 2))]
        split = when[0] + fit_fraction * (when[-1] - when[0])
        scored = truth.times > split
        registration, registration_from = _shared_registration(register, matched, truth, ~scored)

    models = {
        model: {
            name: marker_error(
                truth.times[scored],
                registration.apply(positions[scored, m]),
                truth.positions[scored, m],
                arc_lengths[name],
            )
            for m, name in enumerate(names)
        }
        for model, positions in matched.items()
    }
    if not any(error.n for errors in models.values() for error in errors.values()):
        raise EvaluationError(
            f'nothing is left to score after the first {100 * fit_fraction:g} % of the trial, on which the '
            f'registration was fitted. Lower the fit fraction'
        )
    warnings = (
        *_offset_warnings(offset),
        *_truth_warnings(screened),
        *_frame_warnings(offset, registration, matched, truth, models),
        *_coverage_warnings(models, truth, scored),
    )
    return Evaluation(models, offset, registration, time_offset_from, registration_from, screened, warnings)


def _check(
    estimates: Mapping[str, Trajectory],
    arc_lengths: Mapping[str, float],
    fit_fraction: float,
    time_offset: float | None,
) -> None:
    if not estimates or not arc_lengths:
        raise EvaluationError('nothing to evaluate: expected at least one model and one marker')
    for name, s in arc_lengths.items():
        if not (math.isfinite(s) and s > 0.0):
            raise EvaluationError(f'arc length of {name} is {s} m, expected a positive number')
    if not 0.0 < fit_fraction < 1.0:
        raise EvaluationError(f'fit fraction {fit_fraction}, expected a number between 0 and 1')
    if time_offset is not None and not math.isfinite(time_offset):
        raise EvaluationError(f'time offset {time_offset} s, expected a finite number')


def _complete(model: str, trajectory: Trajectory) -> Trajectory:
    unseen = np.argwhere(~trajectory.seen)
    if len(unseen):
        i, m = unseen[0]
        raise EvaluationError(
            f'{model}: {len(unseen)} estimated marker positions are NaN, the first {trajectory.names[m]} '
            f'{trajectory.times[i] - trajectory.times[0]:.3f} s after the start'
        )
    return trajectory


def _shared_time_offset(estimates: Mapping[str, Trajectory], truth: Trajectory) -> tuple[TimeOffset, str]:
    found: dict[str, TimeOffset] = {}
    refused: list[EvaluationError] = []
    for model, estimate in estimates.items():
        try:
            found[model] = find_time_offset(estimate, truth)
        except EvaluationError as e:
            refused.append(e)
    mirrored = [e for e in refused if isinstance(e, MirroredTruthError)]
    if not found:
        raise next(iter(mirrored), refused[0])
    best = max(found, key=lambda model: found[model].correlation or 0.0)
    if mirrored and mirrored[0].mirrored > (found[best].correlation or 0.0):
        raise mirrored[0]
    return found[best], best


def _shared_registration(
    register: Kind, matched: Mapping[str, FloatArray], truth: Trajectory, fitted: np.ndarray
) -> tuple[Registration, str]:
    candidates: list[tuple[float, Registration, str]] = []
    for model, positions in matched.items():
        known = fitted[:, None] & truth.seen & ~np.isnan(positions[..., 0])
        when = truth.times[known.any(axis=1)]
        if not len(when):
            continue
        registration = fit_registration(
            register, positions[known], truth.positions[known], (float(when[0]), float(when[-1]))
        )
        residual = np.linalg.norm(registration.apply(positions[known]) - truth.positions[known], axis=1)
        candidates.append((float(np.median(residual)), registration, model))
    _, registration, model = min(candidates, key=lambda c: c[0])
    return registration, model


def _no_overlap(
    estimates: Mapping[str, Trajectory], truth: Trajectory, offset: TimeOffset
) -> EvaluationError:
    first = min(e.times[0] for e in estimates.values()) + offset.seconds
    last = max(e.times[-1] for e in estimates.values()) + offset.seconds
    return EvaluationError(
        f'no overlap in time: with the offset of {offset.seconds:+.3f} s the estimate is from {first:.3f} to '
        f'{last:.3f} s, the truth from {truth.times[0]:.3f} to {truth.times[-1]:.3f} s'
    )


def _offset_warnings(offset: TimeOffset) -> list[str]:
    warnings = []
    if offset.correlation is not None and offset.correlation < DOUBTFUL_CORRELATION:
        warnings.append(
            f'The motions agree poorly at the time offset that was found (correlation {offset.correlation:.2f}): '
            f'check that the recordings belong together.'
        )
    if offset.rival is not None:
        warnings.append(
            f'The motion repeats itself: a time offset {offset.rival - offset.seconds:+.3f} s from the one that was '
            f'found fits almost as well.'
        )
    return warnings


def _truth_warnings(screened: Screened) -> list[str]:
    warnings = []
    if screened.scale != 1.0:
        warnings.append('The truth is in millimetres; it was converted to metres.')
    warnings.extend(
        f'{name}: 0, 0, 0 stands {100.0 * n / len(screened.truth.times):.0f} % of the time: taken as not seen.'
        for name, n in screened.lost.items()
        if n
    )
    for what, counts in (
        ('Markers were held at their last position in the truth; left out', screened.held),
        ('Markers had changed places in the truth; left out', screened.exchanged),
        (
            'Markers changed places in the truth, and which was which cannot be told; left out',
            screened.untold,
        ),
        ('Markers jumped in the truth; left out', screened.jumped),
    ):
        left_out = ', '.join(f'{n} samples of {name}' for name, n in counts.items() if n)
        if left_out:
            warnings.append(f'{what}: {left_out}.')
    warnings.extend(
        f'{a} and {b} seem to be exchanged in all of the truth: with their names exchanged it fits much better.'
        for a, b in screened.exchanged_throughout
    )
    return warnings


def _frame_warnings(
    offset: TimeOffset,
    registration: Registration,
    matched: Mapping[str, FloatArray],
    truth: Trajectory,
    models: Mapping[str, Mapping[str, MarkerError]],
) -> list[str]:
    """Say so where a rotation that was not fitted would take away most of large errors."""
    doubtful = offset.correlation is not None and offset.correlation < DOUBTFUL_CORRELATION
    small = any(e.median_pct <= LARGE_PCT for errors in models.values() for e in errors.values())
    if registration.kind == 'rigid' or doubtful or small:
        return []
    try:
        everything = np.ones(len(truth.times), dtype=bool)
        rigid, model = _shared_registration('rigid', matched, truth, everything)
    except EvaluationError:  # no rotation can be told from these
        return []
    now, then = (
        float(np.nanmedian(np.linalg.norm(r.apply(matched[model]) - truth.positions, axis=2)))
        for r in (registration, rigid)
    )
    if then > RIGID_LEAVES * now:
        return []
    warning = (
        f'The frames of estimate and truth seem to differ: with --register rigid the median error would be '
        f'{1e3 * then:.1f} mm instead of {1e3 * now:.1f} mm.'
    )
    return [warning]


def _coverage_warnings(
    models: Mapping[str, Mapping[str, MarkerError]], truth: Trajectory, scored: np.ndarray
) -> list[str]:
    """Say where the truth did not see a marker, and where the estimate has gaps between its first and last sample."""
    warnings = []
    for m, name in enumerate(truth.names):
        unseen = int((~truth.seen[scored, m]).sum())
        if unseen:
            warnings.append(
                f'{name} was not seen (or left out) in {unseen} of {scored.sum()} samples of the truth.'
            )
        seen_at = truth.times[scored & truth.seen[:, m]]
        for model, errors in models.items():
            at = errors[name].times
            if not len(at):
                warnings.append(f'{model} has nothing to score at {name}.')
                continue
            if len(at) < FEW:
                warnings.append(
                    f'Only {len(at)} samples of {name} are scored with {model}, expected at least {FEW}: '
                    f'its figures are chance.'
                )
            missing = int(((seen_at >= at[0]) & (seen_at <= at[-1])).sum()) - len(at)
            if missing:
                warnings.append(
                    f'{model} has gaps: no estimate of {name} for {missing} of {len(seen_at)} samples.'
                )
    return warnings
