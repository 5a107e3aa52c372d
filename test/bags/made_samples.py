"""Samples of a small arm, to write and to read again."""

from typing import NamedTuple

import numpy as np

from sesa2.messages.imu_messages import TYPE, ImuMessages
from sesa2.shape.rotations import normalize

START_NS = 1_700_000_000_123_456_789
PERIOD_NS = 10_000_000
N_IMU = 3


class Made(NamedTuple):
    """A message that a test wrote."""

    topic: str
    stamp_ns: int
    orientation: np.ndarray
    data: bytes


def make_samples(n_sweeps, *, start_ns=START_NS, namespace='/', seed=1):
    """What three IMUs of a slowly moving arm measure, one after another in each sweep."""
    rng = np.random.default_rng(seed)
    resting = normalize(rng.normal(size=(N_IMU, 4)) * 0.2 + [0, 0, 0, 1])
    makers = [ImuMessages(f'imu_{i + 1}') for i in range(N_IMU)]
    made = []
    for k in range(n_sweeps):
        moved = normalize(resting + 0.1 * np.sin(0.05 * k + np.arange(4)))
        for i in range(N_IMU):
            stamp = start_ns + k * PERIOD_NS + i * 500_000
            made.append(
                Made(f'{namespace}imu_{i + 1}/data', stamp, moved[i], makers[i].make(stamp, moved[i]))
            )
    return made


def write_samples(bag, made):
    """Write them with our writer."""
    topics = {name: bag.add_topic(name, TYPE) for name in dict.fromkeys(m.topic for m in made)}
    for m in made:
        bag.write(topics[m.topic], m.stamp_ns, m.data)


def unmeasured(made):
    """The same message from an IMU that has not measured: all zero."""
    data = ImuMessages(made.topic.split('/')[-2]).make(made.stamp_ns, np.zeros(4))
    return made._replace(orientation=np.zeros(4), data=data)
