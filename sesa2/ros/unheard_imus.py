"""Why IMUs are not heard: what was expected, and what is on the graph instead."""

from collections.abc import Iterable, Mapping

from rclpy.node import Node

from sesa2.bags.topics import imu_topic
from sesa2.messages.imu_messages import TYPE

PATIENCE_S = 2.0


def why_unheard(node: Node, expected: Mapping[int, str], heard: Mapping[int, int]) -> str:
    """A sentence about the IMUs of which no message has come; empty where all were heard.

    Parameters
    ----------
    node
        that listens.
    expected
        topic of each IMU, by id.
    heard
        number of messages of each IMU.
    """
    silent = {i: node.resolve_topic_name(topic) for i, topic in expected.items() if not heard.get(i)}
    if not silent:
        return ''
    who = 'no IMU is heard' if len(silent) == len(expected) else f'not heard: IMU {_listed(silent)}'
    parts = [f'{who}; expected {_listed(silent.values())} of {TYPE}']
    # Topics are also known by who listens to them: this node itself.
    published = {
        name: types
        for name, _ in node.get_topic_names_and_types()
        if (types := sorted({one.topic_type for one in node.get_publishers_info_by_topic(name)}))
    }
    for name in silent.values():
        if name in published and TYPE not in published[name]:
            parts.append(f'{name} is of {" and ".join(published[name])}')
    known = {node.resolve_topic_name(topic) for i, topic in expected.items() if heard.get(i)}
    others = sorted(name for name, types in published.items() if TYPE in types and name not in known)
    parts.append(f'on the graph are of this type: {_listed(others) or "none"}')
    theirs = {imu.namespace for name in others if (imu := imu_topic(name)) and imu.id in silent}
    ours = node.get_namespace().rstrip('/') + '/'
    if elsewhere := sorted(theirs - {ours}):
        parts.append(f'these IMUs are in the namespace {_listed(n.rstrip("/") or "/" for n in elsewhere)}')
    elif others and not set(others) & set(silent.values()):
        parts.append('imus.topics says which is whose')
    return '; '.join(parts)


def _listed(things: Iterable[object]) -> str:
    return ', '.join(map(str, things))
