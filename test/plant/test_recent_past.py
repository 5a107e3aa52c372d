"""What is kept of the past, against interpolation over all of it."""

import numpy as np
from numpy.testing import assert_allclose

from sesa2.plant.recent_past import RecentPast


def test_it_keeps_what_it_says_and_holds_the_ends():
    rng = np.random.default_rng(0)
    times, rows = np.cumsum(rng.uniform(0.01, 0.1, 100)), rng.normal(size=(100, 3))
    past = RecentPast(8, times[0], rows[0])
    assert_allclose(past.at(-5.0), rows[0])
    assert_allclose(past.at(np.array([[5.0], [-5.0]])), np.tile(rows[0], (2, 1, 1)))
    for k in range(1, 100):
        past.append(times[k], rows[k])
        first = max(0, k - 7)
        at = np.append(rng.uniform(times[first], times[k], 5), [times[first], times[k]])
        expected = np.stack([np.interp(at, times, rows[:, i]) for i in range(3)], axis=-1)
        assert_allclose(past.at(at), expected, atol=1e-12)
    assert_allclose(past.at(1e9), rows[-1])
    assert past.at(times[95]).shape == (3,)
