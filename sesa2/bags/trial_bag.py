"""A simulated trial as a bag: what the IMUs measured, and the true positions of the markers."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from sesa2.bags.definitions import POSE_ARRAY, STRING
from sesa2.bags.writing import new_bag
from sesa2.configuration import Configuration, files
from sesa2.messages.cdr import CdrLayout
from sesa2.messages.imu_messages import TYPE as IMU
from sesa2.messages.imu_messages import ImuMessages
from sesa2.messages.length_messages import LENGTHS_TYPE, LengthMessages
from sesa2.messages.topic_names import (
    BACKBONE_LENGTHS,
    CONFIGURATION,
    TRUTH_MARKERS,
    absolute,
    imu_frame,
    imu_topics,
)
from sesa2.shape.rotations import IDENTITY, FloatArray, conjugate, rotate
from sesa2.time import NS
from sesa2.twin.trial import Trial

TRIAL_FILE = 'trial.npz'
# The trial's clock begins at zero, which ROS takes for "no stamp".
START_NS = 1_700_000_000 * NS


class MeasuredLengths(NamedTuple):
    """What was measured of backbones.

    Attributes
    ----------
    times : (n,)
        by the trial's clock, s.
    lengths : (n, n_backbones)
        as a driver would say them, in the order of the configuration, m.
    """

    times: FloatArray
    lengths: FloatArray


def write_trial(
    trial: Trial, configuration: Configuration, out: str | Path, lengths: MeasuredLengths | None = None
) -> None:
    """Write a trial as a bag whose folder also holds the trial itself.

    Parameters
    ----------
    trial
        the trial.
    configuration
        that it was made with; the first message.
    out
        folder of the new bag.
    lengths
        what was measured of the backbones that the configuration names.

    Raises
    ------
    Sesa2Error
        the folder exists, or cannot be written.
    """
    with new_bag(out) as bag:
        text = CdrLayout().string(files.dump(configuration)).template()
        messages = []
        topics = imu_topics(configuration)
        for k, imu in enumerate(trial.sensor_ids.tolist()):
            topic = bag.add_topic(absolute(topics[imu]), IMU)
            maker = ImuMessages(imu_frame(configuration, imu))
            rows = maker.make_many(_stamps(trial.stamps[:, k]), trial.measured[:, k])
            messages += [
                (stamp, topic, row) for stamp, row in zip(_stamps(trial.stamps[:, k]), rows, strict=True)
            ]
        if lengths is not None:
            topic = bag.add_topic(absolute(BACKBONE_LENGTHS), LENGTHS_TYPE)
            stamps = _stamps(lengths.times)
            rows = LengthMessages(configuration.lengths.names).make_lengths(stamps, lengths.lengths)
            messages += [(stamp, topic, row) for stamp, row in zip(stamps, rows, strict=True)]
        poses = np.zeros((len(trial.truth_times), len(trial.marker_names), 7))
        # A base that is measured is not known well enough for anybody to turn the truth by it later.
        frame, turn = (
            ('base_link', conjugate(trial.base)) if configuration.imus.base_id else ('world', IDENTITY)
        )
        poses[..., :3] = rotate(turn, trial.markers)
        poses[..., 6] = 1.0
        n = poses.shape[1]
        truth = CdrLayout().header(configuration.frame(frame)).uint32(n).doubles(7 * n).template()
        topic = bag.add_topic(absolute(TRUTH_MARKERS), POSE_ARRAY)
        stamps = _stamps(trial.truth_times)
        messages += [
            (stamp, topic, row)
            for stamp, row in zip(stamps, truth.make(stamps, poses.reshape(len(stamps), -1)), strict=True)
        ]
        messages.sort(key=lambda message: message[0])
        first = messages[0][0]
        topic = bag.add_topic(absolute(CONFIGURATION), STRING, latched=True)
        bag.write(topic, int(first), text.make(np.array([first]), np.zeros((1, 0)))[0].tobytes())
        for stamp, topic, row in messages:
            bag.write(topic, int(stamp), row.tobytes())
        trial.save(bag.path / TRIAL_FILE)


def _stamps(seconds: np.ndarray) -> np.ndarray:
    return START_NS + np.round(seconds * NS).astype(np.int64)
