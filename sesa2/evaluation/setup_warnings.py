"""What is wrong with the set-up of a trial, as far as estimate and truth tell it: frames, lengths, clocks, the base.

A cause is named where taking it away takes most of the error away, or where it is told by many times its standard
deviation, and where it is larger than sensors make it. The limits were chosen on simulated trials with a BNO055's
errors, of arms of 0.5 to 3 m, upright, lying and hanging: sound ones with at least four IMUs stay below 2° of tilt,
4° of turn about the vertical, 2 % of the arm in translation and 2 % in scale.
"""

from collections.abc import Mapping

import numpy as np

from sesa2.evaluation.registration import KINDS, TURNING, Kind, fit_registration
from sesa2.evaluation.similarity import Similarity
from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.shape.rotations import FloatArray, rotate

CUTS = 1.0 / 3.0  # of the error, by another registration, and it is told
AS_GOOD = 1.2  # times the least error: then the registration that fits less is preferred
WORSENS = 1.5  # times the error that a registration that fits less leaves on what is scored, and
WORSENS_BY = 0.02  # of the farthest marker's arc length

EXPLAINS = 0.6  # of the error is left at most, if a cause is to be named
TILT = np.deg2rad(2.5)
TURN = np.deg2rad(5.0)  # about the vertical, where magnetometers err
MOVED = 0.025  # of the farthest marker's arc length
# A shape that fits worse, in any frame and of any size, tells nothing of frames and sizes.
FITS = 0.03  # of the farthest marker's arc length
SCALE = 0.025
SCALE_TELLS = 5.0  # times its standard deviation

BASE_WINDOW = 1.0  # s, in which a base that moves goes along with all markers
BASE_SPAN = 10.0  # s, in which it hardly moves
BASE_LEAVES = 1.0 / 3.0
BASE_ALIKE = (
    1.25  # ratio of the error at the farthest to that at the nearest marker; shapes err more the farther out
)
BASE_UNSHAPED = 0.45  # of it does not follow from the arm's shape
BASE_CORRELATION = 0.92  # of the two


def registration_hints(
    register: Kind, medians: Mapping[Kind, float], of_all: Mapping[Kind, float], farthest: float
) -> list[str]:
    """Say which other registration would make much less of the error, or that this one made it worse.

    Parameters
    ----------
    register
        what was fitted.
    medians
        median error of what comes after the part that registrations are fitted on, m, by registration; those that
        cannot be fitted are left out.
    of_all
        the same, fitted on the whole trial and of all of it: a few seconds may agree with anything.
    farthest
        arc length of the farthest marker, m.
    """
    now = medians.get(register)
    if now is None:
        return []
    simpler = {k: m for k, m in medians.items() if KINDS.index(k) < KINDS.index(register)}
    if register == 'offsets':
        simpler.pop('rigid', None)
    if simpler:
        kind = min(simpler, key=lambda k: simpler[k])
        if now > max(WORSENS * simpler[kind], simpler[kind] + WORSENS_BY * farthest):
            warning = (
                f'--register {register} makes it worse: the median error of what is scored is {1e3 * now:.1f} mm, with '
                f'--register {kind} {1e3 * simpler[kind]:.1f} mm. What it was fitted on does not tell enough.'
            )
            return [warning]
    good = [
        k
        for k in KINDS
        if k in medians and medians[k] <= CUTS * now and of_all.get(k, np.inf) <= CUTS * of_all[register]
    ]
    if not good:
        return []
    least = min(medians[k] for k in good)
    kind = next(k for k in good if medians[k] <= AS_GOOD * least)
    frames = (
        'The frames of estimate and truth seem to differ' if kind in TURNING else 'Another registration fits'
    )
    warning = (
        f'{frames}: with --register {kind} the median error would be {1e3 * medians[kind]:.1f} mm instead of '
        f'{1e3 * now:.1f} mm.'
    )
    return [warning]


