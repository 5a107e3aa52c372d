"""Markers that swing at random."""

import numpy as np
from scipy.interpolate import CubicSpline

from sesa2.evaluation.trajectory import Trajectory

NAMES = ('M1', 'M2')


class Motion:
    """A smooth random swing of two markers about an arm that hangs from the origin, as a function of time."""

    def __init__(self, seed=0, duration=60.0):
        rng = np.random.default_rng(seed)
        self.duration = duration
        knots = np.arange(-10.0, duration + 10.0, 0.7)
        sway = rng.normal(0.0, 0.06, (len(knots), 1, 3)) * (1.0, 1.0, 0.4)
        places = np.array([[0.0, 0.0, 0.36], [0.0, 0.0, 0.60]]) + sway * np.array([0.6, 1.4])[:, None]
        places[:, 1] += rng.normal(0.0, 0.02, (len(knots), 3))
        self._spline = CubicSpline(knots, places)

    def at(self, times):
        return self._spline(times)

    def record(self, rate, start=0.0, stop=None):
        """As one clock saw it whose origin is the motion's."""
        times = np.arange(start, self.duration if stop is None else stop, 1.0 / rate)
        return Trajectory(times, self.at(times), NAMES)
