"""Small recordings to play and to replay."""

from pathlib import Path

import numpy as np

from sesa2.bags.writing import new_bag
from sesa2.messages.imu_messages import TYPE, ImuMessages
from sesa2.shape.rotations import from_rotation_vector

T0 = 1_700_000_000_000_000_000
PERIOD_NS = 10_000_000


def stamps_of(seconds, start_ns=T0):
    """100 a second."""
    return start_ns + PERIOD_NS * np.arange(round(seconds * 100))


def write_bag(path, ids, stamps, *, also=()):
    """A recording of IMUs that turn slowly, each measured 0.5 ms after the one before.

    Parameters
    ----------
    path
        of the new bag.
    ids
        of the IMUs.
    stamps
        of the sweeps, ns; they need not go forward.
    also
        more messages: id, stamp and quaternion of each.
    """
    makers = {i: ImuMessages(f'imu_{i}') for i in {*ids, *(i for i, _, _ in also)}}
    with new_bag(path) as bag:
        topics = {i: bag.add_topic(f'/imu_{i}/data', TYPE) for i in makers}
        log_ns = T0
        for k, stamp in enumerate(stamps):
            for place, i in enumerate(ids):
                q = from_rotation_vector(np.array([0.1 * place, 0.3 * np.sin(0.02 * k), 0.0]))
                at = int(stamp) + 500_000 * place
                bag.write(topics[i], log_ns, makers[i].make(at, q))
                log_ns += PERIOD_NS // len(ids)
        for i, stamp, q in also:
            bag.write(topics[i], log_ns, makers[i].make(int(stamp), np.array(q)))
    return path


def cut(path, fraction=0.7):
    """Take the end off a bag, as a crash does."""
    [mcap] = Path(path).glob('*.mcap')
    mcap.write_bytes(mcap.read_bytes()[: int(fraction * mcap.stat().st_size)])
    (Path(path) / 'metadata.yaml').unlink()
    return path
