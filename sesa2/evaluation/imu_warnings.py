"""What is wrong with the IMUs of a trial, as their own samples tell it."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sesa2.alignment.imu_suspects import Examination, Suspect, examine
from sesa2.configuration import Configuration
from sesa2.estimation.stuck import stuck_spans
from sesa2.evaluation.similarity import Similarity
from sesa2.shape.layout import Layout
from sesa2.shape.rotations import FloatArray, conjugate

# Simulated trials that are sound (nine arms, eight motions, 40 to 250 s) stay below 3.1 (loose, and then by less than
# 5°), 1.8 (place; four IMUs: 14 in 120 s), 0.9 (base) and 0.4 (lean).
EVIDENCE = {'loose': 3.0, 'place': 3.0, 'base': 1.3, 'lean': 1.2}
# Between few IMUs an arm bends more than a smooth shape does, all the time: such evidence grows with time, as that of a
# place does, and falls with the square of the distance between them.
SMOOTHED = 1.8  # 1/s, of a place, over the squared number of IMUs
TURNED = np.deg2rad(6.0)  # an IMU that is loose
TILTED = np.deg2rad(5.0)  # a base
LEANING = np.deg2rad(4.0)  # all mountings
MISPLACED = 0.25  # of the distance between stations
# What is left to all other causes; more, and shapes that are not so smooth, or several causes, pass for one.
REST = 6.0
REST_SHARE = 0.4  # of the evidence
AS_LIKELY = 2.0  # of evidence: another IMU might be it as well
MISFIT = 1.0  # sound arms have 0.05 to 0.4, those that bend sharply between their IMUs up to 0.7
ASK_CONJUGATED = 0.7
HALF_TURN = np.deg2rad(150.0)  # about z
CONJUGATE_FITS = 0.9  # of the misfit
CONJUGATE_ALONE = 0.3  # of a misfit that is large, where no truth says that it is half a turn
_PLACED = 6  # rounds; the first finds two thirds of the way
_EXAMINED = 4000  # sweeps


class ImuFindings(NamedTuple):
    """What the samples tell.

    Attributes
    ----------
    warnings
        one sentence each.
    explain_astray
        true where an IMU or the base was found to be what is wrong: why all markers go astray together.
    explain_frames
        true where the quaternions are conjugated, which looks like frames that differ.
    """

    warnings: tuple[str, ...]
    explain_astray: bool = False
    explain_frames: bool = False


def imu_warnings(
    c: Configuration,
    stamps: FloatArray,
    orientations: FloatArray,
    measured: np.ndarray,
    base: FloatArray,
    similarity: Similarity | None = None,
    *,
    odd: bool = False,
) -> ImuFindings:
    """Say which IMUs are stuck, loose or elsewhere, whether the base tilts and whether quaternions are conjugated.

    Parameters
    ----------
    c
        that the trial was estimated with.
    stamps : (n,)
        of the sweeps, s.
    orientations : (n, n_imu, 4)
        q_WS as measured, x y z w, unit norm.
    measured : (n, n_imu)
        true where the IMU has measured.
    base : (n, 4)
        q_WB.
    similarity
        between estimate and truth, where it is known.
    odd
        true where the truth agrees with the estimate mirrored or not at all, which conjugated quaternions make of it.
    """
    ids = c.imus.ids
    warnings = []
    measured = measured.copy()
    for i, spans in enumerate(stuck_spans(stamps, orientations, measured)):
        if not spans:
            continue
        for begin, end in spans:
            measured[(stamps >= begin) & (stamps <= end), i] = False
        seconds = sum(end - begin for begin, end in spans)
        warnings.append(
            f'IMU {ids[i]} was stuck: the same quaternion for {seconds:.1f} s in all, first at '
            f'{spans[0][0] - stamps[0]:.1f} s, while others turned.'
        )
    blamed = bool(warnings)
    step = -(-len(stamps) // _EXAMINED)
    samples = (stamps[::step], orientations[::step], measured[::step], base[::step])
    found = _examine(c, c.layout, *samples)
    if found is None:
        return ImuFindings(tuple(warnings), blamed)
    half = similarity is not None and abs(similarity.turn[2]) > HALF_TURN
    if odd or half or found.misfit > ASK_CONJUGATED:
        inverse = _examine(c, c.layout, samples[0], conjugate(samples[1]), *samples[2:])
        limit = CONJUGATE_FITS if odd or half else CONJUGATE_ALONE
        if inverse is not None and inverse.misfit < limit * found.misfit:
            warnings.append(
                f'The quaternions are conjugated: smooth shapes agree better with their inverses (misfit '
                f'{inverse.misfit:.2f} against {found.misfit:.2f}). An IMU has to say how its axes stand in the '
                f'world (q_WS), not how the world stands in its axes.'
            )
            return ImuFindings(tuple(warnings), True, True)
        if half and inverse is not None and inverse.misfit * CONJUGATE_FITS < found.misfit:
            warnings.append(
                "The truth's frame is turned by half a turn about z against the estimate's: the quaternions are "
                'conjugated, or x and y of one of the two point the other way.'
            )
    suspect = _suspect(found, c.layout, float(stamps[-1] - stamps[0]))
    if suspect is not None:
        warnings.append(_told(suspect, found, c, samples))
    elif found.misfit > MISFIT:
        warnings.append(
            f'The IMUs agree with no smooth shape (misfit {found.misfit:.2f}, expected 0.05 to 0.7): an id, a position '
            f'or a mounting is wrong, or the arm bends sharply between its IMUs.'
        )
    return ImuFindings(tuple(warnings), blamed or suspect is not None)


def _examine(
    c: Configuration,
    layout: Layout,
    stamps: FloatArray,
    orientations: FloatArray,
    measured: np.ndarray,
    base: FloatArray,
) -> Examination | None:
    return examine(stamps, orientations, measured, layout, base, c.mountings, c.headings)


def _suspect(found: Examination, layout: Layout, seconds: float) -> Suspect | None:
    """The best explanation, if it is one."""
    apart = float(np.min(np.diff(layout.stations)))
    least = {'loose': TURNED, 'base': TILTED, 'place': MISPLACED * apart, 'lean': LEANING}
    for s in found.suspects:
        alone = s.kind == 'lean' or s.rest <= max(REST, REST_SHARE * s.evidence)
        enough = EVIDENCE[s.kind] + (s.kind == 'place') * SMOOTHED * seconds / len(layout.imu_positions) ** 2
        if alone and s.evidence >= enough and abs(s.size) >= least[s.kind]:
            return s
    return None


def _told(
    s: Suspect,
    found: Examination,
    c: Configuration,
    samples: tuple[FloatArray, FloatArray, np.ndarray, FloatArray],
) -> str:
    if s.kind == 'base':
        return (
            f'The base moves: the arm and all IMUs tilt by {np.rad2deg(s.size):.0f}° after {100.0 * s.after:.0f} % of '
            f'the trial, which arm.base_orientation does not say.'
        )
    if s.kind == 'lean':
        return (
            f'All IMUs lean in their links, the same way by {np.rad2deg(s.size):.0f}°: the straight pose that they '
            f'were aligned in leaned, or the clamp leans otherwise than arm.base_orientation says.'
        )
    imu = c.imus.ids[s.imu]
    if s.kind == 'loose':
        return (
            f'IMU {imu} seems to be loose: after {100.0 * s.after:.0f} % of the trial its mounting is turned by '
            f'{np.rad2deg(s.size):.0f}°.'
        )
    off = _off_its_place(s, c, samples)
    where = 'farther from the base' if off > 0.0 else 'nearer to the base'
    others = [
        c.imus.ids[x.imu]
        for x in found.suspects
        if x.kind == 'place' and x.imu != s.imu and x.evidence > s.evidence - AS_LIKELY
    ]
    or_else = (
        f' Or IMU {" or ".join(map(str, others))} is off its place: they cannot be told apart.'
        if others
        else ''
    )
    return (
        f'IMU {imu} seems to be about {1e3 * abs(off):.0f} mm {where} than configured: its orientation is off by so '
        f"much times the arm's curvature there.{or_else}"
    )


def _off_its_place(
    s: Suspect, c: Configuration, samples: tuple[FloatArray, FloatArray, np.ndarray, FloatArray]
) -> float:
    """How far, by putting it where it seems to be and asking again, m."""
    places = np.array(c.layout.imu_positions)
    bounds = np.concatenate([[0.0], np.delete(places, s.imu), [c.layout.arm.length]])
    low, high = bounds[s.imu], bounds[s.imu + 1]
    place, move = places[s.imu], s.size
    for _ in range(_PLACED):
        place = float(np.clip(place + move, low + 0.02 * (high - low), high - 0.02 * (high - low)))
        moved = places.copy()
        moved[s.imu] = place
        found = _examine(c, replace(c.layout, imu_positions=tuple(moved.tolist())), *samples)
        if found is None:
            break
        move = next(x.size for x in found.suspects if x.kind == 'place' and x.imu == s.imu)
    return place - float(places[s.imu])
