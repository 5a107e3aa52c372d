"""A bag of estimates as arrays: what every model said, over time."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sesa2.bags.definitions import STRING, deserialise
from sesa2.bags.recording import Recording, open_recording
from sesa2.configuration import Configuration, files
from sesa2.errors import Sesa2Error
from sesa2.messages.joint_states import JointStateLayout
from sesa2.messages.poses import StampedPoses, read_path, read_pose, read_pose_array
from sesa2.messages.results import model_joints
from sesa2.messages.topic_names import CONFIGURATION, of_model
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

_JOINT_KINDS = ('joint_states', 'coordinates')
_KINDS = ('joint_states', 'markers', 'tip', 'shape', 'coordinates')
_POSE = {'markers': read_pose_array, 'tip': read_pose, 'shape': read_path}


class ModelArrays(NamedTuple):
    """What one model said, in the frame of the results. NaN: its message is not in the bag.

    Attributes
    ----------
    joint_names
        the n_joints names, link by link from the base, x, z, y each, then those of a base that turns.
    joints, joint_velocities : (n, n_joints)
        rad, rad/s; NaN: not known, as of the first result.
    link_lengths, link_velocities : (n, n_links)
        of an arm that stretches, m, m/s; (n, 0) of one that does not.
    markers, marker_orientations : (n, n_markers, 3) and (…, 4)
        m; x y z w.
    tip, tip_orientation : (n, 3) and (n, 4)
        m; x y z w.
    backbone, backbone_orientations : (n, n_ends, 3) and (…, 4)
        ends of the model's links, base to tip, m; x y z w.
    backbone_positions : (n_ends,)
        their arc lengths, m.
    coordinate_names
        the n_coordinates names, segment by segment from the base; none where the model has no coordinates.
    coordinates : (n, n_coordinates)
        rad and m.
    """

    joint_names: tuple[str, ...]
    joints: FloatArray
    joint_velocities: FloatArray
    link_lengths: FloatArray
    link_velocities: FloatArray
    markers: FloatArray
    marker_orientations: FloatArray
    tip: FloatArray
    tip_orientation: FloatArray
    backbone: FloatArray
    backbone_orientations: FloatArray
    backbone_positions: FloatArray
    coordinate_names: tuple[str, ...]
    coordinates: FloatArray


class EstimateArrays(NamedTuple):
    """What is in a bag of estimates.

    Attributes
    ----------
    configuration
        that was in force; it says which markers there are, and where.
    frame
        of the results: `base_link`, or `world`, whose origin is at the clamp too.
    stamps_ns : (n,)
        times of the measurements, ns, strictly increasing.
    models
        by name.
    problems
        what was left out or is missing, one sentence each.
    """

    configuration: Configuration
    frame: str
    stamps_ns: np.ndarray
    models: dict[str, ModelArrays]
    problems: tuple[str, ...]

    @property
    def times_s(self) -> FloatArray:
        """Times of the measurements, s; (n,)."""
        return self.stamps_ns / NS


class _Series(NamedTuple):
    """One topic: the stamps of its messages and their numbers, a row each."""

    stamps_ns: np.ndarray
    rows: FloatArray


def read_estimate(path: str | Path, models: Sequence[str] | None = None) -> EstimateArrays:
    """Read all results in a bag.

    A recording that was played in a loop gives its first round. Rows are the instants at which any of the models said
    anything.

    Parameters
    ----------
    path
        a bag that `replay` or the recorder wrote.
    models
        names of models; all of the bag's configuration where it is None.

    Raises
    ------
    Sesa2Error
        the bag is not readable, no bag of ours, or has no results of a model.
    """
    path = Path(path)
    with open_recording(path) as recording:
        namespace, c = _configuration(recording)
        chosen = tuple(c.models if models is None else models)
        unknown = [name for name in chosen if name not in c.models]
        if unknown or len(set(chosen)) < len(chosen):
            got = f'no model {unknown[0]}' if unknown else f'models {", ".join(chosen)}: one is named twice'
            raise Sesa2Error(f'{path}: {got}; there are {", ".join(c.models)}')
        names, series, problems = _read(recording, namespace, chosen)
        problems += recording.problems
    for name in chosen:
        if not any(len(series[name, kind].stamps_ns) for kind in _KINDS):
            raise Sesa2Error(f'{path}: no results of {name}, expected topics {namespace}{name}/…')
    stamps = np.unique(np.concatenate([item.stamps_ns for item in series.values()]))
    found = {}
    for name in chosen:
        model, n_markers = c.create_model(name), len(c.markers.names)
        n_coordinates = len(model.coordinate_names)
        joints = np.array(model_joints(c, name, model.n_links))
        slides = np.char.endswith(joints, '_l')
        widths = (2 * len(joints), 7 * n_markers, 7, 7 * (model.n_links + 1), n_coordinates)
        rows = {}
        for kind, width in zip(_KINDS, widths, strict=True):
            rows[kind], lacking = _at(stamps, series[name, kind], width, f'{path}: {of_model(name, kind)}')
            if lacking and width:
                problems.append(
                    f'{of_model(name, kind)}: {lacking} of {len(stamps)} instants have no message; NaN there'
                )
        markers, tip, ends = (rows[kind].reshape(len(stamps), -1, 7) for kind in _KINDS[1:4])
        states, speeds = np.split(rows['joint_states'], 2, axis=1)
        turning = tuple(joints[~slides].tolist()) if len(names.get((name, 'joint_states'), ())) else ()
        found[name] = ModelArrays(
            turning, states[:, ~slides], speeds[:, ~slides], states[:, slides], speeds[:, slides],
            markers[..., :3], markers[..., 3:], tip[:, 0, :3], tip[:, 0, 3:],
            ends[..., :3], ends[..., 3:], model.link_ends,
            model.coordinate_names, rows['coordinates'],
        )  # fmt: skip
    return EstimateArrays(c, c.frame_id, stamps, found, tuple(problems))


def _configuration(recording: Recording) -> tuple[str, Configuration]:
    """The namespace of the topics, with a slash at its end, and the configuration that was in force."""
    topic = recording.find(CONFIGURATION, STRING)
    message = next(recording.messages([topic]), None) if topic else None
    if message is None:
        raise Sesa2Error(f'{recording.path}: has no topic configuration, expected a bag that sesa2 wrote')
    text = deserialise(message.data, STRING).data
    return message.topic.removesuffix(CONFIGURATION), files.parse(text, f'configuration in {recording.path}')


def _read(
    recording: Recording, namespace: str, models: Sequence[str]
) -> tuple[dict[tuple[str, str], tuple[str, ...]], dict[tuple[str, str], _Series], list[str]]:
    """Names of the joints and the topics, by model and kind, and what was left out."""
    wanted = {namespace + of_model(name, kind): (name, kind) for name in models for kind in _KINDS}
    stamps: dict[tuple[str, str], list[int]] = {key: [] for key in wanted.values()}
    rows: dict[tuple[str, str], list[FloatArray]] = {key: [] for key in wanted.values()}
    layouts: dict[tuple[str, str], JointStateLayout] = {}
    problems, again, unreadable = [], 0, 0
    for message in recording.messages(wanted):
        key = _, kind = wanted[message.topic]
        try:
            if kind in _JOINT_KINDS:
                if key not in layouts:
                    layouts[key] = JointStateLayout.of(message.data)
                stamp, row = layouts[key].read(message.data)
                if kind == 'joint_states':
                    row = np.concatenate([row, layouts[key].velocities(message.data)])
            else:
                poses: StampedPoses = _POSE[kind](message.data)
                stamp, row = poses.stamp_ns, poses.poses.ravel()
        except Sesa2Error:
            unreadable += 1
            continue
        if stamps[key] and stamp <= stamps[key][-1]:
            again += 1
            continue
        stamps[key].append(stamp)
        rows[key].append(row)
    if unreadable:
        problems.append(f'{unreadable} messages not used: damaged')
    if again:
        problems.append(
            f'{again} messages not used: not after the one before; of a loop the first round counts'
        )
    names = {key: layout.names for key, layout in layouts.items()}
    series = {}
    for key, values in rows.items():
        width = len(values[0]) if values else 0
        whole = [i for i, row in enumerate(values) if len(row) == width]
        if len(whole) < len(values):
            problems.append(
                f'{of_model(*key)}: {len(values) - len(whole)} messages not used: of another length'
            )
        series[key] = _Series(
            np.array([stamps[key][i] for i in whole], dtype=np.int64),
            np.array([values[i] for i in whole]).reshape(len(whole), width),
        )
    return names, series, problems


def _at(stamps_ns: np.ndarray, series: _Series, width: int, where: str) -> tuple[FloatArray, int]:
    """A topic's rows at all instants, and in how many of them it has none."""
    if len(series.stamps_ns) and series.rows.shape[1] != width:
        raise Sesa2Error(
            f'{where} has {series.rows.shape[1]} numbers a message, expected {width} by the configuration'
        )
    out = np.full((len(stamps_ns), width), np.nan)
    if len(series.stamps_ns):
        out[np.searchsorted(stamps_ns, series.stamps_ns)] = series.rows
    return out, len(stamps_ns) - len(series.stamps_ns)
