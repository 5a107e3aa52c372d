"""What is wrong with a motion capture recording by itself: its unit, exchanged markers, jumps.

Exchanges and jumps are found from the truth's own continuity, never from its distance to the estimate: leaving out the
samples that an estimate misses would flatter it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.shape.rotations import FloatArray

MILLIMETRE = 1e-3
# The two spreads differ by the estimate's error and by what each recording saw, never by so much.
SPREAD_TOLERANCE = 4.0

FASTEST = 2.0  # m/s, three times the top speed in the thesis (figure 4.20)
FASTEST_RATIO = 6.0  # of this trial's own 95th percentile, if that is more
EXCHANGE_RATIO = 0.5
EXCHANGE_GAP = 1.0  # s; longer out of sight, and where a marker comes back proves nothing


@dataclass(frozen=True, eq=False)
class Screened:
    """A truth without the samples that cannot be true.

    Attributes
    ----------
    truth
        in metres; what was left out is NaN.
    scale
        what the file's numbers were multiplied by: 1, or 0.001 for millimetres.
    exchanged
        samples in which two markers had each other's place, by marker.
    jumped
        samples in which a marker was where it cannot have got to, by marker.
    """

    truth: Trajectory
    scale: float = 1.0
    exchanged: Mapping[str, int] = field(default_factory=dict)
    jumped: Mapping[str, int] = field(default_factory=dict)


def screen(truth: Trajectory, estimate: Trajectory, arc_length: float) -> Screened:
    """Check a truth before anything is compared with it.

    A truth too large for the arm is one in millimetres if a factor of 1000 makes its size the estimate's. It is then
    converted, and the result says so. Any other unit is refused.

    Parameters
    ----------
    truth
        as recorded.
    estimate
        the same markers, in metres; only how far they spread is used.
    arc_length
        of the marker farthest from the base, m.

    Raises
    ------
    EvaluationError
        the truth is neither in metres nor in millimetres, or nothing of a marker is left.
    """
    scale = _scale(truth, estimate, arc_length)
    positions = truth.positions * scale
    in_metres = Trajectory(truth.times, positions, truth.names)

    exchanged = _exchanged(in_metres)
    positions = np.where(exchanged[..., None], np.nan, positions)
    jumped = _jumped(truth.times, positions)
    positions = np.where(jumped[..., None], np.nan, positions)
    cleaned = Trajectory(truth.times, positions, truth.names)
    for name, before, after in zip(truth.names, truth.seen.T, cleaned.seen.T, strict=True):
        if not after.any():
            raise EvaluationError(
                f'truth: nothing of {name} can be used; it was seen in {before.sum()} samples'
            )
    return Screened(
        cleaned,
        scale,
        dict(zip(truth.names, (int(n) for n in exchanged.sum(axis=0)), strict=True)),
        dict(zip(truth.names, (int(n) for n in jumped.sum(axis=0)), strict=True)),
    )


def _spread(trajectory: Trajectory) -> float:
    """Median distance of all markers' positions from their common median, in the recording's unit.

    Medians, since exchanges and jumps are still in it.
    """
    p = trajectory.positions[trajectory.seen]
    return float(np.median(np.linalg.norm(p - np.median(p, axis=0), axis=1))) if len(p) else 0.0


def _scale(truth: Trajectory, estimate: Trajectory, arc_length: float) -> float:
    spread, expected = _spread(truth), _spread(estimate)
    if spread <= 2.0 * arc_length:  # within reach of a clamped arm, so these can be metres
        return 1.0
    if 1.0 / SPREAD_TOLERANCE <= MILLIMETRE * spread / max(expected, 1e-9) <= SPREAD_TOLERANCE:
        return MILLIMETRE
    raise EvaluationError(
        f'the truth is not in metres: its markers are {spread:.4g} from their middle (median), on an arm whose '
        f'farthest marker is {arc_length:.4g} m from the base. Nor is it in millimetres: the estimated markers are '
        f'{expected:.4g} m from their middle'
    )


def _exchanged(truth: Trajectory) -> np.ndarray:
    """Samples in which a pair of markers has changed places, (n, m), bool.

    From one sample that sees both to the next, they have if each is much nearer to where the other was than to where
    it was itself. Which of the two states is the true one the recording cannot tell: the more frequent one is taken.
    """
    out = np.zeros(truth.seen.shape, dtype=bool)
    for a, b in combinations(range(len(truth.names)), 2):
        both = np.flatnonzero(truth.seen[:, a] & truth.seen[:, b])
        if len(both) < 2:
            continue
        pair = truth.positions[both][:, [a, b]]
        stayed = np.linalg.norm(pair[1:] - pair[:-1], axis=2).sum(axis=1)
        crossed = np.linalg.norm(pair[1:, ::-1] - pair[:-1], axis=2).sum(axis=1)
        soon = np.diff(truth.times[both]) <= max(EXCHANGE_GAP, truth.period)
        state = np.concatenate(([0], np.cumsum(soon & (crossed < EXCHANGE_RATIO * stayed)))) % 2
        wrong = both[state != (2 * state.sum() > len(state))]
        out[np.ix_(wrong, [a, b])] = True
    return out


def _jumped(times: FloatArray, positions: FloatArray) -> np.ndarray:
    """Samples that no plausible speed connects with the rest of their marker's track, (n, m), bool."""
    out = np.zeros(positions.shape[:2], dtype=bool)
    for m in range(positions.shape[1]):
        seen = np.flatnonzero(~np.isnan(positions[:, m, 0]))
        t, p = times[seen], positions[seen, m]
        if len(t) < 2:
            continue
        speed = np.linalg.norm(np.diff(p, axis=0), axis=1) / np.diff(t)
        fastest = max(FASTEST, FASTEST_RATIO * float(np.quantile(speed, 0.95)))
        pieces = np.split(np.arange(len(t)), np.flatnonzero(speed > fastest) + 1)
        # From the longest piece outwards: a piece belongs to the track if the track can have got there.
        longest = max(range(len(pieces)), key=lambda i: len(pieces[i]))
        earlier = [piece[::-1] for piece in pieces[longest::-1]]
        for track, *others in (pieces[longest:], earlier):
            end = track[-1]
            for piece in others:
                if np.linalg.norm(p[piece[0]] - p[end]) <= fastest * abs(t[piece[0]] - t[end]):
                    end = piece[-1]
                else:
                    out[seen[piece], m] = True
    return out