def cause_warnings(
    register: Kind,
    estimate: FloatArray,
    truth: Trajectory,
    similarity: Similarity | None,
    farthest: float,
) -> list[str]:
    """Name what is wrong with the frames, the lengths or the clocks.

    Parameters
    ----------
    register
        what was fitted.
    estimate : (n, m, 3)
        by the model that agrees best, at the truth's times by the clocks' rate, before any rotation or translation, m.
    truth
        what is compared with it.
    similarity
        between the two.
    farthest
        arc length of the farthest marker, m.
    """
    if similarity is None:
        return []
    y = truth.positions
    turned = rotate(similarity.rotation, estimate)
    none, moved = _median(estimate - y), _median(estimate + _shift(estimate, y) - y)
    rigid = _median(turned + _shift(turned, y) - y)
    warnings = []
    if register not in TURNING:
        now = none if register == 'none' else moved
        tilt, turn = float(np.hypot(*similarity.turn[:2])), float(abs(similarity.turn[2]))
        large = [
            text
            for text, angle, limit in (
                ('tilted by {:.1f}°', tilt, TILT),
                ('turned by {:.1f}° about z', turn, TURN),
            )
            if angle >= limit
            for text in (text.format(np.rad2deg(angle)),)
        ]
        if large and min(rigid, _median(turned - y)) <= EXPLAINS * now:
            warnings.append(
                f"The truth's frame is {' and '.join(large)} against the estimate's: the clamp leans or is turned "
                f"otherwise than arm.base_orientation says, or motion capture's axes are."
            )
    # Frames that are hardly turned are taken for parallel: a rotation about the arm's middle would move the origin.
    t = similarity.translation if warnings else _shift(estimate, y)
    if register == 'none' and np.linalg.norm(t) >= MOVED * farthest and min(moved, rigid) <= EXPLAINS * none:
        before = _median(turned - y) if warnings else none
        if rigid <= EXPLAINS * before:
            each = ', '.join(f'{1e3 * k:+.0f}' for k in t)
            warnings.append(
                f'The truth is moved by {1e3 * np.linalg.norm(t):.0f} mm against the estimate ({each} mm): '
                f"motion capture's origin is not at the clamp."
            )
    told = abs(similarity.scale - 1.0) >= max(SCALE, SCALE_TELLS * similarity.scale_std)
    if told and similarity.left <= FITS * farthest:
        percent = 100.0 * abs(similarity.scale - 1.0)
        size, lengths = ('larger', 'short') if similarity.scale > 1.0 else ('smaller', 'long')
        warnings.append(
            f"The truth is {percent:.1f} % {size} than the estimate: the configuration's lengths (arm.length and "
            f"positions along it) are too {lengths}, or motion capture's scale is wrong."
        )
    drift = abs(similarity.clock_rate) * similarity.seconds
    if abs(similarity.clock_rate) >= similarity.clock_told_from:
        pace = 'fast' if similarity.clock_rate > 0.0 else 'slow'
        warnings.append(
            f"The truth's clock runs {100.0 * abs(similarity.clock_rate):.3f} % {pace} against the estimate's: "
            f'{1e3 * drift:.0f} ms from the first to the last sample.'
        )
    return warnings


def base_warnings(estimate: FloatArray, truth: Trajectory, farthest: float) -> list[str]:
    """Say so where all markers go astray together, as on a base that moves.

    Parameters
    ----------
    estimate : (n, m, 3)
        by the model that agrees best, at the truth's times, m.
    truth
        of at least two markers, or nothing can be told.
    farthest
        arc length of the farthest marker, m.
    """
    if len(truth.names) < 2:
        return []
    y = truth.positions
    span = ((truth.times - truth.times[0]) // BASE_SPAN).astype(int)
    # The rotation from how the markers move within a span, so that it takes nothing of what a slow base does.
    try:
        rotation = fit_registration(
            'rigid', _centred(estimate + 0.0 * y, span), _centred(y + 0.0 * estimate, span)
        ).rotation
    except EvaluationError:
        return []
    off = y - rotate(rotation, estimate)
    off -= np.nanmean(off.reshape(-1, 3), axis=0)
    seen = ~np.isnan(off[..., 0]).any(axis=1)
    if not seen.any():
        return []
    off, times = off[seen], truth.times[seen]
    window = ((times - times[0]) // BASE_WINDOW).astype(int)
    n = np.maximum(np.bincount(window), 1)
    together = off.mean(axis=1)
    moved = np.stack([np.bincount(window, together[:, k]) / n for k in range(3)], axis=1)[window]
    if _left_by_shape(together, estimate[seen], farthest) < BASE_UNSHAPED:
        return []
    sizes = np.sqrt((off**2).sum(axis=(0, 2)))
    if not sizes.all():  # exact
        return []
    alike = float(np.sum(off[:, 0] * off[:, -1]) / (sizes[0] * sizes[-1]))
    rms = float(np.sqrt((moved**2).sum(axis=1).mean()))
    if (
        rms < MOVED * farthest
        or _median(off - moved[:, None]) > min(BASE_LEAVES * _median(off), FITS * farthest)
        or alike < BASE_CORRELATION
        or max(sizes) > BASE_ALIKE * min(sizes)
    ):
        return []
    warning = (
        f'All markers go astray together, by {1e3 * rms:.0f} mm rms: the base moves (or the motion capture), or an IMU '
        f'near the base is not where or how the configuration says.'
    )
    return [warning]


def _left_by_shape(together: FloatArray, estimate: FloatArray, farthest: float) -> float:
    """Share of what markers do together, (n, 3), that does not follow from where the estimate says that they are."""
    x = np.nan_to_num(estimate) / farthest
    nearness = np.linalg.norm(x, axis=2)
    features = np.concatenate([np.ones((len(x), 1)), x.reshape(len(x), -1), nearness, nearness**2], axis=1)
    left = together - features @ np.linalg.lstsq(features, together, rcond=None)[0]
    return float(np.sqrt((left**2).sum() / max(float((together**2).sum()), 1e-30)))


def _centred(p: FloatArray, span: np.ndarray) -> FloatArray:
    """Positions (n, m, 3) about the mean of their span of time, each marker of its own."""
    out = np.empty_like(p)
    seen = ~np.isnan(p[..., 0])
    n = int(span[-1]) + 1
    for m in range(p.shape[1]):
        there = seen[:, m]
        count = np.maximum(np.bincount(span[there], minlength=n), 1)
        for k in range(3):
            mean = np.bincount(span[there], p[there, m, k], minlength=n) / count
            out[:, m, k] = p[:, m, k] - mean[span]
    return out


def _shift(x: FloatArray, y: FloatArray) -> FloatArray:
    shift: FloatArray = np.nanmean((y - x).reshape(-1, 3), axis=0)
    return shift


def _median(off: FloatArray) -> float:
    return float(np.nanmedian(np.linalg.norm(off, axis=-1)))
