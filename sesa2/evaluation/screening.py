"""What is wrong with a motion capture recording by itself: its unit, held positions, exchanged markers, jumps.

Held positions and jumps are found from the truth's own continuity, never from its distance to the estimate: leaving
out the samples that an estimate misses would flatter it. So are exchanges; but continuity tells only that markers
changed places, not which side of the change is the right one. That, the estimate is asked, for a whole stretch at once
and for nothing but the way from marker to marker: to mislead, it would have to point to the other side.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from sesa2.evaluation.registration import fit_registration
from sesa2.evaluation.time_offset import find_time_offset
from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.shape.rotations import FloatArray, rotate

MILLIMETRE = 1e-3
# The two spreads differ by the estimate's error and by what each recording saw, never by so much.
SPREAD_TOLERANCE = 4.0

# A recording that goes on with the last position when it loses a marker. No marker that is measured stands still to the
# last digit for so long while another one moves so far.
HELD_FOR = 0.5  # s
HELD_WHILE = 0.05  # m

# A recording that writes 0 0 0 where it does not see a marker. What is measured is never exactly there, unless it stays
# there: at the clamp.
LOST_REACH = 0.05  # of the marker's largest distance from the origin; one that comes nearer is not asked

FASTEST = 2.0  # m/s, three times the top speed in the thesis (figure 4.20)
FASTEST_RATIO = 6.0  # of this trial's own 95th percentile, if that is more
EXCHANGE_RATIO = 0.5  # of the distances without the exchange; in between, nothing is concluded
EXCHANGE_GAP = 1.0  # s; longer out of sight, and where a marker comes back proves nothing
# Of the motion's variance; an estimate that misses more of it is not asked which marker is which.
MOST_MISSED = 0.2


@dataclass(frozen=True, eq=False)
class Screened:
    """A truth without the samples that cannot be true.

    Attributes
    ----------
    truth
        in metres; what was left out is NaN.
    scale
        what the file's numbers were multiplied by: 1, or 0.001 for millimetres.
    lost
        samples at exactly 0 0 0, taken for not seen, by marker.
    held
        samples that repeat a marker's last position while another marker moved, by marker.
    exchanged
        samples in which two markers had each other's place, by marker.
    untold
        samples around an exchange where it cannot be told which marker was which, by marker.
    jumped
        samples in which a marker was where it cannot have got to, by marker.
    exchanged_throughout
        pairs of markers that fit the estimate only if their names are exchanged in all of the truth. Nothing of them
        was left out: there would be nothing left.
    """

    truth: Trajectory
    scale: float = 1.0
    lost: Mapping[str, int] = field(default_factory=dict)
    held: Mapping[str, int] = field(default_factory=dict)
    exchanged: Mapping[str, int] = field(default_factory=dict)
    untold: Mapping[str, int] = field(default_factory=dict)
    jumped: Mapping[str, int] = field(default_factory=dict)
    exchanged_throughout: tuple[tuple[str, str], ...] = ()


def screen(
    truth: Trajectory, estimate: Trajectory, arc_length: float, time_offset: float | None = None
) -> Screened:
    """Check a truth before anything is compared with it.

    A truth too large for the arm is one in millimetres if a factor of 1000 makes its size the estimate's. It is then
    converted, and the result says so. Any other unit is refused.

    Parameters
    ----------
    truth
        as recorded.
    estimate
        the same markers, in metres; only how far they spread and which is which is used.
    arc_length
        of the marker farthest from the base, m.
    time_offset
        s, added to the estimate's times; None to find it where it is needed.

    Raises
    ------
    EvaluationError
        the truth is neither in metres nor in millimetres, or nothing of a marker is left.
    """
    lost = _lost(truth.positions)
    seen = Trajectory(truth.times, np.where(lost[..., None], np.nan, truth.positions), truth.names)
    scale = _scale(seen, estimate, arc_length)
    positions = seen.positions * scale
    held = _held(truth.times, positions)
    positions = np.where(held[..., None], np.nan, positions)
    in_metres = Trajectory(truth.times, positions, truth.names)

    exchanged, untold, throughout = _exchanged(in_metres, _turned(estimate, in_metres, time_offset))
    positions = np.where((exchanged | untold)[..., None], np.nan, positions)
    jumped = _jumped(truth.times, positions)
    positions = np.where(jumped[..., None], np.nan, positions)
    cleaned = Trajectory(truth.times, positions, truth.names)

    def counts(left_out: np.ndarray) -> dict[str, int]:
        return dict(zip(truth.names, left_out.sum(axis=0).tolist(), strict=True))

    out = Screened(
        cleaned,
        scale,
        counts(lost),
        counts(held),
        counts(exchanged),
        counts(untold),
        counts(jumped),
        throughout,
    )
    for name, before, after in zip(truth.names, truth.seen.T, cleaned.seen.T, strict=True):
        if not after.any():
            raise EvaluationError(
                f'truth: nothing of {name} can be used; it was seen in {before.sum()} samples: '
                f'{out.lost[name]} at 0 0 0, {out.held[name]} '
                f'that repeat its last position, {out.exchanged[name]} exchanged with another marker, '
                f'{out.untold[name]} where that cannot be told, {out.jumped[name]} that jumped'
            )
    return out


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


def _lost(positions: FloatArray) -> np.ndarray:
    """Samples at exactly 0 0 0 of markers that are elsewhere otherwise, (n, m), bool."""
    zero = (positions == 0.0).all(axis=2)
    distance = np.where(zero, np.nan, np.linalg.norm(positions, axis=2))
    for m in np.flatnonzero(zero.any(axis=0)):
        known = distance[~np.isnan(distance[:, m]), m]
        if not len(known) or known.min() < LOST_REACH * known.max():
            zero[:, m] = False
    return zero


def _held(times: FloatArray, positions: FloatArray) -> np.ndarray:
    """Samples that repeat their marker's last position, to the last digit, while another marker moves, (n, m), bool."""
    out = np.zeros(positions.shape[:2], dtype=bool)
    for m in range(positions.shape[1]):
        moves = np.flatnonzero((np.diff(positions[:, m], axis=0) != 0.0).any(axis=1)) + 1
        starts, ends = np.append(0, moves), np.append(moves, len(times))
        long = times[ends - 1] - times[starts] > HELD_FOR
        for start, end in zip(starts[long], ends[long], strict=True):
            others = np.delete(positions[start:end], m, axis=1)
            moved = np.linalg.norm(others - others[0], axis=2)
            out[start + 1 : end, m] = (moved > HELD_WHILE).any()
    return out


