"""An arm that grows, as a graph sees it: forward kinematics by a library that knows neither sesa2 nor ROS."""

import io

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from sesa2.configuration import files, validate
from sesa2.configuration.description import describe
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep
from sesa2.messages.results import ResultMessages
from sesa2.messages.robot import describe_robot

yourdfpy = pytest.importorskip(
    'yourdfpy', reason='yourdfpy, the independent reader of URDF, is not installed'
)

STORE = get_typestore(Stores.ROS2_JAZZY)
MARKERS = {'clamp': 0.0, 'A': 0.1, 'B': 0.25, 'end': 0.3}
TILTED = Rotation.from_rotvec([1.1, 0.4, -0.8])
CURVES = ('pcc_exact', 'spline', 'smooth_rod', 'pcc_delta')
# Of an arm of 0.3 m that turns by some 30° from each of three IMUs to the next, in links of 25 mm.
CURVE_TOLERANCE = 1e-3


def configured(base_imu=False, lengths=True, **changes):
    """Two segments, which end within a link of `rigid`; the first by racks, the second by an encoder on its axis."""
    return validate(
        {
            'arm': {
                'length': 0.3,
                'base_orientation': TILTED.as_quat().tolist(),
                'frame_prefix': 'left_',
                'output_frame': 'world',
            },
            'imus': {'ids': [1, 2, 3], 'positions': [0.1, 0.2, 0.3], **({'base_id': 4} if base_imu else {})},
            'segments': {'lengths': [0.17, 0.13], 'stretch': [0.6, 1.7]},
            'markers': {'names': list(MARKERS), 'positions': list(MARKERS.values())},
            'models': ['rigid', 'pcc', *CURVES],
            'links': 12,
            **changes,
        }
        | (
            {
                'lengths': {
                    'names': ['b1', 'b2', 'b3', 'string'],
                    'segments': [1, 1, 1, 2],
                    'starts': [1, 1, 1, 2],
                    'angles': [0.0, 2.0944, 4.1888, 0.0],
                    'radii': [0.03, 0.03, 0.03, 0.0],
                    'offsets': [0.1, 0.1, 0.1, 0.0],
                }
            }
            if lengths
            else {}
        )
    )


def moving(c, n=2, seed=4):
    """Sweeps of a bending arm that grows, and the lengths of its segments."""
    rng = np.random.default_rng(seed)
    sweeps, lengths = [], rng.uniform(0.12, 0.2, (n, 2))
    for k in range(n):
        base = Rotation.from_rotvec(rng.normal(size=3)) if c.imus.base_id else TILTED
        q, last = [], base
        for _ in range(3):
            last = last * Rotation.from_rotvec(rng.uniform(-0.4, 0.4, 3))
            q.append(last.as_quat())
        on_base = base.as_quat() if c.imus.base_id else None
        said = None
        if c.has_lengths:
            said = c.backbones.backbones(lengths[k], rng.uniform(-0.5, 0.5, (2, 2))) - c.lengths.offsets
        sweeps.append(Sweep(10**18 + k * 10**7, np.array(q), np.ones(3, bool), on_base, said))
    return sweeps, lengths


def states_of(c, name, estimator, estimate):
    messages = ResultMessages(c, estimator)
    [topic] = [topic for topic in messages.topics if topic.name == f'{name}/joint_states']
    return [STORE.deserialize_cdr(data, topic.type) for data in messages.make(topic, estimate)]


@pytest.mark.parametrize('base_imu', [False, True], ids=['fixed base', 'measured base'])
def test_forward_kinematics_show_length_tip_and_markers(base_imu):
    c = configured(base_imu)
    estimator = Estimator(c)
    sweeps, lengths = moving(c)
    estimate = estimator.estimate(sweeps)
    for name, result in estimate.models.items():
        exact = name not in CURVES
        robot = yourdfpy.URDF.load(io.StringIO(describe_robot(c, name)))
        for k, message in enumerate(states_of(c, name, estimator, estimate)):
            joints = dict(zip(message.name, message.position, strict=True))
            assert set(joints) == set(robot.actuated_joint_names)
            of_links = [position for joint, position in joints.items() if joint.endswith('_l')]
            assert len(of_links) == estimator.models[name].n_links
            assert sum(of_links) == pytest.approx(lengths[k].sum(), abs=1e-12)
            robot.update_cfg(joints)
            frames = [f'left_{name}_tip', *(f'left_{name}_{marker}' for marker in MARKERS)]
            there = [robot.get_transform(frame, 'left_world')[:3, 3] for frame in frames]
            expected = [result.ends[k, -1], *result.markers[k]]
            np.testing.assert_allclose(there, expected, atol=1e-9 if exact else CURVE_TOLERANCE)
            if exact:
                frames = [f'left_{name}_{i:03d}_end' for i in range(1, len(of_links) + 1)]
                there = [robot.get_transform(frame, 'left_world')[:3, 3] for frame in frames]
                np.testing.assert_allclose(there, result.ends[k, 1:], atol=1e-9)


def test_limits_are_those_of_the_segments_and_tubes_cover_each_link():
    c = configured()
    robot = yourdfpy.URDF.load(io.StringIO(describe_robot(c, 'rigid')))
    rest = np.diff(c.create_model('rigid').link_ends)
    for i, length in enumerate(rest, start=1):
        joint = robot.joint_map[f'rigid_{i:03d}_l']
        assert (joint.type, joint.mimic) == ('prismatic', None)
        assert (joint.limit.lower, joint.limit.upper) == pytest.approx((0.6 * length, 1.7 * length))
        tubes = [
            robot.link_map[f'left_rigid_{i:03d}{end}'].visuals[0].geometry.cylinder.length
            for end in ('', '_end')
        ]
        assert max(tubes) <= 0.6 * length * (1.0 + 1e-12)  # none sticks out of the shortest link


def test_a_configuration_with_segments_alone_is_as_one_without():
    alone, none = configured(lengths=False), configured(lengths=False, segments={})
    for name in none.models:
        assert describe_robot(alone, name) == describe_robot(none, name)
    sweeps, _ = moving(alone)
    ours, theirs = (Estimator(c).estimate(sweeps) for c in (alone, none))
    for name, result in theirs.models.items():
        if name == 'pcc_delta':  # its arcs are the segments
            continue
        assert result.joints.shape[-1] == 3
        np.testing.assert_array_equal(result.joints, ours.models[name].joints)
        np.testing.assert_array_equal(result.ends, ours.models[name].ends)


@pytest.mark.parametrize('base_imu', [False, True])
@pytest.mark.parametrize('lengths', [False, True])
def test_configurations_are_described(base_imu, lengths):
    c = configured(base_imu, lengths)
    text = describe(c)
    assert 'Segments, base to tip' in text
    assert ('b2' in text) == lengths
    assert files.parse(files.dump(c), 'again') == c
