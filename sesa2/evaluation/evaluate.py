"""A whole evaluation: estimates of one or more models against one truth."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sesa2.evaluation.accuracy import MarkerError, marker_error
from sesa2.evaluation.comparison import Comparison
from sesa2.evaluation.drawn_pose import DrawnPose
from sesa2.evaluation.registration import TURNING, Kind, Registration
from sesa2.evaluation.screening import Screened, screen
from sesa2.evaluation.setup_warnings import base_warnings, cause_warnings, registration_hints
from sesa2.evaluation.similarity import Similarity, fit_similarity
from sesa2.evaluation.time_offset import (
    MirroredTruthError,
    TimeOffset,
    correlations,
    find_time_offset,
    refuse_mirrored,
)
from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.shape.rotations import FloatArray, rotate

DOUBTFUL_CORRELATION = 0.9
FEW = 30  # samples; with fewer, quartiles are chance
FEWEST = 2  # one sample is no figure


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
    similarity
        scale and clock rate that would fit best, for diagnosis: nothing of it is applied. None where it is not told.
    alternatives
        median error after the part that registrations are fitted on, m, by registration; of those that can be fitted.
    about_frames
        those of the warnings that blame frames, lengths or clocks.
    astray
        those that are told where all markers go astray together, which has more than one cause.
    mirrored
        true where the truth was mirrored before it was scored.
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
    similarity: Similarity | None = None
    alternatives: Mapping[Kind, float] = field(default_factory=dict)
    about_frames: tuple[str, ...] = ()
    astray: tuple[str, ...] = ()
    mirrored: bool = False
    pose: DrawnPose | None = None

    @property
    def odd(self) -> bool:
        """Whether estimate and truth hardly agree, or only mirrored."""
        correlation = self.time_offset.correlation
        return self.mirrored or (correlation is not None and correlation < DOUBTFUL_CORRELATION)

    def to_json(self) -> dict[str, Any]:
        """The figures as `sesa2 evaluate --json` prints them; a figure of no samples is None."""
        figures = ('median_mm', 'q3_mm', 'rmse_mm', 'median_pct', 'q3_pct', 'n')

        def value(error: MarkerError, figure: str) -> float | int | None:
            number = getattr(error, figure)
            return None if math.isnan(number) else number

        registration, similarity = self.registration, self.similarity
        offsets = {} if registration.offsets is None else {'offsets_m': registration.offsets.tolist()}
        return {
            'models': {
                model: {
                    marker: {figure: value(error, figure) for figure in figures}
                    for marker, error in errors.items()
                }
                for model, errors in self.models.items()
            },
            'time_offset_s': self.time_offset.seconds,
            'scale': None if similarity is None else similarity.scale,
            'clock_rate': None if similarity is None else similarity.clock_rate,
            'clock_rate_std': None
            if similarity is None or math.isinf(similarity.clock_rate_std)
            else similarity.clock_rate_std,
            'warnings': list(self.warnings),
            'registration': {
                'kind': registration.kind,
                'translation_m': registration.translation.tolist(),
                'rotation_xyzw': registration.rotation.tolist(),
                'fitted_on_s': None if registration.fitted_on is None else list(registration.fitted_on),
                **offsets,
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
        `offsets` are those of the markers beside the axis, and need estimates that hold orientations.
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
        # After a rotation, all mirror images are the same.
        image = Trajectory(truth.times, -truth.positions, truth.names)
        if register not in TURNING:
            try:
                _evaluate(estimates, image, arc_lengths, 'rigid', fit_fraction, time_offset)
            except EvaluationError:  # so that this cannot be advised
                raise EvaluationError(f'{mirrored.finding}. Export it with right-handed axes') from None
            raise
        evaluation = _evaluate(estimates, image, arc_lengths, register, fit_fraction, time_offset)
        said = f'T{mirrored.finding[1:]}. It was mirrored and scored so.'
        return replace(
            evaluation,
            warnings=(said, *evaluation.warnings),
            about_frames=(said, *evaluation.about_frames),
            mirrored=True,
        )


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
    comparison = Comparison(estimates, truth, offset.seconds)
    matched = comparison.matched
    known = ~np.isnan(np.stack([m[..., 0] for m in matched.values()])) & truth.seen
    if not known.any():
        raise _no_overlap(estimates, truth, offset)
    if time_offset is not None:
        agree = max(correlations(positions, truth.positions) for positions in matched.values())
        refuse_mirrored(agree[1], agree[0])

    when = truth.times[known.any(axis=(0, 2))]
    after = truth.times > when[0] + fit_fraction * (when[-1] - when[0])
    registration = Registration()
    scored = everything = np.ones(len(truth.times), dtype=bool)
    if register != 'none':
        scored = after
        registration, registration_from = comparison.fit(register, ~scored)

    models = {
        model: {
            name: _enough(
                marker_error(
                    truth.times[scored], positions[:, m], truth.positions[scored, m], arc_lengths[name]
                )
            )
            for m, name in enumerate(names)
        }
        for model, positions in comparison.registered(registration, scored).items()
    }
    if not any(error.n for errors in models.values() for error in errors.values()):
        raise _nothing_scored(register, fit_fraction, int(known.any(axis=(0, 2)).sum()), when)
    farthest = max(arc_lengths.values())
    doubtful = offset.correlation is not None and offset.correlation < DOUBTFUL_CORRELATION
    similarity, alternatives, frames, astray = None, dict[Kind, float](), list[str](), list[str]()
    if not doubtful:
        alternatives, of_all = (
            comparison.alternatives(~after, after),
            comparison.alternatives(everything, everything),
        )
        placed, similarity = _most_similar(
            estimates, registration, truth, offset.seconds, np.array(list(arc_lengths.values()))
        )
        own = truth.times - offset.seconds
        x = placed.at(own if similarity is None else similarity.estimate_times(truth.times, offset.seconds))
        frames = registration_hints(register, alternatives, of_all, farthest)
        frames += cause_warnings(register, x, truth, similarity, farthest)
        astray = base_warnings(x, truth, farthest)
    warnings = (
        *_offset_warnings(offset),
        *_truth_warnings(screened),
        *frames,
        *astray,
        *_coverage_warnings(models, truth, scored),
    )
    return Evaluation(
        models,
        offset,
        registration,
        time_offset_from,
        registration_from,
        screened,
        warnings,
        similarity,
        alternatives,
        tuple(frames),
        tuple(astray),
    )


def _enough(error: MarkerError) -> MarkerError:
    """The error, or that of nothing: one sample has no median worth the name."""
    return error if error.n >= FEWEST else MarkerError(error.times[:0], error.distances[:0], error.arc_length)


def _nothing_scored(register: Kind, fit_fraction: float, n: int, when: FloatArray) -> EvaluationError:
    if register == 'none' or n < FEWEST:
        return EvaluationError(
            f'nothing can be scored: estimate and truth have {n} samples in common, expected at least {FEWEST}'
        )
    text = (
        f'nothing is left to score after the first {100 * fit_fraction:g} % of the trial, on which the registration '
        f'was fitted'
    )
    # What the first sample alone would be fitted on leaves the rest to be scored.
    advice = (
        'Lower the fit fraction' if (when > when[0]).sum() >= FEWEST else 'Register by none, which scores all'
    )
    return EvaluationError(f'{text}. {advice}')


def _most_similar(
    estimates: Mapping[str, Trajectory],
    registration: Registration,
    truth: Trajectory,
    offset: float,
    arc_lengths: FloatArray,
) -> tuple[Trajectory, Similarity | None]:
    """The model that agrees best once scale, clock rate and frames are left out, and what these would be.

    Which of the models it is hardly matters to frames; but lengths must not be judged by a model that takes short cuts.
    """
    candidates: list[tuple[float, Trajectory, Similarity | None]] = []
    for estimate in estimates.values():
        placed = estimate
        if registration.offsets is not None and estimate.orientations is not None:
            beside = estimate.positions + rotate(estimate.orientations, registration.offsets)
            placed = Trajectory(estimate.times, beside, estimate.names)
        fit = fit_similarity(placed, truth, offset, arc_lengths)
        candidates.append((math.inf if fit is None else fit.left, placed, fit))
    _, placed, fit = min(candidates, key=lambda c: c[0])
    return placed, fit


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
