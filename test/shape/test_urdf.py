"""The robot description, read and moved by a library that knows nothing of sesa2."""

import io
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.messages.results import joint_names, link_names
from sesa2.shape.arm import Arm
from sesa2.shape.joints import joint_angles
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model
from sesa2.shape.rotations import IDENTITY, multiply, normalize
from sesa2.shape.urdf import robot_description

yourdfpy = pytest.importorskip(
    'yourdfpy', reason='yourdfpy, the independent reader of URDF, is not installed'
)

LAYOUT = Layout(Arm(0.66), (0.08, 0.16, 0.24, 0.32, 0.40, 0.48, 0.56, 0.64))
RADIUS = 0.0125
# Upright, hanging, horizontal (a pitch of 90°), nearly so, and any.
BASES = {
    'upright': IDENTITY,
    'hanging': np.array([1.0, 0.0, 0.0, 0.0]),
    'horizontal': np.array([0.0, 1.0, 0.0, 1.0]) / np.sqrt(2.0),
    'a hair off horizontal': Rotation.from_euler('ZYX', [0.4, np.pi / 2 - 3e-9, 0.3]).as_quat(),
    'oblique': normalize(np.array([0.3, -0.2, 0.5, 0.7])),
}


def bent(base, n=8, step=0.5, seed=3):
    rng = np.random.default_rng(seed)
    q, last = [], base
    for _ in range(n):
        last = multiply(last, Rotation.from_rotvec(step * rng.normal(size=3)).as_quat())
        q.append(last)
    return np.array(q)


def describe(name, model, base, markers=()):
    return robot_description(name, link_names(name, model.n_links), model.link_ends, RADIUS, base, markers)


def moved(description, angles):
    """The robot with its joints at these angles, by the library's own kinematics."""
    robot = yourdfpy.URDF.load(io.StringIO(description))
    robot.update_cfg(dict(zip(joint_names_of(description), angles.ravel(), strict=True)))
    return robot


def joint_names_of(description):
    return [j.get('name') for j in ET.fromstring(description).findall('joint') if j.get('type') == 'revolute']


def ends(robot, name, model):
    """Where each link begins, and the tip, in world: (n_links + 1, 3)."""
    frames = [*link_names(name, model.n_links), f'{name}_tip']
    return np.array([robot.get_transform(frame, 'world')[:3, 3] for frame in frames])


@pytest.mark.parametrize('base', BASES.values(), ids=BASES.keys())
@pytest.mark.parametrize(
    ('name', 'options'),
    [
        ('rigid', {}),
        ('rigid', {'boundaries': 'endpoint', 'base_link_length': 0.03}),
        ('pcc', {'segments': [1, 2, 3, 2, 2, 2, 2, 2]}),
    ],
)
def test_chains_stand_where_the_model_says(name, options, base):
    model = create_model(name, LAYOUT, **options)
    backbone = model.fit(Measured(bent(base), base))
    links = backbone.orientations(model.link_middles)
    angles = joint_angles(links, base).angles
    robot = moved(describe(name, model, base), angles)
    np.testing.assert_allclose(ends(robot, name, model), backbone.positions(model.link_ends), atol=1e-9)
    for frame, q in zip(link_names(name, model.n_links), links, strict=True):
        expected = Rotation.from_quat(q).as_matrix()
        np.testing.assert_allclose(robot.get_transform(frame, 'world')[:3, :3], expected, atol=1e-9)


def test_curves_agree_as_the_square_of_the_links():
    base = BASES['oblique']
    worst = []
    for links in (16, 32, 64):
        model = create_model('pcc_exact', LAYOUT, links=links)
        backbone = model.fit(Measured(bent(base), base))
        angles = joint_angles(backbone.orientations(model.link_middles), base).angles
        off = ends(moved(describe('pcc_exact', model, base), angles), 'pcc_exact', model)
        worst.append(np.linalg.norm(off - backbone.positions(model.link_ends), axis=1).max())
    # Links do not end where sections do, so the order shows over several doublings and not at each.
    assert worst[0] / worst[2] > 10.0
    assert worst[2] < 1e-3


def test_names_are_those_of_the_joint_states():
    model = create_model('pcc', LAYOUT, segments=[2] * 8)
    assert joint_names_of(describe('pcc', model, IDENTITY)) == joint_names('pcc', model.n_links)


def test_markers_sit_on_the_arm():
    base = BASES['oblique']
    model = create_model('pcc', LAYOUT, segments=[2] * 8)
    backbone = model.fit(Measured(bent(base), base))
    at = {'M1': 0.36, 'at a joint': 0.08, 'root': 0.0, 'a<b&"c"': 0.655, 'tip_ball': 0.66}
    description = describe('pcc', model, base, at.items())
    robot = moved(description, joint_angles(backbone.orientations(model.link_middles), base).angles)
    there = [robot.get_transform(f'pcc_{name}', 'world')[:3, 3] for name in at]
    np.testing.assert_allclose(there, backbone.positions(list(at.values())), atol=1e-9)


@pytest.mark.parametrize('base', BASES.values(), ids=BASES.keys())
def test_a_base_that_turns_is_three_joints_in_front_of_the_arm(base):
    model = create_model('pcc', LAYOUT, segments=[2] * 8)
    backbone = model.fit(Measured(bent(base), base))
    links = backbone.orientations(model.link_middles)
    description = describe('pcc', model, None, [('M1', 0.36)])
    names = ['base_x', 'base_z', 'base_y', *joint_names('pcc', model.n_links)]
    assert joint_names_of(description) == names
    angles = [Rotation.from_quat(base).as_euler('XZY'), *joint_angles(links, base).angles]
    robot = moved(description, np.array(angles))
    np.testing.assert_allclose(ends(robot, 'pcc', model), backbone.positions(model.link_ends), atol=1e-7)
    there = robot.get_transform('pcc_M1', 'world')[:3, 3]
    np.testing.assert_allclose(there, backbone.positions([0.36])[0], atol=1e-7)
    turned = robot.get_transform('base_link', 'world')
    np.testing.assert_allclose(turned[:3, :3], Rotation.from_quat(base).as_matrix(), atol=1e-7)
    np.testing.assert_array_equal(turned[:3, 3], 0.0)


@pytest.mark.parametrize('base', [IDENTITY, None], ids=['fixed base', 'base that turns'])
def test_it_is_one_tree_on_one_line(base):
    model = create_model('rigid', LAYOUT)
    description = describe('rigid', model, base, [('M1', 0.3)])
    assert '\n' not in description
    robot = ET.fromstring(description)
    links = [link.get('name') for link in robot.findall('link')]
    children = [joint.find('child').get('link') for joint in robot.findall('joint')]
    assert len(set(links)) == len(links)
    assert sorted([*children, 'world']) == sorted(links)
    assert not robot.findall('.//inertial')
    lengths = [float(c.get('length')) for c in robot.findall('.//cylinder')]
    np.testing.assert_allclose(lengths, np.diff(model.link_ends))
