"""Bags of poses as drivers of motion capture publish them, serialised by rosbags."""

from typing import NamedTuple

from rosbags.typesys import Stores, get_typestore

from sesa2.bags.writing import new_bag

STORE = get_typestore(Stores.ROS2_JAZZY)
T = STORE.types
Q = (0.1, 0.2, 0.3, 0.9)  # x y z w


class Made(NamedTuple):
    """A message: type and bytes."""

    type: str
    data: bytes


def made(type_name, *fields):
    return Made(type_name, bytes(STORE.serialize_cdr(T[type_name](*fields), type_name)))


def header(stamp_ns, frame):
    stamp_ns = int(stamp_ns)
    return T['std_msgs/msg/Header'](
        T['builtin_interfaces/msg/Time'](stamp_ns // 10**9, stamp_ns % 10**9), frame
    )


def one_pose(place, q=Q):
    place = map(float, place)
    return T['geometry_msgs/msg/Pose'](
        T['geometry_msgs/msg/Point'](*place), T['geometry_msgs/msg/Quaternion'](*q)
    )


def pose(stamp_ns, *places, frame='mocap', array=False):
    poses = [one_pose(place) for place in places]
    if array:
        return made('geometry_msgs/msg/PoseArray', header(stamp_ns, frame), poses)
    return made('geometry_msgs/msg/PoseStamped', header(stamp_ns, frame), poses[0])


def point(stamp_ns, place, frame='mocap'):
    return made(
        'geometry_msgs/msg/PointStamped',
        header(stamp_ns, frame),
        T['geometry_msgs/msg/Point'](*map(float, place)),
    )


def transform(stamp_ns, child, place, frame='mocap'):
    return T['geometry_msgs/msg/TransformStamped'](
        header(stamp_ns, frame),
        child,
        T['geometry_msgs/msg/Transform'](
            T['geometry_msgs/msg/Vector3'](*map(float, place)), T['geometry_msgs/msg/Quaternion'](*Q)
        ),
    )


def write_topics(path, messages, start=0):
    """A bag of (topic, time in 10 ms, message); stamps and recording times both begin at `start`, ns."""
    with new_bag(path) as bag:
        topics = {}
        for topic, k, message in sorted(messages, key=lambda m: m[1]):
            if topic not in topics:
                topics[topic] = bag.add_topic(topic, message.type)
            bag.write(topics[topic], max(start + k * 10_000_000, 0), message.data)
    return path
