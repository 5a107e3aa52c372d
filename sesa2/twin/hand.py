"""How the hand moves the arm: the three motions of the experiment (thesis 4.5.5), drawn from a seed."""

from collections.abc import Callable

import numpy as np

from sesa2.shape.rotations import FloatArray

# Each round shows every motion once; 40 s a motion makes the 250 s trial of the thesis two rounds and a straight pose.
MOTION_SECONDS = 40.0
SHORTEST_MOTION = 12.0
STRAIGHT_SECONDS = 5.0
FADE_SECONDS = 2.0

# A motion gives, for times from its beginning: the distance of the hand as a fraction of its arc length, the angle of
# its direction to the straight arm (signed, rad) and the azimuth of that direction (rad).
Polar = tuple[FloatArray, FloatArray, FloatArray]


def hand_path(
    seconds: float, rng: np.random.Generator, rate: float = 1000.0
) -> tuple[FloatArray, FloatArray]:
    """A hand's path: a straight pose, then oscillating, buckling and circling in random order.

    Parameters
    ----------
    seconds
        how long; a path shorter than 41 s shows fewer than all three motions.
    rng
        source of chance: order, amplitudes, periods, directions and tremor.
    rate
        samples per second.

    Returns
    -------
    times : (n,)
        s, from 0.
    positions : (n, 3)
        in the base frame (z along the straight arm), as a fraction of the hand's arc length.
    """
    times = np.arange(int(np.ceil(seconds * rate)) + 1) / rate
    straight = min(STRAIGHT_SECONDS, 0.25 * seconds)
    moving = seconds - straight
    rounds = max(1, round(moving / (3.0 * MOTION_SECONDS)))
    count = 3 * rounds if moving >= 3.0 * SHORTEST_MOTION else max(1, int(moving / SHORTEST_MOTION))
    order = np.concatenate([rng.permutation(3) for _ in range(rounds)])[:count]
    ends = straight + moving * np.arange(count + 1) / count
    distance, angle, azimuth = np.ones_like(times), np.zeros_like(times), np.zeros_like(times)
    for motion, start, end in zip(order, ends[:-1], ends[1:], strict=True):
        inside = (times >= start) & (times < end)
        t = times[inside] - start
        d, a, azimuth[inside] = _MOTIONS[motion](t, rng)
        # Every motion begins and ends straight, so that any can follow any.
        fade = _smooth_step(t / FADE_SECONDS) * _smooth_step((end - start - t) / FADE_SECONDS)
        distance[inside], angle[inside] = 1.0 + fade * (d - 1.0), fade * a
    direction = np.stack(
        [np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)], -1
    )
    begun = _smooth_step((times - straight) / FADE_SECONDS)
    return times, distance[:, None] * direction + begun[:, None] * _tremor(times, rng)


def _oscillate(t: FloatArray, rng: np.random.Generator) -> Polar:
    """To and fro through the straight pose along arcs, until the tip hangs below the base."""
    angle = (
        np.deg2rad(95.0)
        * (1.0 + _wander(t, 0.12, 25.0, rng))
        * np.sin(2.0 * np.pi * t / rng.uniform(17.0, 22.0))
    )
    return rng.uniform(0.95, 0.99) * _arc(angle), angle, _drift(t, rng.uniform(-2.5, 2.5), rng)


def _buckle(t: FloatArray, rng: np.random.Generator) -> Polar:
    """Nearly upright, pushed towards the base and let go."""
    depth = 0.43 * (1.0 + _wander(t, 0.1, 15.0, rng))
    distance = 0.99 - 0.5 * depth * (1.0 - np.cos(2.0 * np.pi * t / rng.uniform(5.0, 6.2)))
    return (
        distance,
        np.deg2rad(12.0) * (1.0 + _wander(t, 0.6, 13.0, rng)),
        _drift(t, rng.uniform(-7.0, 7.0), rng),
    )


def _circle(t: FloatArray, rng: np.random.Generator) -> Polar:
    """Round the base with the tip hanging: the dog that chases its tail."""
    angle = np.deg2rad(80.0) * (1.0 + _wander(t, 0.17, 14.0, rng))
    return (
        rng.uniform(0.94, 0.98) * _arc(angle),
        angle,
        _drift(t, rng.choice([-1.0, 1.0]) * rng.uniform(38.0, 47.0), rng),
    )


_MOTIONS: tuple[Callable[[FloatArray, np.random.Generator], Polar], ...] = (_oscillate, _buckle, _circle)


def _arc(angle: FloatArray) -> FloatArray:
    """Chord over arc length of an arc whose chord stands at `angle` to its beginning."""
    return np.sinc(angle / np.pi)


def _drift(t: FloatArray, rate: float, rng: np.random.Generator) -> FloatArray:
    """An azimuth that starts anywhere and turns at `rate` degrees per second."""
    return rng.uniform(0.0, 2.0 * np.pi) + np.deg2rad(rate) * t


def _wander(t: FloatArray, amplitude: float, period: float, rng: np.random.Generator) -> FloatArray:
    return amplitude * np.sin(2.0 * np.pi * (t / (period * rng.uniform(0.8, 1.2)) + rng.uniform()))


def _tremor(t: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A hand is not steady: about 3 mm on the paper's arm, at 0.3 to 1.5 Hz."""
    f, phase = rng.uniform(0.3, 1.5, (6, 3)), rng.uniform(0.0, 2.0 * np.pi, (6, 3))
    return 0.002 * np.sum([np.sin(2.0 * np.pi * f[k] * t[:, None] + phase[k]) for k in range(6)], axis=0)


def _smooth_step(x: FloatArray) -> FloatArray:
    """From 0 at 0 to 1 at 1 with continuous acceleration."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10.0 + x * (6.0 * x - 15.0))
