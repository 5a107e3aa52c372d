"""What the estimator publishes for each model, as bytes: the same for the live node and for a replay."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sesa2.configuration import Configuration
from sesa2.estimation.estimator import Estimate, Estimator
from sesa2.messages.cdr import CdrLayout, Template
from sesa2.messages.colours import model_colours
from sesa2.messages.topic_names import of_model
from sesa2.shape.rotations import FloatArray

TYPES = {
    'joint_states': 'sensor_msgs/msg/JointState',
    'coordinates': 'sensor_msgs/msg/JointState',
    'markers': 'geometry_msgs/msg/PoseArray',
    'tip': 'geometry_msgs/msg/PoseStamped',
    'shape': 'nav_msgs/msg/Path',
    'marker_array': 'visualization_msgs/msg/MarkerArray',
}


# Joints by which a measured base turns in the world. They follow those of the arm, which so keep their places.
BASE_JOINTS = ('base_x', 'base_z', 'base_y')


class ResultTopic(NamedTuple):
    """A topic of the estimator."""

    name: str
    type: str


def joint_names(model: str, n_links: int, stretches: bool = False) -> list[str]:
    """Names of a model's joints: link by link from the base, x, z, y each, and l of an arm that stretches."""
    joints = 'xzyl' if stretches else 'xzy'
    return [f'{link}_{joint}' for link in link_names(model, n_links) for joint in joints]


def link_names(model: str, n_links: int) -> list[str]:
    """Names of a model's links, base to tip, counted from 1."""
    return [f'{model}_{i:03d}' for i in range(1, n_links + 1)]


def model_joints(c: Configuration, model: str, n_links: int) -> list[str]:
    """Names in `<model>/joint_states`: those of its links, then those of a base that turns."""
    return joint_names(model, n_links, c.stretches(model)) + (list(BASE_JOINTS) if c.imus.base_id else [])


class ResultMessages:
    """Makes the messages of every model.

    Parameters
    ----------
    configuration
        of the estimator.
    estimator
        the estimator.
    """

    def __init__(self, configuration: Configuration, estimator: Estimator):
        self._templates: dict[ResultTopic, Template] = {}
        self._moving: dict[ResultTopic, Template] = {}  # with velocities
        frame, markers = configuration.frame_id, len(configuration.markers.names)
        for name, model in estimator.models.items():
            n = model.n_links
            joints = model_joints(configuration, name, n)
            layouts = {
                'joint_states': _joint_state(joints, moving=False),
                'markers': CdrLayout().header(frame).uint32(markers).doubles(7 * markers),
                'tip': CdrLayout().header(frame).doubles(7),
                'shape': path_layout(frame, n + 1),
                'marker_array': _marker_array(frame, name, n + 1, configuration),
            }
            if model.coordinate_names:
                layouts['coordinates'] = _joint_state(model.coordinate_names, moving=False)
            for kind, layout in layouts.items():
                self._templates[ResultTopic(of_model(name, kind), TYPES[kind])] = layout.template()
            topic = ResultTopic(of_model(name, 'joint_states'), TYPES['joint_states'])
            self._moving[topic] = _joint_state(joints, moving=True).template()

    @property
    def topics(self) -> list[ResultTopic]:
        """Every topic, models in the order of the configuration."""
        return list(self._templates)

    def make(self, topic: ResultTopic, estimate: Estimate) -> list[bytes]:
        """Messages of one topic, one of each result.

        Joint states carry velocities where they are known; a list without entries says that they are not.
        """
        model, _, kind = topic.name.partition('/')
        result, stamps = estimate.models[model], estimate.stamps_ns
        if kind != 'joint_states':
            return _messages(self._templates[topic].make(stamps, _NUMBERS[kind](result)))
        numbers = [values.reshape(len(stamps), -1) for values in (result.joints, result.joint_velocities)]
        if estimate.base_joints is not None and estimate.base_velocities is not None:
            numbers = [numbers[0], estimate.base_joints, numbers[1], estimate.base_velocities]
        states = np.concatenate(numbers, axis=-1)
        unknown = np.isnan(states[:, -1])  # all of a message or none
        if not unknown.any():
            return _messages(self._moving[topic].make(stamps, states))
        still, messages = self._templates[topic], _messages(self._moving[topic].make(stamps, states))
        unmoved = _messages(still.make(stamps[unknown], states[unknown, : still.n_doubles]))
        for i, message in zip(np.flatnonzero(unknown).tolist(), unmoved, strict=True):
            messages[i] = message
        return messages


def _messages(rows: np.ndarray) -> list[bytes]:
    if len(rows) == 1:
        return [rows.tobytes()]
    size, together = rows.shape[1], rows.tobytes()
    return [together[k : k + size] for k in range(0, len(together), size)]


def _joint_state(joints: Sequence[str], *, moving: bool) -> CdrLayout:
    """With velocities, or without; without efforts."""
    n = len(joints)
    layout = CdrLayout().header('').strings(joints).uint32(n).doubles(n)
    if moving:
        layout.uint32(n).doubles(n)
    else:
        layout.uint32(0)
    return layout.uint32(0)


def path_layout(frame: str, n: int) -> CdrLayout:
    """A nav_msgs/Path of n poses."""
    layout = CdrLayout().header(frame).uint32(n)
    for _ in range(n):
        layout.header(frame).doubles(7)
    return layout


_GREEN = (0.1, 0.8, 0.1)
_LINE_STRIP, _SPHERE_LIST = 4, 7


def _marker_array(frame: str, model: str, n_ends: int, configuration: Configuration) -> CdrLayout:
    """The backbone as a line as thick as the arm, the markers as spheres."""
    diameter = 2.0 * configuration.arm.radius
    layout = CdrLayout().uint32(2)
    for number, (kind, points, scale, colour) in enumerate(
        [
            (
                _LINE_STRIP,
                n_ends,
                diameter,
                tuple(c / 255 for c in model_colours(configuration.models)[model]),
            ),
            (_SPHERE_LIST, len(configuration.markers.names), 1.3 * diameter, _GREEN),
        ]
    ):
        layout.header(frame).string(model).uint32(number).uint32(kind).uint32(0)  # namespace, id, type, add
        layout.constants(0, 0, 0, 0, 0, 0, 1)  # pose
        layout.constants(scale, scale, scale).float32(*colour, 1.0)
        layout.uint32(0).uint32(0).uint8(0)  # lifetime: for ever; not frame-locked
        layout.uint32(points).doubles(3 * points)
        layout.uint32(0).string('')  # colours of the points, texture
        layout.uint32(0).uint32(0).string('').string('').uint32(0).uint32(
            0
        )  # texture image and its coordinates
        layout.string('').string('').string('').uint32(0).uint8(0)  # text, mesh
    return layout


def _flat(*parts: FloatArray) -> FloatArray:
    return np.concatenate(parts, axis=-1).reshape(len(parts[0]), -1)


_NUMBERS = {
    'coordinates': lambda r: r.coordinates,
    'markers': lambda r: _flat(r.markers, r.marker_orientations),
    'tip': lambda r: _flat(r.ends[:, -1], r.end_orientations[:, -1]),
    'shape': lambda r: _flat(r.ends, r.end_orientations),
    'marker_array': lambda r: np.concatenate([_flat(r.ends), _flat(r.markers)], axis=-1),
}
