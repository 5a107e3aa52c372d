"""A simulated arm with estimator and controller around it, as the configuration makes them; no clock, no ROS."""

from dataclasses import replace
from functools import cached_property

import numpy as np

from sesa2.alignment.straight_pose import align_straight
from sesa2.bags.recorded_sweeps import RecordedSweeps
from sesa2.configuration import Configuration
from sesa2.control import ControlState
from sesa2.evaluation.known_points import learn_from_points
from sesa2.evaluation.trajectory import Trajectory
from sesa2.sensing.imu.mounting import Mounting
from sesa2.shape.kinematics.constant_curvature import ConstantCurvature, arc_to
from sesa2.shape.measured import Measured
from sesa2.shape.rotations import conjugate, multiply, rotate

DT = 0.01
NS = 1e9


class LoopedArm:
    """An arm whose tip is driven by what its sensors say; from its home, straight, and started.

    Parameters
    ----------
    c
        the arm, its plant and its controller.
    feedback
        `model`: by what is measured; `truth`: the true tip; `none`: the inverse of the target is commanded.
    late
        additional latency of all that is fed back, steps.
    """

    def __init__(self, c: Configuration, feedback='model', late=0):
        self.c, self.feedback, self.late = c, feedback, late
        self.plant, self.controller = c.create_plant(), c.create_controller()
        self.model = c.create_model('pcc_delta')
        self.links = Mounting(c.mountings, c.headings)
        self.backbones = c.backbones
        self.driven = [c.lengths.names.index(name) for name in c.controller.names]
        self.racks = self.backbones.chosen(self.driven)
        self.arcs = ConstantCurvature(c.segments.lengths)
        self.end = [c.arm.length]
        self.t, self.k = 0.0, 0
        self.command = self.plant.encoders
        self.orientations, self.said = self.plant.imu_orientations, self.plant.said_lengths
        self.turned_tip = self.frozen = None
        self._late = []
        self.run(0.1)
        if feedback != 'none':
            self.controller.start()

    @cached_property
    def ids(self):
        """Of the IMUs, in the order of the plant."""
        return [*self.c.imus.ids, self.c.imus.base_id]

    def shape(self, orientations, said):
        """Tip, (..., 3), and coordinates, (..., k), of what is measured."""
        base = multiply(orientations[..., -1, :], conjugate(self.c.base_mounting))
        links = self.links.link_orientations(orientations[..., :-1, :])
        lengths, bends = self.backbones.read(said)
        backbone = self.model.fit(Measured(links, base, lengths, bends))
        return rotate(conjugate(base), backbone.positions(self.end)[..., 0, :]), backbone.coordinates

    def estimated(self):
        """The same now."""
        return self.shape(self.orientations, self.said)

    def step(self):
        """10 ms."""
        plant, controller = self.plant, self.controller
        plant.step(self.command, DT)
        self.t += DT
        self.k += 1
        if self.feedback == 'none':
            return
        q, said = plant.imu_orientations, plant.said_lengths
        if self.turned_tip is not None:
            q[-2] = multiply(q[-2], self.turned_tip)
        if self.frozen is not None:
            q[-2] = self.frozen
        self.orientations, self.said = q, said
        if self.feedback == 'truth':
            tip = plant.tip
            coordinates = arc_to(tip) if len(self.arcs.segment_lengths) == 1 else plant.coordinates
        else:
            tip, coordinates = self.shape(q, said)
        self._late.append((self.k * 10_000_000, q, said, tip, coordinates))
        if len(self._late) <= self.late:
            return
        stamp, q, said, tip, coordinates = self._late.pop(0)
        controller.hear_lengths(self.t, stamp, self.backbones.calibrated(said)[self.driven])
        for imu, orientation in zip(self.ids, q, strict=True):
            controller.hear_imu(self.t, imu, orientation)
        controller.hear_estimate(self.t, stamp, tip, coordinates)
        out = controller.step(self.t, DT)
        if out is not None:
            self.command = out

    def run(self, seconds):
        """True tips, (n, 3), m."""
        tips = []
        for _ in range(round(seconds / DT)):
            self.step()
            tips.append(self.plant.tip)
        return np.array(tips)

    def aim(self, target):
        """At a point in base_link, m."""
        if self.feedback != 'none':
            self.controller.hear_target(target)
            return
        reached = self.controller.reach.nearest(target)
        self.command = self.racks.backbones(*_split(reached.coordinates))

    def go(self, target, seconds):
        """Aim there, and the true tips on the way, (n, 3), m."""
        self.aim(target)
        return self.run(seconds)

    @property
    def held(self):
        """Why it holds; empty where it does not."""
        return self.controller.reason if self.controller.state is ControlState.HOLD else ''


def _split(coordinates):
    each = np.reshape(coordinates, (-1, 3))
    return each[:, 2], each[:, :2]


def aligned(c: Configuration) -> Configuration:
    """The configuration after `sesa2 align` of the arm straight at home for two seconds."""
    arm = LoopedArm(c, 'none')
    q = []
    for _ in range(200):
        arm.step()
        q.append(arm.plant.imu_orientations)
    q = np.array(q)
    base = multiply(q[:, -1], conjugate(c.base_mounting))
    links = q[:, :-1]
    there = np.ones(links.shape[:2], dtype=bool)
    found = align_straight(links, there, base, c.mountings, c.headings, ids=c.imus.ids)
    return c.with_alignment(found.mountings, found.headings)


def taught(c: Configuration, points) -> Configuration:
    """The configuration after `sesa2 align --truth` with the tip's true positions at rest, driven to some points."""
    arm = LoopedArm(c)
    stamps, q, said, tips = [], [], [], []
    for point in points:
        arm.go(point, 4.0)
        for _ in range(2):  # two sweeps that the instant lies between
            stamps.append(arm.k * 10_000_000)
            q.append(arm.orientations)
            said.append(arm.said)
            tips.append(arm.plant.tip)
            arm.step()
    q = np.array(q)
    base = multiply(q[:, -1], conjugate(c.base_mounting))
    there = np.ones((len(q), q.shape[1] - 1), dtype=bool)
    sweeps = RecordedSweeps(np.array(stamps), q[:, :-1], there, base, np.array(said), [])
    truth = Trajectory(np.array(stamps[::2]) / NS, np.array(tips[::2])[:, None], ('tip',))
    return learn_from_points(c, sweeps, truth, models=['pcc_delta']).configuration


def with_axis(c: Configuration) -> Configuration:
    """The same arm with one more length that is measured, on the axis of each segment."""
    a, m = c.lengths, len(c.segments.lengths)
    n = len(a.names)

    def each(values):
        return tuple(np.broadcast_to(np.asarray(values), (n,)).tolist())

    every = tuple(range(1, m + 1))
    lengths = replace(
        a,
        names=(*a.names, *(f'axis{k}' for k in every)),
        segments=(*each(a.segments), *every),
        starts=(*each(a.starts), *every),
        angles=(*each(a.angles), *[0.0] * m),
        radii=(*each(a.radii), *[0.0] * m),
        scales=(*each(a.scales), *[1.0] * m),
        offsets=(*each(a.offsets), *[0.0] * m),
    )
    return replace(c, lengths=lengths)
