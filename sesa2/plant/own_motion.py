"""How the simulated arm moves where nobody commands it: it grows and shrinks, bends and circles, smoothly."""

import numpy as np

from sesa2.shape.rotations import FloatArray

STRAIGHT_S = 3.0
_FADE_S = 3.0
_LARGEST_BEND = 0.7  # of what a segment may bend
_WHOLE_ARM = 2.2  # rad, over all segments


class OwnMotion:
    """Coordinates over time; straight at its home first.

    Parameters
    ----------
    home, longest : (m,)
        lengths of the segments between which it grows and shrinks, m.
    bend_max
        of a segment, rad; it stays well below.
    rng
        source of chance: periods, directions and where in each of them it begins.
    """

    def __init__(self, home: FloatArray, longest: FloatArray, bend_max: float, rng: np.random.Generator):
        m = len(home)
        self._home, self._grow = home, np.maximum(longest - home, 0.0)
        self._bend = min(_LARGEST_BEND * bend_max, _WHOLE_ARM / m)
        self._periods = rng.uniform([[11.0], [13.0], [17.0]], [[15.0], [19.0], [25.0]], (3, m))
        self._direction = rng.uniform(0.0, 2.0 * np.pi, m)
        self._turn = rng.choice([-1.0, 1.0], m)

    def coordinates(self, t: float | FloatArray) -> FloatArray:
        """bend_x, bend_y, length of each segment at times t, s: (...) + (3 m,), rad and m."""
        t = np.maximum(np.asarray(t, dtype=float)[..., None] - STRAIGHT_S, 0.0)
        begun = np.minimum(t / _FADE_S, 1.0)
        begun = begun * begun * (3.0 - 2.0 * begun)
        grown, bent, turned = self._periods
        bend = begun * self._bend * 0.5 * (1.2 - np.cos(2.0 * np.pi * t / bent)) / 1.1
        azimuth = self._direction + self._turn * 2.0 * np.pi * t / turned
        length = self._home + self._grow * 0.5 * (1.0 - np.cos(2.0 * np.pi * t / grown))
        own = np.stack([bend * np.cos(azimuth), bend * np.sin(azimuth), length], axis=-1)
        return own.reshape(*own.shape[:-2], -1)
