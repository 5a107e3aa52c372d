"""The simulated arm by the clock: whoever asks takes it to that time, from whichever thread."""

import copy
import threading

import numpy as np
from numpy.typing import ArrayLike

from sesa2.configuration import Configuration
from sesa2.link.clock import steady_ns
from sesa2.plant.own_motion import OwnMotion
from sesa2.plant.simulated_arm import Plant
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

STEP_S = 0.01
# A process that was held up for longer does not make up for it: its arm stood still meanwhile.
_LONGEST_S = 2.0
# By itself it grows to so many times the length at rest, where `segments.stretch` allows it.
_GROWN = 1.4


class LivePlant:
    """A plant that moves with time, in steps of 10 ms; times are s since it was made.

    It moves by itself until somebody `commands`, and from then on does only what it is told.

    Parameters
    ----------
    configuration
        of the arm.

    Attributes
    ----------
    epoch_ns
        when it was made, by `sesa2.link.clock.steady_ns`.
    names
        of the backbones that take commands, in their order.
    obeys
        whether it waits for commands; before that it moves by itself.

    Raises
    ------
    GeometryError
        the section `plant` does not fit the arm.
    """

    def __init__(self, configuration: Configuration):
        self.plant = configuration.create_plant()
        names = configuration.lengths.names
        self.names = tuple(names[k] for k in self.plant.driven)
        self.epoch_ns = steady_ns()
        self.obeys = False
        self._motion = OwnMotion(
            self.plant.home,
            np.minimum(configuration.segments.stretch[1], _GROWN) * self.plant.segment_lengths,
            configuration.segments.bend_max,
            np.random.default_rng(configuration.plant.seed),
        )
        self._command = self.plant.encoders
        self._steps = 0
        self._stood_s = 0.0
        self._lock = threading.Lock()

    def now(self) -> float:
        """Time, s."""
        return (steady_ns() - self.epoch_ns) / NS

    def obey(self) -> None:
        """Move by itself no more: stay where it is until it is told."""
        with self._lock:
            self._stop()

    def command(self, lengths: ArrayLike) -> None:
        """Drive the racks to lengths as they are said, before scale and offset; (n,) in the order of `names`, m."""
        with self._lock:
            self._stop()
            self._command = self.plant.commanded(lengths)

    def push(self, bend: ArrayLike) -> None:
        """Push the arm: bend_x and bend_y, rad; 0 lets it go."""
        with self._lock:
            self.plant.push = np.array(bend, dtype=float)

    def copied_arm(self) -> Plant:
        """The arm as it is now, with the same future, to be moved by somebody else."""
        with self._lock:
            self._take_to(self.now())
            return copy.deepcopy(self.plant)

    def motion(self, t: ArrayLike) -> FloatArray:
        """What the IMUs measure at times t, s: q_WL, t.shape + (n_imu, 4), x y z w; what is still to come as now."""
        at = np.asarray(t, dtype=float)
        with self._lock:
            self._take_to(min(float(at.max()), self.now()))
            return self.plant.imu_orientations_at(at - self._stood_s)

    def said_lengths(self) -> tuple[float, FloatArray]:
        """When lengths were measured last, s, and what is said of all backbones, (n,), m."""
        with self._lock:
            self._take_to(self.now())
            return self._steps * STEP_S + self._stood_s, self.plant.said_lengths

    def coordinates_at(self, t: float) -> FloatArray:
        """True coordinates at a time of the last seconds, (3 m,): bend_x, bend_y, rad, and length, m, per segment."""
        with self._lock:
            self._take_to(min(t, self.now()))
            return self.plant.coordinates_at(t - self._stood_s)

    def _stop(self) -> None:
        if not self.obeys:
            self.obeys, self._command = True, self.plant.encoders

    def _take_to(self, t: float) -> None:
        """All steps that are over at this time."""
        behind = t - self._stood_s - self._steps * STEP_S
        if behind > _LONGEST_S:
            self._stood_s += behind - STEP_S
        while (self._steps + 1) * STEP_S <= t - self._stood_s + 1e-9:
            if not self.obeys:
                own = self._motion.coordinates(self.plant.time).reshape(-1, 3)
                self._command = self.plant.racks.backbones(own[:, 2], own[:, :2])
            self.plant.step(self._command, STEP_S)
            self._steps += 1
