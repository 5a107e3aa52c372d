"""A simulated arm with a controller around it, step by step and without a clock."""

from dataclasses import replace

import numpy as np

from sesa2.control import TipController
from sesa2.control.controller_options import ControllerOptions
from sesa2.plant.simulated_arm import Plant
from sesa2.sensing.lengths import BackboneLengths
from sesa2.shape.kinematics.constant_curvature import ConstantCurvature, arc_to
from sesa2.shape.rotations import conjugate, multiply
from sesa2.shape.segment_bend import fit_bend

DT = 0.01


def racks(m, radius=0.03):
    """Three on each segment."""
    ends = np.repeat(np.arange(1, m + 1), 3).tolist()
    return BackboneLengths(m, 3 * m, ends, ends, np.tile(2 * np.pi / 3 * np.arange(3), m).tolist(), [radius])


class LoopedArm:
    """Estimates as `pcc_delta` does (`owner`), or knows the true tip (`owner=None`)."""

    def __init__(self, plant, *, segments=(0.16,), stretch=(0.75, 1.5), owner='tip', latency=0, **options):
        m = len(segments)
        ends = np.cumsum(segments)
        self.owner, self.latency = owner, latency
        self.backbones = racks(m)
        home = plant.home or (0.12,)
        self.plant = Plant(
            replace(plant, home=home),
            segment_lengths=segments,
            backbones=self.backbones,
            imu_positions=ends,
            base_imu=True,
        )
        limits = options.pop('length_limits', (0.05, 0.34))
        self.controller = TipController(
            ControllerOptions(length_limits=limits, **options),
            segment_lengths=segments,
            backbones=self.backbones,
            bend_max=1.6,
            stretch=stretch,
            imu_positions={i + 1: s for i, s in enumerate(ends)} | {m + 1: 0.0},
        )
        self.kinematics = ConstantCurvature(segments)
        self.t, self.k, self.command = 0.0, 0, self.plant.encoders
        self.sent, self._late = [], []
        self.freeze = self.silent = None
        self.knock = None
        self._frozen = None

    def estimate(self, q, lengths):
        chain = np.concatenate([q[-1:], q[:-1]])
        relative = multiply(conjugate(chain[:-1]), chain[1:])
        bends = fit_bend(relative, self.owner or 'tip').bend
        coordinates = np.column_stack([bends, lengths]).ravel()
        tip = self.kinematics.backbone(coordinates).positions([self.kinematics.arm.length])[0]
        return tip, coordinates

    def step(self):
        p = self.plant
        p.step(self.command, DT)
        self.t += DT
        self.k += 1
        stamp = self.k * 10_000_000
        q = p.imu_orientations
        if self.knock is not None:
            q[0] = multiply(q[0], self.knock)
        if self.freeze:
            if self._frozen is None:
                self._frozen = q[0].copy()
            q[0] = self._frozen
        encoders = p.encoders
        lengths = self.backbones.read(encoders).lengths
        tip, coordinates = self.estimate(q, lengths)
        if self.owner is None:
            tip, coordinates = p.tip, arc_to(p.tip) if len(p.home) == 1 else p.coordinates
        self.tip_estimated = tip
        self._late.append((stamp, encoders, q, tip, coordinates))
        if len(self._late) > self.latency:
            stamp, encoders, q, tip, coordinates = self._late.pop(0)
            if self.silent != 'lengths':
                self.controller.hear_lengths(self.t, stamp, encoders)
            for i in range(len(q)):
                self.controller.hear_imu(self.t, i + 1, q[i])
            if self.silent != 'estimate':
                self.controller.hear_estimate(self.t, stamp, tip, coordinates)
        out = self.controller.step(self.t, DT)
        if out is not None:
            self.command = out
            self.sent.append((self.t, out))

    def run(self, seconds):
        tips = []
        for _ in range(round(seconds / DT)):
            self.step()
            tips.append(self.plant.tip)
        return np.array(tips)

    def go(self, target, seconds=5.0):
        self.controller.hear_target(target)
        return self.run(seconds)
