"""A link that loses and repeats packets, as a reliable DDS does: late, and in order within a topic."""

import numpy as np


def over_a_link(samples, *, loss, delay_ns, seed):
    """Send samples, (IMU, stamp), over a link; (arrival, IMU, stamp) in order of arrival.

    A packet that is lost is sent again after twice the delay and 10 ms. What was sent after it on its topic waits.
    """
    rng = np.random.default_rng(seed)
    free, arrivals = {}, []
    for i, stamp in samples:
        repeated = rng.geometric(1.0 - loss) - 1
        arrival = stamp + delay_ns + int(rng.integers(200_000)) + int(repeated) * (2 * delay_ns + 10_000_000)
        free[i] = max(arrival, free.get(i, 0) + 1)
        arrivals.append((free[i], i, stamp))
    return sorted(arrivals)
