"""The simulated arm's measurements as a recording, for tests and benchmarks."""

import numpy as np

from sesa2.bags.writing import new_bag
from sesa2.messages.cdr import CdrLayout
from sesa2.messages.imu_messages import TYPE

START_NS = 1_700_000_000 * 10**9
BETWEEN_IMUS_NS = 500_000  # eight are read within 4 ms


def write_twin_recording(npz, out, seconds=None):
    """Write what eight IMUs measured, as `imu_1/data` … `imu_8/data`, one after another in each sweep.

    Parameters
    ----------
    npz
        the simulation: `ti` (n,) s and `q` (n, 9, 4), w x y z, the base first.
    out
        the new bag.
    seconds
        how much of it; all where None.

    Returns
    -------
    stamps_ns : (n, 8) and orientations : (n, 8, 4), x y z w, as written.
    """
    with np.load(npz) as twin:
        t, q = twin['ti'], twin['q'][:, 1:, [1, 2, 3, 0]]
    if seconds is not None:
        t, q = t[t < seconds], q[t < seconds]
    n_imu = q.shape[1]
    stamps = START_NS + np.round(t * 1e9).astype(np.int64)[:, None] + BETWEEN_IMUS_NS * np.arange(n_imu)
    values = np.zeros((n_imu, len(t), 37))
    values[..., :4] = q.swapaxes(0, 1)
    values[..., [13, 25]] = -1.0  # neither angular velocity nor acceleration
    rows = [
        CdrLayout().header(f'imu_{i + 1}').doubles(37).template().make(stamps[:, i], values[i])
        for i in range(n_imu)
    ]
    with new_bag(out) as bag:
        topics = [bag.add_topic(f'/imu_{i + 1}/data', TYPE) for i in range(n_imu)]
        for k in range(len(t)):
            for i, topic in enumerate(topics):
                bag.write(topic, int(stamps[k, i]), rows[i][k].tobytes())
    return stamps, q
