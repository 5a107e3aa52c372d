"""A sound trial, and what people do to one: each wrong set-up as a change to what was configured or measured."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from sesa2.configuration import Configuration, validate
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep
from sesa2.evaluation.trajectory import Trajectory
from sesa2.shape.rotations import conjugate, multiply
from sesa2.time import NS

NAMES = ('M1', 'M2')
ARC_LENGTHS = {'M1': 0.36, 'M2': 0.60}
POSITIONS = (0.08, 0.16, 0.24, 0.32, 0.40, 0.48, 0.56, 0.64)


def configured(length=0.66, positions=POSITIONS, base=(0.0, 0.0, 0.0, 1.0), models=('pcc_exact', 'spline')):
    """Of the paper's arm, in the form of its file."""
    return validate(
        {
            'arm': {'length': length, 'base_orientation': list(base)},
            'imus': {'ids': list(range(1, len(positions) + 1)), 'positions': list(positions)},
            'markers': {'names': list(NAMES), 'positions': list(ARC_LENGTHS.values())},
            'models': list(models),
            'links': 8,
        }
    )


@dataclass(frozen=True, eq=False)
class MadeTrial:
    """What was configured, measured and seen. `q` (n, n_imu, 4) are q_WS, x y z w; `t` their stamps, s."""

    c: Configuration
    t: np.ndarray
    q: np.ndarray
    truth: Trajectory

    @property
    def sweeps(self):
        there = np.ones(self.q.shape[1], bool)
        return [Sweep(int(t * NS), q, there, None) for t, q in zip(self.t, self.q, strict=True)]

    @property
    def estimates(self):
        estimate = Estimator(self.c).estimate(self.sweeps)
        return {
            name: Trajectory(self.t, found.markers, NAMES, found.marker_orientations)
            for name, found in estimate.models.items()
        }

    def seconds(self, begin, end):
        inside, seen = ((t >= begin) & (t < end) for t in (self.t, self.truth.times))
        truth = Trajectory(self.truth.times[seen], self.truth.positions[seen], NAMES)
        return replace(self, t=self.t[inside], q=self.q[inside], truth=truth)

    def moved(self, positions, times=None):
        return replace(self, truth=Trajectory(self.truth.times if times is None else times, positions, NAMES))


def about(axis, degrees):
    return Rotation.from_euler(axis, degrees, degrees=True)


def turned(truth, rotation):
    p = truth.positions
    return rotation.apply(p.reshape(-1, 3)).reshape(p.shape)


def clamp_leans(trial, degrees=8.0):
    """The truth is seen from a clamp that leans, which the configuration does not say."""
    return trial.moved(turned(trial.truth, about('x', degrees).inv()))


def aligned_on_a_leaning_clamp(trial, degrees=8.0):
    """The straight pose leaned, so that every mounting was taken to lean the other way."""
    lean = about('x', degrees).as_quat()
    return replace(trial, q=multiply(trial.q, np.broadcast_to(conjugate(lean), trial.q.shape)))


def truth_tilted(trial, degrees=5.0):
    return trial.moved(turned(trial.truth, about('y', degrees)))


def truth_moved(trial, millimetres=20.0):
    return trial.moved(trial.truth.positions + 1e-3 * millimetres * np.array([0.6, -0.64, 0.48]))


def lengths_short(trial, share=0.05):
    """All that was measured along the arm with a wrong ruler."""
    scale = 1.0 - share
    c = trial.c
    markers = replace(c.markers, positions=tuple(scale * s for s in c.markers.positions))
    imus = replace(c.imus, positions=tuple(scale * s for s in c.imus.positions))
    return replace(
        trial, c=replace(c, arm=replace(c.arm, length=scale * c.arm.length), imus=imus, markers=markers)
    )


def clock_fast(trial, rate=1e-3):
    return trial.moved(trial.truth.positions, trial.truth.times * (1.0 + rate))


def imu_loose(trial, imu=4, degrees=10.0, axis='x', from_share=0.5):
    q = trial.q.copy()
    late = trial.t >= trial.t[0] + from_share * (trial.t[-1] - trial.t[0])
    q[late, imu] = multiply(q[late, imu], about(axis, degrees).as_quat())
    return replace(trial, q=q)


def imu_stuck(trial, imu=3, begin=8.0, seconds=5.0):
    q = trial.q.copy()
    held = (trial.t >= trial.t[0] + begin) & (trial.t < trial.t[0] + begin + seconds)
    q[held, imu] = q[np.argmax(held), imu]
    return replace(trial, q=q)


def imu_misplaced(trial, imu=3, metres=-0.04):
    """Configured where it is not."""
    positions = list(trial.c.imus.positions)
    positions[imu] += metres
    return replace(trial, c=replace(trial.c, imus=replace(trial.c.imus, positions=tuple(positions))))


def base_moves(trial, millimetres=40.0, period=20.0):
    """What the arm is clamped to sways; the IMUs feel nothing of it."""
    sway = 1e-3 * millimetres * np.sin(2.0 * np.pi * trial.truth.times / period)
    return trial.moved(trial.truth.positions + sway[:, None, None] * np.array([0.8, 0.6, 0.0]))


def base_knocked(trial, millimetres=40.0):
    """Within half a second, in the middle of the trial."""
    t = trial.truth.times
    share = np.clip((t - np.mean(t[[0, -1]])) / 0.5, 0.0, 1.0)
    return trial.moved(
        trial.truth.positions + 1e-3 * millimetres * share[:, None, None] * np.array([0.8, 0.6, 0.0])
    )


def conjugated(trial):
    return replace(trial, q=conjugate(trial.q))


def mirrored(trial):
    return trial.moved(trial.truth.positions[..., [0, 2, 1]])


def base_tilts(trial, degrees=8.0):
    """The clamp gives way in the middle; arm and IMUs lean with it, and the configuration does not say so."""
    lean = about('x', degrees)
    middle = np.mean(trial.truth.times[[0, -1]])
    q, p = trial.q.copy(), trial.truth.positions.copy()
    late, seen = trial.t > middle, trial.truth.times > middle
    q[late] = multiply(np.broadcast_to(lean.as_quat(), q[late].shape), q[late])
    p[seen] = lean.apply(p[seen].reshape(-1, 3)).reshape(p[seen].shape)
    return replace(trial, q=q, truth=Trajectory(trial.truth.times, p, NAMES))