def _turned(estimate: Trajectory, truth: Trajectory, time_offset: float | None) -> FloatArray | None:
    """Estimated positions at the truth's times, turned into its frame, (n, m, 3); None if the two do not agree.

    Offset and rotation are those of the middle of the markers, which is where it is whichever of them is which.
    """
    if len(truth.names) < 2:
        return None
    middle = truth.positions.mean(axis=1, keepdims=True)
    middle[_jumped(truth.times, middle)] = np.nan
    try:
        if time_offset is None:
            estimated = Trajectory(
                estimate.times, estimate.positions.mean(axis=1, keepdims=True), ('middle',)
            )
            time_offset = find_time_offset(
                estimated, Trajectory(truth.times, middle, estimated.names)
            ).seconds
        at_truth = estimate.at(truth.times - time_offset)
        x, y = at_truth.mean(axis=1), middle[:, 0]
        both = ~np.isnan(x[:, 0] + y[:, 0])
        x, y = x[both], y[both]
        registration = fit_registration('rigid', x, y)
    except EvaluationError:
        return None
    if ((registration.apply(x) - y) ** 2).sum() > MOST_MISSED * ((y - y.mean(axis=0)) ** 2).sum():
        return None
    return rotate(registration.rotation, at_truth)


def _exchanged(
    truth: Trajectory, turned: FloatArray | None
) -> tuple[np.ndarray, np.ndarray, tuple[tuple[str, str], ...]]:
    """Samples in which a pair has changed places, those where that cannot be told, (n, m), bool; exchanged pairs.

    From one sample that sees both to the next, they have if each is much nearer to where the other was than to where
    it was itself, and have not if it is the other way round. Where it is neither, or they were out of sight for long, a
    new stretch begins of which the samples before tell nothing. Each stretch has two labellings, and the true one is
    that in which the markers are much nearer to the estimate as seen from each other. If neither is, a stretch stays
    as recorded, unless they change places in it.
    """
    exchanged, untold = np.zeros((2, *truth.seen.shape), dtype=bool)
    throughout = []
    for a, b in combinations(range(len(truth.names)), 2):
        both = np.flatnonzero(truth.seen[:, a] & truth.seen[:, b])
        ab = np.array([a, b])
        pair = truth.positions[both][:, ab]
        stayed = np.linalg.norm(pair[1:] - pair[:-1], axis=2).sum(axis=1)
        crossed = np.linalg.norm(pair[1:, ::-1] - pair[:-1], axis=2).sum(axis=1)
        change = crossed < EXCHANGE_RATIO * stayed
        certain = change | (stayed < EXCHANGE_RATIO * crossed)
        certain &= np.diff(truth.times[both]) <= EXCHANGE_GAP
        state = np.concatenate(([False], np.cumsum(change & certain) % 2 == 1))

        across = np.diff(pair, axis=1)[:, 0]
        expected = np.full_like(across, np.nan) if turned is None else turned[both, b] - turned[both, a]
        wrong, unknown = np.zeros((2, len(both)), dtype=bool)
        confirmed = False
        for stretch in np.split(np.arange(len(both)), np.flatnonzero(~certain) + 1):
            asked = stretch[~np.isnan(expected[stretch, 0])]
            labelled = np.where(state[asked, None], -across[asked], across[asked])
            off, off_exchanged = (
                float(np.median(np.linalg.norm(sign * labelled - expected[asked], axis=1)))
                if len(asked)
                else 0.0
                for sign in (1.0, -1.0)
            )
            if off < EXCHANGE_RATIO * off_exchanged:
                wrong[stretch] = state[stretch]
            elif off_exchanged < EXCHANGE_RATIO * off:
                wrong[stretch] = ~state[stretch]
            else:
                unknown[stretch] = state[stretch].any() and not state[stretch].all()
                continue
            confirmed |= not wrong[stretch].all()
        if wrong.any() and not confirmed:
            throughout.append((truth.names[a], truth.names[b]))
            continue
        exchanged[np.ix_(both[wrong], ab)] = True
        untold[np.ix_(both[unknown], ab)] = True
    return exchanged, untold & ~exchanged, tuple(throughout)


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
