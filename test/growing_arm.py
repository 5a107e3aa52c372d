"""A small arm of two segments that grows: what its IMUs and its backbones say, as bags and as messages."""

import functools

import numpy as np
from made_bags import T0

from sesa2.bags.writing import new_bag
from sesa2.messages.imu_messages import TYPE, ImuMessages
from sesa2.messages.length_messages import LENGTHS_TYPE, LengthMessages
from sesa2.shape.rotations import from_rotation_vector

MS = 1_000_000
NAMES = ('axis', 'tip_l', 'tip_r')
IDS = (2, 5)
VALUES = {
    'arm': {'length': 0.3},
    'imus': {'ids': list(IDS), 'positions': [0.15, 0.3]},
    'segments': {'lengths': [0.15, 0.15]},
    # One on the axis of the first segment, two beside that of the second.
    'lengths': {
        'names': list(NAMES),
        'segments': [1, 2, 2],
        'starts': [1, 2, 2],
        'angles': [0.0, 0.0, 3.141592653589793],
        'radii': [0.0, 0.02, 0.02],
    },
    'markers': {'names': ['M1'], 'positions': [0.3]},
    'models': ['pcc', 'rigid'],
    'links': 4,
}


def lengths_at(t_ms):
    """What backbones say at times, (n,), ms: (n, 3), m."""
    t = np.asarray(t_ms, dtype=float)
    slow, fast = 0.02 * np.sin(t / 700.0), 0.01 * np.sin(t / 300.0)
    return np.stack([0.15 + slow, 0.14 + fast - slow, 0.16 + fast + slow], axis=-1)


def orientations_at(t_ms):
    """q_WS of both IMUs, (2, 4), x y z w."""
    bend = 0.4 * np.sin(t_ms / 900.0)
    return from_rotation_vector(np.array([[0.0, bend, 0.1], [0.2, 2 * bend, 0.0]]))


IMU_MAKERS = {i: ImuMessages(f'imu_{i}') for i in IDS}
LENGTH_MAKER = functools.cache(LengthMessages)


def length_message(t_ms, *, names=NAMES, values=None, start_ns=T0):
    """In CDR."""
    which = [NAMES.index(name) for name in names]
    values = lengths_at(t_ms)[which] if values is None else np.asarray(values, dtype=float)
    stamp = np.array([start_ns + round(t_ms * MS)])
    return LENGTH_MAKER(tuple(names)).make_lengths(stamp, values[None])[0].tobytes()


def imu_messages(t_ms, start_ns=T0):
    """(id, message in CDR) of a sweep; the second IMU is measured 1 ms after the first."""
    q = orientations_at(t_ms)
    stamp = start_ns + round(t_ms * MS)
    return [(i, IMU_MAKERS[i].make(stamp + k * MS, q[k])) for k, i in enumerate(IDS)]


def write_growing(path, sweeps_ms, lengths_ms, *, also=(), name='/backbone_lengths', rounds=1):
    """A recording: sweeps and lengths at these times; also: (time, ms, message) of lengths; sweeps in rounds of 4 s."""
    entries = []
    with new_bag(path) as bag:
        topics = {i: bag.add_topic(f'/imu_{i}/data', TYPE) for i in IDS}
        of_lengths = bag.add_topic(name, LENGTHS_TYPE)
        for begin in 4000.0 * np.arange(rounds):
            for t in sweeps_ms:
                entries += [
                    (begin + t + 1.5 + 0.1 * k, topics[i], data)
                    for k, (i, data) in enumerate(imu_messages(t))
                ]
        entries += [(t + 0.5, of_lengths, length_message(t)) for t in lengths_ms]
        entries += [(t, of_lengths, data) for t, data in also]
        for t, topic, data in sorted(entries, key=lambda entry: entry[0]):
            bag.write(topic, T0 + round(t * MS), data)
    return path
