"""The arm as a robot description (URDF), so that the tools of ROS which know joints can show it.

Each link hangs on its predecessor by revolute joints about x, z and y, in this order, with empty links between; its
frame begins at that joint, z along the link. So hangs a base that moves on the world. The angles are those of `joints`.

A link of an arm that stretches ends in a prismatic joint along it, whose position is the link's present length; what is
on the link follows it in proportion.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence

import numpy as np

from sesa2.shape.rotations import IDENTITY, FloatArray, rotate

_AXES = {'x': '1 0 0', 'z': '0 0 1', 'y': '0 1 0'}
# The joint about z lies between the singularities; effort and velocity only have to be there.
_LIMITS = {
    axis: {'lower': f'{-limit!r}', 'upper': f'{limit!r}', 'effort': '0', 'velocity': '100'}
    for axis, limit in (('x', math.pi), ('z', math.pi / 2), ('y', math.pi))
}


def robot_description(
    name: str,
    links: Sequence[str],
    link_ends: Sequence[float] | FloatArray,
    radius: float,
    base: Sequence[float] | FloatArray | None = IDENTITY,
    markers: Iterable[tuple[str, float]] = (),
    frame_prefix: str = '',
    stretch: Sequence[float] | None = None,
) -> str:
    """Describe an arm.

    Parameters
    ----------
    name
        of the robot; its tip is the link `<name>_tip`, its markers are `<name>_<marker>`.
    links
        names of the n links, base to tip. The joints of a link are `<link>_x`, `<link>_z`, `<link>_y`.
    link_ends : (n + 1,)
        arc lengths at which the links begin and end, m.
    radius
        of the arm, m.
    base : (4,)
        q_WB, x y z w: how `base_link` sits in `world`, the root. None: it turns, by the joints `base_x`, `base_z` and
        `base_y`.
    markers
        name and arc length, m, of each point to be shown.
    frame_prefix
        in front of the names of all links, which are those of the frames.
    stretch : (2,)
        smallest and largest length of a link over that at rest, of an arm that stretches: its links have a joint
        `<link>_l` more, and end in the frame `<link>_end`.

    Returns
    -------
    URDF on one line, so that it can be given as a parameter.
    """
    robot = ET.Element('robot', name=name)
    for material, rgba in (('arm', '0.35 0.55 0.75 1'), ('marker', '0.1 0.8 0.1 1')):
        ET.SubElement(ET.SubElement(robot, 'material', name=material), 'color', rgba=rgba)
    ET.SubElement(robot, 'link', name='world')
    if base is None:
        _add_turning(robot, 'base', 'base_link', 'world')
    else:
        ET.SubElement(robot, 'link', name='base_link')
        _join(robot, 'world_to_base', 'fixed', 'world', 'base_link', rpy=_rpy(np.asarray(base, dtype=float)))

    ends = [float(s) for s in link_ends]
    lengths = np.diff(ends).tolist()
    parent, offset = 'base_link', 0.0
    for link, length in zip(links, lengths, strict=True):
        element = _add_turning(robot, link, link, parent, offset)
        parent, offset = link, length
        if stretch is not None:
            parent, offset = f'{link}_end', 0.0
            _add_sliding(robot, element, link, length, stretch, radius)
        elif length:
            _add_visual(element, 'arm', 0.5 * length, 'cylinder', radius=repr(radius), length=repr(length))
    ET.SubElement(robot, 'link', name=f'{name}_tip')
    _join(robot, f'{name}_to_tip', 'fixed', parent, f'{name}_tip', z=offset)
    for marker, s in markers:
        i = min(int(np.searchsorted(ends[1:], s)), len(lengths) - 1)
        element = ET.SubElement(robot, 'link', name=f'{name}_{marker}')
        _add_visual(element, 'marker', 0.0, 'sphere', radius=repr(1.3 * radius))
        joint, along = f'{name}_to_{marker}', s - ends[i]
        if stretch is None:
            _join(robot, joint, 'fixed', links[i], f'{name}_{marker}', z=along)
        else:
            _slide(
                robot,
                joint,
                links[i],
                f'{name}_{marker}',
                along,
                stretch,
                (f'{links[i]}_l', along / lengths[i]),
            )
    for tag, key in (('link', 'name'), ('parent', 'link'), ('child', 'link')):
        for named in robot.iter(tag):
            named.set(key, frame_prefix + named.get(key, ''))
    return ET.tostring(robot, encoding='unicode')


def _add_turning(robot: ET.Element, joints: str, link: str, parent: str, offset: float = 0.0) -> ET.Element:
    """A link on three joints `<joints>_x`, `_z` and `_y`, so far along its parent; the link."""
    for axis, child in (('x', f'{joints}_after_x'), ('z', f'{joints}_after_z'), ('y', link)):
        element = ET.SubElement(robot, 'link', name=child)
        joint = _join(robot, f'{joints}_{axis}', 'revolute', parent, child, z=offset)
        ET.SubElement(joint, 'axis', xyz=_AXES[axis])
        ET.SubElement(joint, 'limit', _LIMITS[axis])
        parent, offset = child, 0.0
    return element


def _add_sliding(
    robot: ET.Element, link: ET.Element, name: str, length: float, stretch: Sequence[float], radius: float
) -> None:
    """The end of a link, on the joint `<link>_l`. Two tubes, one at each end, slide into each other."""
    end = ET.SubElement(robot, 'link', name=f'{name}_end')
    _slide(robot, f'{name}_l', name, f'{name}_end', length, stretch)
    tube = length * min(0.5 * stretch[1], stretch[0])
    for element, middle in ((link, 0.5 * tube), (end, -0.5 * tube)):
        _add_visual(element, 'arm', middle, 'cylinder', radius=repr(radius), length=repr(tube))


def _slide(
    robot: ET.Element,
    name: str,
    parent: str,
    child: str,
    length: float,
    stretch: Sequence[float],
    follows: tuple[str, float] | None = None,
) -> None:
    """A prismatic joint along z, of this length at rest; one that follows another has no state of its own."""
    joint = _join(robot, name, 'prismatic', parent, child)
    ET.SubElement(joint, 'axis', xyz=_AXES['z'])
    lower, upper = (repr(float(length * share)) for share in stretch)
    ET.SubElement(joint, 'limit', lower=lower, upper=upper, effort='0', velocity='100')
    if follows is not None:
        ET.SubElement(joint, 'mimic', joint=follows[0], multiplier=repr(float(follows[1])), offset='0')


def _add_visual(link: ET.Element, material: str, z: float, shape: str, **size: str) -> None:
    visual = ET.SubElement(link, 'visual')
    ET.SubElement(visual, 'origin', xyz=f'0 0 {z!r}')
    ET.SubElement(ET.SubElement(visual, 'geometry'), shape, size)
    ET.SubElement(visual, 'material', name=material)


def _join(
    robot: ET.Element, name: str, kind: str, parent: str, child: str, z: float = 0.0, rpy: str = '0 0 0'
) -> ET.Element:
    joint = ET.SubElement(robot, 'joint', name=name, type=kind)
    ET.SubElement(joint, 'parent', link=parent)
    ET.SubElement(joint, 'child', link=child)
    ET.SubElement(joint, 'origin', xyz=f'0 0 {float(z)!r}', rpy=rpy)
    return joint


def _rpy(q: FloatArray) -> str:
    """Roll, pitch and yaw of q: R = Rz(yaw) Ry(pitch) Rx(roll).

    A horizontal arm has a pitch of 90°, where yaw and roll cannot be told apart: whatever yaw comes out, roll is taken
    from what is left once it is undone, so that the rotation is exact all the same.
    """
    x, y, z = (rotate(q, axis) for axis in np.eye(3))  # columns of R
    pitch = math.atan2(-x[2], math.hypot(x[0], x[1]))
    yaw = math.atan2(x[1], x[0])
    sine, cosine = math.sin(yaw), math.cos(yaw)
    roll = math.atan2(sine * z[0] - cosine * z[1], cosine * y[1] - sine * y[0])
    return f'{roll!r} {pitch!r} {yaw!r}'
