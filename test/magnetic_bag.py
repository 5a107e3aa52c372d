"""Bags of sensor_msgs/MagneticField made elsewhere: written by rosbags, the readings by magpylib."""

from pathlib import Path

import numpy as np
from made_bags import T0
from paper_arm import REAL, PaperArm
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

from sesa2.configuration import files

STORE = get_typestore(Stores.ROS2_JAZZY)
FIELD = 'sensor_msgs/msg/MagneticField'
CONFIG = Path(__file__).resolve().parents[1] / 'config' / 'magnetic_3.yaml'
PERIOD_NS = 25_000_000  # 40 a second
# Between the first magnetometer of a sweep and each that follows.
APART_NS = 200_000


def configuration(**options):
    """Three segments, four magnetometers each, along z."""
    c = files.load(CONFIG)
    return c.with_options('magnetic', **options) if options else c


def motion(n):
    """Coordinates (n, 9) of a part of the paper's motion: 40 a second, ± 45° in 10 s."""
    turn = 2.0 * np.pi * np.arange(n) / 400.0
    q = np.empty((n, 3, 3))
    for i in range(3):
        phase = turn + 2.0 * np.pi * i / 3.0
        q[:, i, 0] = np.pi / 4 * np.sin(2.0 * phase)
        q[:, i, 1] = np.pi / 4 * np.sin(phase)
        q[:, i, 2] = 0.11 + 0.00275 * (1.0 + np.sin(phase))
    return q.reshape(n, -1)


def readings(q, *, noise=0.0):
    """(n, 12), T."""
    arm = PaperArm(3, 4, magnet=REAL)
    return arm.simulate(q) + np.random.default_rng(1).normal(0.0, 1.0, (len(q), 12)) * noise


def field_message(stamp_ns, xyz):
    types = STORE.types
    stamp = types['builtin_interfaces/msg/Time'](sec=int(stamp_ns // 10**9), nanosec=int(stamp_ns % 10**9))
    header = types['std_msgs/msg/Header'](stamp=stamp, frame_id='somewhere')
    vector = types['geometry_msgs/msg/Vector3'](*map(float, xyz))
    return bytes(STORE.serialize_cdr(types[FIELD](header, vector, np.zeros(9)), FIELD))


def of_z(value):
    """What a driver says of a sensor with one axis."""
    return (np.nan, np.nan, value)


def stamp_of(k, place):
    return T0 + k * PERIOD_NS + place * APART_NS


def write_fields(
    path, values, *, ids=None, namespace='/', as_field=of_z, change=lambda k, i, stamp, data: data
):
    """A bag of readings (n, m); `change` is given sweep, id, stamp and message: None leaves one out."""
    ids = ids or range(1, values.shape[1] + 1)
    with Writer(path, version=9) as bag:
        topics = {
            i: bag.add_connection(f'{namespace}magnetometer_{i}/field', FIELD, typestore=STORE) for i in ids
        }
        for k, row in enumerate(values):
            for place, (i, value) in enumerate(zip(ids, row, strict=True)):
                stamp = stamp_of(k, place)
                data = change(k, i, stamp, field_message(stamp, as_field(value)))
                if data is not None:
                    bag.write(topics[i], stamp + 1_000_000, data)
    return path
