"""The tip controller: a target, feedback and the time in; lengths of the driven backbones out."""

from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from sesa2.control.controller_options import ControllerOptions
from sesa2.control.feedback_watch import FeedbackWatch
from sesa2.control.reach import Reach, Reached
from sesa2.control.tip_laws import TipFeedback, create_law
from sesa2.control.tip_path import TipPath
from sesa2.control.tip_reference import TipReference
from sesa2.errors import Sesa2Error
from sesa2.sensing.lengths import BackboneLengths
from sesa2.shape.rotations import FloatArray

# Where half of each motion slips, racks go far beyond what the shape asks of them (control-notes, pitfall 2).
_COMMAND_BEND = 3.0
# Nearer than that the target counts as reached as it is, m.
_LEFT = 1e-4
# So much faster than allowed may measured lengths seem to move, and so far at once, m: jitter of stamps, noise. However
# long the last ones are ago, they may have gone no further than in this time, s.
_TIMES_FASTER = 3.0
_AT_ONCE = 0.004
_LONGEST_S = 0.05


class ControlError(Sesa2Error):
    """A target or a measurement that is not steered by."""


class ControlState(Enum):
    """What the controller does."""

    STOPPED = 'stopped'
    RUNNING = 'running'
    LIMITED = 'limited: the target is out of reach'
    HOLD = 'hold'


