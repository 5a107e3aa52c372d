"""A bag of estimates against a recording of the truth: what `sesa2 evaluate` does, as a function."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sesa2.bags.reading import read_backbone, read_configuration
from sesa2.bags.recorded_poses import read_pose_topics
from sesa2.bags.recorded_sweeps import read_sweeps
from sesa2.bags.recording import Recording, open_recording
from sesa2.configuration import Configuration, files
from sesa2.errors import Sesa2Error
from sesa2.evaluation.drawn_pose import DrawnPose
from sesa2.evaluation.evaluate import Evaluation, evaluate
from sesa2.evaluation.imu_warnings import ImuFindings, imu_warnings
from sesa2.evaluation.registration import TURNING, Kind
from sesa2.evaluation.similarity import Similarity
from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.evaluation.truth import read_truth
from sesa2.messages.imu_messages import TYPE as IMU_TYPE
from sesa2.messages.topic_names import of_model
from sesa2.shape.rotations import FloatArray, conjugate, rotate
from sesa2.time import NS

_DRAWN_FROM = 20_000  # samples; to reach a later one, all before it must be read


def evaluate_bag(
    estimate: str | Path,
    truth: str | Path,
    *,
    truth_topic: str | None = None,
    markers: Mapping[str, str] | None = None,
    truth_rate: float | None = None,
    models: Sequence[str] | None = None,
    register: Kind = 'none',
    fit_fraction: float = 0.5,
    time_offset: float | None = None,
) -> Evaluation:
    """Compare the estimates in a bag with motion capture.

    Parameters
    ----------
    estimate
        a bag that `replay` or the recorder wrote; its configuration says which markers there are, and where.
    truth
        marker positions: a bag, or a file that a motion capture system exported.
    truth_topic
        where in a bag they are; found where it is None.
    markers
        our name of a marker → its name in the truth, where the two differ.
    truth_rate
        of the truth's frames, Hz, where it counts them and does not say how fast.
    models
        names of models; all of the bag's configuration where it is None.
    register
        what to fit between the frames, on the first part of the trial; the rest is scored. `none` scores all.
    fit_fraction
        how much of the trial (by time) the registration is fitted on, between 0 and 1.
    time_offset
        s, added to the estimates' times; None to find it.

    Returns
    -------
    The errors, with the pose to draw them around, and with all that a reader of them has to know as warnings.

    Raises
    ------
    Sesa2Error
        one of the two can't be read or holds no markers, or they do not belong together.
    """
    with open_recording(estimate) as recording:
        estimated = _read_estimate(recording, models)
        c = estimated.configuration
        read = read_truth(truth, c.markers.names, topic=truth_topic, given=markers, rate=truth_rate)
        true, about_frames = in_one_frame(read.trajectory, read.frame, c, estimated.frame, register)
        arc_lengths = dict(zip(c.markers.names, c.markers.positions, strict=True))
        try:
            evaluation = evaluate(
                estimated.models,
                true,
                {name: arc_lengths[name] for name in true.names},
                register=register,
                fit_fraction=fit_fraction,
                time_offset=time_offset,
            )
        except EvaluationError as error:  # such as quaternions that are conjugated, on an arm that lies
            found = _about_imus(recording, c, None, True).warnings
            if not found:
                raise
            raise EvaluationError(f'{error}. {" ".join(found)}') from None
        if read.axes and register not in TURNING:
            about_frames = (*about_frames, read.axes)
        if about_frames and register not in TURNING and 'rigid' in evaluation.alternatives:
            about_frames = (*about_frames[:-1], f'{about_frames[-1]} (--register rigid fits a rotation)')
        imus = _about_imus(recording, c, evaluation.similarity, evaluation.odd)
        told = evaluation.warnings
        # Where the samples tell the cause, what else it looks like is not told.
        if imus.explain_astray:
            told = tuple(w for w in told if w not in evaluation.astray)
        if imus.explain_frames:
            told = tuple(w for w in told if w not in evaluation.about_frames)
        warnings = (*read.notes, *about_frames, *imus.warnings, *told)
        return replace(evaluation, warnings=warnings, pose=estimated.pose)


class _Estimate(NamedTuple):
    """What is in a bag of estimates.

    Attributes
    ----------
    configuration
        that was in force.
    models
        marker trajectories by model.
    frame
        in which they are.
    pose
        of a bent backbone.
    """

    configuration: Configuration
    models: dict[str, Trajectory]
    frame: str
    pose: DrawnPose


def _read_estimate(recording: Recording, models: Sequence[str] | None) -> _Estimate:
    path = recording.path
    text = read_configuration(recording)
    if text is None:
        raise Sesa2Error(f'{path}: has no topic configuration, expected a bag that sesa2 wrote')
    c = files.parse(text, f'configuration in {path}')
    if not c.markers.names:
        raise Sesa2Error(f'{path}: its configuration has no markers, expected at least one to compare')
    chosen = models or c.models
    estimates = {}
    read = read_pose_topics(recording, [of_model(name, 'markers') for name in chosen])
    for name, poses in zip(chosen, read, strict=True):
        times, positions, turns = _increasing(poses.times_s, poses.positions, poses.orientations)
        estimates[name] = Trajectory(times, positions, c.markers.names, turns)
    # For the figures: a pose that shows the arm well bent, its last marker being a median distance from the base.
    model = c.create_model(chosen[-1])
    reach = np.linalg.norm(poses.positions[:_DRAWN_FROM, -1], axis=-1)
    pose = read_backbone(recording, of_model(chosen[-1], 'shape'), int(np.argsort(reach)[len(reach) // 2]))
    return _Estimate(c, estimates, poses.frame, DrawnPose(model.link_ends, pose))


def in_one_frame(
    truth: Trajectory, frame: str, c: Configuration, estimated: str, register: str
) -> tuple[Trajectory, tuple[str, ...]]:
    """The truth in the estimate's frame where the way there is known, and what a reader has to know about it.

    Parameters
    ----------
    truth, frame
        the truth, and its frame; empty where that is not known.
    c, estimated
        configuration and frame of the estimate.
    register
        kind of registration that is fitted.
    """
    if not frame or not estimated or frame == estimated:
        return truth, ()
    if {frame, estimated} == {c.frame('world'), c.frame('base_link')} and not c.imus.base_id:
        q = (
            c.base if frame == c.frame('base_link') else conjugate(c.base)
        )  # both have their origin at the clamp
        if abs(q[3]) == 1.0:
            return truth, ()
        done = "the truth was turned by arm.base_orientation of the estimate's configuration"
        truth = Trajectory(truth.times, rotate(q, truth.positions), truth.names)
    elif register in TURNING:
        return truth, ()
    else:
        done = 'the way from one to the other is not known'
    return truth, (f'The truth is in frame {frame}, the estimate in {estimated}: {done}.',)


def _about_imus(
    recording: Recording, c: Configuration, similarity: Similarity | None, odd: bool
) -> ImuFindings:
    """What the IMUs' samples tell, where the bag holds them."""
    if not any(topic.count and topic.type == IMU_TYPE for topic in recording.topics.values()):
        return ImuFindings(())
    try:
        sweeps = read_sweeps(recording, c, sampled=True)
    except Sesa2Error as error:
        return ImuFindings((f'The IMUs in it were not examined: {error}.',))
    stamps = (sweeps.stamps_ns - sweeps.stamps_ns[0]) / NS
    return imu_warnings(c, stamps, sweeps.orientations, sweeps.measured, sweeps.base, similarity, odd=odd)


def _increasing(times: FloatArray, *of_them: FloatArray) -> tuple[FloatArray, ...]:
    """Without what was recorded a second time: of a bag that was looped, the first round."""
    first = np.concatenate([[True], times[1:] > np.maximum.accumulate(times)[:-1]])
    return times[first], *(values[first] for values in of_them)
