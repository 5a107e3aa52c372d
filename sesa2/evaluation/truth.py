"""Where the markers truly were: motion capture, as files and bags hold it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sesa2.bags.captured_bodies import read_bodies
from sesa2.errors import Sesa2Error
from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.messages.topic_names import TRUTH_MARKERS, is_called
from sesa2.mocap.body_names import find_bodies, listed
from sesa2.mocap.capture import MotionCapture, TrackedBody
from sesa2.mocap.formats import read_motion_capture
from sesa2.shape.rotations import FloatArray

_BAGS = ('.mcap', '.db3', '.bag')
_STILL = 1e-3  # m; a body that moves less is the clamp, not a marker
_SAME_INSTANTS = 1.5  # times as many stamps as one body has; with more, bodies were not stamped together


class Truth(NamedTuple):
    """The markers of a recording.

    Attributes
    ----------
    trajectory
        of those of our markers that were seen.
    frame
        in which they are, empty where it is not known.
    notes
        what was found out, converted or left out, one sentence each.
    axes
        what has to be known of the axes unless a rotation is fitted; empty where there is nothing.
    """

    trajectory: Trajectory
    frame: str
    notes: tuple[str, ...]
    axes: str


def read_truth(
    path: str | Path,
    names: Sequence[str],
    *,
    topic: str | None = None,
    given: Mapping[str, str] | None = None,
    rate: float | None = None,
) -> Truth:
    """Read marker positions.

    Parameters
    ----------
    path
        a bag, or a file that a motion capture system exported (`mocap.formats`).
    names
        markers to read, as the configuration calls them.
    topic
        of a bag: where they are. Where it is None, truth/markers, or whatever carries poses.
    given
        our name of a marker → its name in the recording, where the two differ.
    rate
        of a file's frames, Hz, where it counts them and does not say how fast.

    Raises
    ------
    Sesa2Error
        the recording is not readable, none of the markers is in it, or none was seen.
    """
    path = Path(path)
    if path.is_dir() or path.suffix.lower() in _BAGS:
        capture = read_bodies(path, topic)
        found, notes = _of_bag(capture, names, given or {}, path.name, topic or '')
    else:
        capture = read_motion_capture(path, rate)
        found, notes = find_bodies(capture.bodies, names, given, path.name), []
    bodies = {name: capture.bodies[theirs] for name, theirs in found.items()}
    for name, body in bodies.items():
        if body.positions is None:
            raise EvaluationError(f'{path.name}: {found[name]} has orientations and no positions')
    frames = {body.frame for body in bodies.values()}
    if len(frames) > 1:
        raise EvaluationError(
            f'{path.name}: its markers are in different frames: {", ".join(sorted(frames))}'
        )
    absent = [name for name in names if name not in bodies]
    notes += [
        f'{path.name}: {name} is not in it and is not evaluated; there are {listed(capture.bodies)}'
        for name in absent
    ]
    trajectory, more = _together(bodies, path.name)
    return Truth(trajectory, frames.pop(), (*capture.notes, *notes, *more), capture.axes)


def _of_bag(
    capture: MotionCapture, names: Sequence[str], given: Mapping[str, str], file: str, asked: str
) -> tuple[dict[str, str], list[str]]:
    """Which bodies of a bag are ours; those of a PoseArray have no names, and come in our order."""
    arrays: dict[str, list[str]] = {}
    for body in capture.bodies:
        if body.endswith(']'):
            arrays.setdefault(body.rpartition('[')[0], []).append(body)
    called_so = [name for name in arrays if is_called(name, TRUTH_MARKERS)]
    if len(called_so) > 1 and not given:
        raise EvaluationError(
            f'{file}: {" and ".join(called_so)} are in it, expected the truth of one arm: --truth-topic says which'
        )
    ours = next(iter(called_so), '')
    array = ours or (next(iter(arrays)) if len(arrays) == 1 else '')
    try:
        if not ours or given:
            return find_bodies(capture.bodies, names, given, file), []
    except Sesa2Error:
        if given or not array:
            raise
    poses = arrays[array]
    if len(poses) == len(names):
        guessed = array != ours and not (asked and is_called(array, asked))
        note = f'{file}: the poses of {array} were taken for {", ".join(names)}, in this order'
        return dict(zip(names, poses, strict=True)), [note] if guessed else []
    still = [body for body in poses if np.ptp(_positions(capture.bodies[body]), axis=0).max() < _STILL]
    moving = [body for body in poses if body not in still]
    if len(moving) == len(names):
        note = f'{file}: {listed(still)} stands still: taken for the base, and {listed(moving)} for {listed(names)}'
        return dict(zip(names, moving, strict=True)), [note]
    raise EvaluationError(
        f'{file}: {array} has {len(poses)} poses, expected {len(names)}: {", ".join(names)}. '
        f'Say which is which: --marker {names[0]}={poses[0]}'
    )


def _positions(body: TrackedBody) -> FloatArray:
    assert body.positions is not None
    return body.positions


def _together(bodies: Mapping[str, TrackedBody], file: str) -> tuple[Trajectory, list[str]]:
    """The bodies at common times, and what was left out."""
    notes = []
    tracks: dict[str, tuple[FloatArray, FloatArray]] = {}
    late = partial = 0
    for name, body in bodies.items():
        # What was recorded a second time is left out: of a bag that was looped, the first round stays.
        first = np.concatenate([[True], body.times[1:] > np.maximum.accumulate(body.times)[:-1]])
        late = max(late, int((~first).sum()))
        positions = _positions(body)[first].copy()
        nan = np.isnan(positions)
        partial += int((nan.any(axis=1) & ~nan.all(axis=1)).sum())
        positions[nan.any(axis=1)] = np.nan
        if nan.any(axis=1).all():
            notes.append(f'{file}: {name} was never seen in {len(positions)} samples and is not evaluated')
        else:
            tracks[name] = body.times[first], positions
    if not tracks:
        raise EvaluationError(f'{file}: none of {", ".join(bodies)} was seen')
    if late:
        notes.append(f'{file}: {late} samples whose time is not after the one before were left out')
    if partial:
        notes.append(f'{file}: {partial} marker positions with a missing component count as not seen')

    times = next(iter(tracks.values()))[0]
    if not all(np.array_equal(times, t) for t, _ in tracks.values()):
        longest = max((t for t, _ in tracks.values()), key=len)
        times = np.unique(np.concatenate([t for t, _ in tracks.values()]))
        if len(times) <= _SAME_INSTANTS * len(longest):
            for name, (t, p) in tracks.items():  # a body that was not seen is missing from some instants
                there = np.full((len(times), 3), np.nan)
                there[np.searchsorted(times, t)] = p
                tracks[name] = times, there
        else:
            times = longest
            for name, (t, p) in tracks.items():
                tracks[name] = times, Trajectory(t, p[:, None], (name,)).at(times)[:, 0]
            notes.append(
                f'{file}: the markers were not seen at the same instants, and were interpolated to them'
            )
    return Trajectory(times, np.stack([p for _, p in tracks.values()], axis=1), tuple(tracks)), notes