class TipController:
    """Drives the tip of an arm to a target in base_link, at a fixed rate, by feedback of its shape.

    It starts stopped. A fault latches `HOLD`: the measured lengths go out once as command, then nothing until `start`,
    which goes on from the encoders, never from the last command. All times are those of one steady clock, s, at which
    something was received.

    Parameters
    ----------
    options
        of the controller.
    segment_lengths : (m,)
        at rest, m.
    backbones
        those that are driven: three a segment.
    bend_max, stretch
        limits of the segments, rad and as a share.
    imu_positions
        by IMU, material arc length, m; 0 on the base.

    Attributes
    ----------
    state
        what it does now.
    reason
        of the hold, or empty.
    target : (3,) or None
        as it was asked for, m.
    reached
        the nearest that the tip comes to it.
    refused
        how many targets and measured lengths were refused.

    Raises
    ------
    ControlError
        the backbones do not drive the segments.
    """

    def __init__(
        self,
        options: ControllerOptions,
        *,
        segment_lengths: ArrayLike,
        backbones: BackboneLengths,
        bend_max: float,
        stretch: ArrayLike,
        imu_positions: dict[int, float],
    ):
        if not backbones.drives:
            raise ControlError(
                f'{backbones.n_backbones} backbones on {backbones.n_segments} segments are driven, expected three a '
                'segment, beside its axis, that tell its length and bend'
            )
        self.options = options
        self.reach = Reach(segment_lengths, backbones, bend_max, stretch, options.length_limits)
        self._backbones = backbones
        rest = self.reach.kinematics.segment_lengths
        starts = np.concatenate([[0.0], np.cumsum(rest)[:-1]])
        places = {i: np.clip((s - starts) / rest, 0.0, 1.0) for i, s in imu_positions.items()}
        self.watch = FeedbackWatch(options.feedback_timeout, options.tip_speed, places)
        self._law = create_law(options, self.reach)
        self._reference = TipReference(options.tip_speed)
        self._path = TipPath(options.route == 'unbent', self.reach, options.tip_speed)
        self.state, self.reason = ControlState.STOPPED, ''
        self.target: FloatArray | None = None
        self.reached: Reached | None = None
        self.refused = {'targets': 0, 'lengths': 0}
        self._feedback: TipFeedback | None = None
        self._measured: FloatArray | None = None
        self._measured_stamp = 0
        self._command: FloatArray | None = None  # coordinates; None: to be taken from the encoders
        self._parting = False

    # What it hears

    def hear_target(self, target: ArrayLike) -> None:
        """Where the tip should go, (3,), m in base_link.

        Raises
        ------
        ControlError
            it is not finite, the origin, or below the clamp; the old one stays.
        """
        p = np.asarray(target, dtype=float)
        why = ''
        if p.shape != (3,) or not np.isfinite(p).all():
            why = 'expected three finite numbers'
        elif np.linalg.norm(p) < 1e-3:
            why = 'expected a point off the clamp, where the arm begins'
        elif p[2] <= 0.0:
            why = 'expected a point above the clamp, z > 0'
        if why:
            self.refused['targets'] += 1
            raise ControlError(f'target {np.round(p, 4).tolist()} m: {why}; the one before stays')
        self.target = p.copy()
        self.reached = self.reach.nearest(p, None if self._command is None else self._command)
        if self.state in (ControlState.RUNNING, ControlState.LIMITED):
            self.state = self._running()

    def hear_estimate(self, now: float, stamp_ns: int, tip: ArrayLike, coordinates: ArrayLike) -> None:
        """The shape by the model that is fed back: tip, (3,), m in base_link, and coordinates, (k m,), rad and m.

        Of each segment bend_x and bend_y come first and the length last, whatever the model has between them.
        """
        p = np.asarray(tip, dtype=float)
        q = (
            np.asarray(coordinates, dtype=float)
            .reshape(self._backbones.n_segments, -1)[:, [0, 1, -1]]
            .ravel()
        )
        if np.isfinite(p).all() and np.isfinite(q).all():
            self.watch.hear_tip(now, stamp_ns, p, q.reshape(-1, 3)[:, :2])
            self._feedback = TipFeedback(p, q)

    def hear_lengths(self, now: float, stamp_ns: int, lengths: ArrayLike) -> None:
        """Measured lengths of the driven backbones, (n,), m, scale and offset applied.

        Raises
        ------
        ControlError
            there are not n, one is no positive number, or one moved faster than the racks can; they are not used.
        """
        measured = np.asarray(lengths, dtype=float)
        why = ''
        if measured.shape != (self._backbones.n_backbones,):
            why = f'expected {self._backbones.n_backbones} numbers'
        elif not (np.isfinite(measured) & (measured > 0.0)).all():
            why = 'expected positive numbers'
        elif self._measured is not None and stamp_ns > self._measured_stamp:
            dt = (stamp_ns - self._measured_stamp) * 1e-9
            most = _TIMES_FASTER * self.options.length_rate * min(dt, _LONGEST_S) + _AT_ONCE
            jump = float(np.abs(measured - self._measured).max())
            if jump > most:
                why = f'{1e3 * jump:.0f} mm from the last ones in {1e3 * dt:.0f} ms, expected at most {1e3 * most:.0f}'
        if why:
            self.refused['lengths'] += 1
            raise ControlError(f'measured lengths {np.round(measured, 4).tolist()} m: {why}')
        if stamp_ns <= self._measured_stamp:
            return
        self._measured, self._measured_stamp = measured, stamp_ns
        self.watch.hear_lengths(now, stamp_ns, self._backbones.read(measured).bends)

    def hear_imu(self, now: float, imu_id: int, orientation: ArrayLike) -> None:
        """What an IMU measures, x y z w, as it came; told from one that is frozen."""
        self.watch.hear_imu(now, imu_id, orientation)  # type: ignore[arg-type]

    # What it is told

    def start(self) -> None:
        """Run, from what is measured from now on; without a target it holds the tip where it is."""
        self.watch.begin()
        self._command = self._feedback = self._measured = None
        self._measured_stamp = 0
        self.reason = ''
        self.state = self._running()
        self._waiting = True
        self._started: float | None = None

    def stop(self) -> None:
        """Send the measured lengths once, then nothing."""
        self._parting = self.state in (ControlState.RUNNING, ControlState.LIMITED)
        self.state, self.reason = ControlState.STOPPED, ''

    def _running(self) -> ControlState:
        out_of_reach = self.reached is not None and self.reached.left > _LEFT
        return ControlState.LIMITED if out_of_reach else ControlState.RUNNING

    # What it does

    def step(self, now: float, dt: float) -> FloatArray | None:
        """The command of this instant, (n,): lengths of the driven backbones, m; None: say nothing.

        Parameters
        ----------
        now
            s, by the clock of receipt.
        dt
            since the step before, s.
        """
        if self.state not in (ControlState.RUNNING, ControlState.LIMITED):
            if not self._parting:
                return None
            self._parting = False
            return self._measured
        if self._waiting and not self._arrived(now):
            return None
        if fault := self.watch.fault(now):
            return self._hold(fault)
        assert self._feedback is not None
        assert self._measured is not None
        if self._command is None:
            self._begin()
        assert self._command is not None
        to = self._reference.position
        if self.reached is not None:
            to = self._path.point(self.reached, self._feedback.tip, self._command, dt)
        self._reference.advance(to, dt)
        wanted = self._law.advance(self._reference, self._feedback, dt)
        if not np.isfinite(wanted).all():
            return self._hold('the law gave no number: the shape is singular')
        allowed = self._allowed(wanted)
        sent = self._command + self._slowed(allowed - self._command, dt) * (allowed - self._command)
        self._law.settle(allowed, sent)
        self._command = sent
        return self.reach.backbone_lengths(sent)

    def _arrived(self, now: float) -> bool:
        """Whether feedback has come since the start; what does not come in time is a fault."""
        if self._started is None:
            self._started = now
        there = self._feedback is not None and self._measured is not None
        self._waiting = not there and now - self._started <= max(self.options.feedback_timeout, 1.0)
        return not self._waiting

    def _begin(self) -> None:
        """From where the racks are and where the tip is estimated."""
        assert self._feedback is not None
        assert self._measured is not None
        lengths, bends = self._backbones.read(self._measured)
        self._command = np.column_stack([bends, lengths]).ravel()
        self._reference.reset(self._feedback.tip)
        self._path.begin()
        self._law.reset(self._command)

    def _allowed(self, wanted: FloatArray) -> FloatArray:
        """What racks can do; how far they go is no limit of the shape, as they slip."""
        q = wanted.copy()
        each = q.reshape(-1, 3)
        bend = np.hypot(each[:, 0], each[:, 1])
        each[:, :2] *= np.minimum(1.0, _COMMAND_BEND / np.maximum(bend, 1e-300))[:, None]
        return self.reach.driveable(q)

    def _slowed(self, step: FloatArray, dt: float) -> float:
        """Share of a step that the backbones can go in this time; its direction is kept."""
        way = self.reach.backbone_lengths(self.reach.straight + step) - self.reach.backbone_lengths(
            self.reach.straight
        )
        fastest = float(np.abs(way).max())
        return min(1.0, self.options.length_rate * dt / fastest) if fastest > 0.0 else 1.0

    def _hold(self, reason: str) -> FloatArray | None:
        self.state, self.reason, self._command = ControlState.HOLD, reason, None
        return self._measured
