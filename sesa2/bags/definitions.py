"""Definitions of message types: a bag carries the text of each type that it holds, so that it explains itself."""

from functools import cache
from typing import Any, NamedTuple

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

STRING = 'std_msgs/msg/String'
POSE_ARRAY = 'geometry_msgs/msg/PoseArray'
PATH = 'nav_msgs/msg/Path'

# As in msg_defs/msg/ but for its comments. That is a package of its own, which need not be there to read or write bags.
IMU_CALIBRATION = """\
std_msgs/Header header
uint8 id
uint8 sys
uint8 gyro
uint8 accel
uint8 mag
bool offsets_valid
int16[3] accel_offset
int16[3] mag_offset
int16[3] gyro_offset
int16 accel_radius
int16 mag_radius
"""


class Definition(NamedTuple):
    """Full text of a type, with all types inside it, and its hash (REP-2016)."""

    text: str
    hash: str


@cache
def typestore() -> Typestore:
    """All types of ROS 2 Jazzy and our own."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(IMU_CALIBRATION, 'sesa2_msgs/msg/ImuCalibration'))
    return store


def definition(type_name: str) -> Definition:
    """Definition of a type that sesa2 publishes, such as `nav_msgs/msg/Path`."""
    store = typestore()
    return Definition(store.generate_msgdef(type_name, ros_version=2)[0], store.hash_rihs01(type_name))


def deserialise(data: bytes, type_name: str) -> Any:
    """A message as an object with the fields of its definition; what is damaged raises anything."""
    return typestore().deserialize_cdr(data, type_name)


def string_message(text: str) -> bytes:
    """A std_msgs/String, serialised."""
    store = typestore()
    return bytes(store.serialize_cdr(store.types[STRING](data=text), STRING))
