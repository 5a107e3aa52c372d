"""A robot description moved by its joint states, as on a graph, by a library that knows neither sesa2 nor ROS."""

import io
from dataclasses import replace

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from sesa2.configuration import validate
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep
from sesa2.messages.results import ResultMessages
from sesa2.messages.robot import describe_robot

yourdfpy = pytest.importorskip(
    'yourdfpy', reason='yourdfpy, the independent reader of URDF, is not installed'
)

STORE = get_typestore(Stores.ROS2_JAZZY)
TILTED = Rotation.from_rotvec([1.1, 0.4, -0.8])
ON_BASE = Rotation.from_rotvec([0.2, -2.0, 0.5])  # q_BS
BOUNDARIES = [0.0, 0.15, 0.3]
MARKERS = {'B': 0.25, 'A': 0.1}


def configured(base_imu):
    on_base = {'base_id': 8, 'base_mount_orientation': (1.008 * ON_BASE.as_quat()).tolist()}
    return validate(
        {
            'arm': {'length': 0.3, 'base_orientation': TILTED.as_quat().tolist()},
            'imus': {'ids': [1, 2], 'positions': [0.1, 0.3], **(on_base if base_imu else {})},
            'markers': {'names': list(MARKERS), 'positions': list(MARKERS.values())},
            'models': ['rigid'],
            'rigid': {'boundaries': BOUNDARIES[1:-1]},
        }
    )


def test_a_prefix_sets_the_frames_of_one_arm_apart_and_leaves_the_joints():
    for base_imu in (False, True):
        c = configured(base_imu)
        plain = yourdfpy.URDF.load(io.StringIO(describe_robot(c, 'rigid')))
        c = replace(c, arm=replace(c.arm, frame_prefix='left_'))
        prefixed = yourdfpy.URDF.load(io.StringIO(describe_robot(c, 'rigid')))
        assert set(prefixed.link_map) == {f'left_{name}' for name in plain.link_map}
        assert prefixed.base_link == 'left_world'
        assert prefixed.actuated_joint_names == plain.actuated_joint_names
        for name in plain.link_map:
            there = prefixed.get_transform(f'left_{name}', 'left_world')
            np.testing.assert_array_equal(there, plain.get_transform(name, 'world'))


def in_world(links, s):
    """Where arc length s of two straight links is: the clamp is the origin, whichever way it turns."""
    first = min(s, BOUNDARIES[1])
    return links[0].apply([0.0, 0.0, first]) + links[1].apply([0.0, 0.0, s - first])


def published(c, sweeps):
    """Names and angles of each joint state."""
    estimator = Estimator(c)
    messages = ResultMessages(c, estimator)
    [topic] = [topic for topic in messages.topics if topic.name == 'rigid/joint_states']
    for row in messages.make(topic, estimator.estimate(sweeps)):
        message = STORE.deserialize_cdr(row, topic.type)
        yield dict(zip(message.name, message.position, strict=True))


@pytest.mark.parametrize('base_imu', [False, True], ids=['fixed base', 'measured base'])
def test_description_and_joint_states_place_tip_and_markers_in_the_world(base_imu):
    c = configured(base_imu)
    steps = Rotation.from_rotvec(np.random.default_rng(4).uniform(-0.7, 0.7, (4, 2, 3)).reshape(-1, 3))
    bases, sweeps, arms = [], [], []
    for k in range(4):
        # Through heights and headings; at a heading of 90° the base's own joints are singular.
        turn = Rotation.from_euler('ZYX', [0.5 * np.pi * k, 0.6 * k * (k > 1), 0.3 * k * (k > 1)])
        base = turn if base_imu else TILTED
        links = [base * steps[2 * k], base * steps[2 * k] * steps[2 * k + 1]]
        on_base = (base * ON_BASE).as_quat() if base_imu else None
        q = np.array([link.as_quat() for link in links])
        sweeps.append(Sweep(10**18 + k * 10**7, q, np.ones(2, bool), on_base))
        bases.append(base)
        arms.append(links)
    robot = yourdfpy.URDF.load(io.StringIO(describe_robot(c, 'rigid')))
    for joints, base, links in zip(published(c, sweeps), bases, arms, strict=True):
        assert set(joints) == set(robot.actuated_joint_names)
        robot.update_cfg(joints)
        turned = robot.get_transform('base_link', 'world')[:3, :3]
        np.testing.assert_allclose(turned, base.as_matrix(), atol=1e-7)
        for frame, s in {'tip': 0.3, **MARKERS}.items():
            there = robot.get_transform(f'rigid_{frame}', 'world')[:3, 3]
            np.testing.assert_allclose(there, in_world(links, s), atol=1e-7)
