"""One line a second on the terminal: what the system does, and how far it is from the truth where that is known."""

import time
from collections.abc import Mapping

import numpy as np

from sesa2.configuration import Configuration
from sesa2.control import ControlState
from sesa2.link.clock import steady_ns
from sesa2.sensing.imu.addresses import CHANNELS
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model
from sesa2.shape.rotations import FloatArray, conjugate, rotate
from sesa2.system.open_loop import OpenLoop
from sesa2.system.wiring import System

_PERIOD_S = 1.0
_DRIVES = (ControlState.RUNNING, ControlState.LIMITED)
_LOW = 0.9  # of the highest


class Terminal:
    """Prints rate of the IMUs, tip of every model, its distance from the truth, lost packets and calibration.

    Parameters
    ----------
    system
        what runs; its nodes are asked directly, since they are in this process.
    """

    def __init__(self, system: System):
        self._system = system
        self._due = self._last = time.monotonic()
        self._received: dict[int, int] = {}
        self._open_loop: OpenLoop | None = None

    def show_when_due(self) -> None:
        """Print the line, once a second."""
        now = time.monotonic()
        self._follow_open_loop(now)
        if now >= self._due:
            self._due = now + _PERIOD_S
            estimator = self._system.estimator
            if estimator.latest if estimator else self._scores():
                parts = [
                    part
                    for part in (
                        self._rates(now),
                        self._tips(),
                        self._control(),
                        self._link(),
                        self._scores(),
                    )
                    if part
                ]
                print(' | '.join(parts))
            self._last = now

    def show_summary(self) -> None:
        """Print what the whole run came to."""
        parts = []
        if estimator := self._system.estimator:
            fields = estimator.fields
            parts.append(f'{estimator.n_sweeps + (fields.n_sweeps if fields else 0)} sweeps estimated')
            parts += [f'{n} samples dropped: {why}' for why, n in estimator.assembler.dropped.items()]
            if fields:
                parts += [f'{n} fields dropped: {why}' for why, n in fields.assembler.dropped.items()]
            if n := estimator.unstamped.total():
                parts.append(f'{n} samples without a stamp, the time of their arrival stood in')
        if self._system.bridge:
            parts.append(self._link())
        if (calibration := self._system.calibration) and calibration.configuration.run.mode == 'calibrate':
            parts.append(calibration.result)
        print('done' + ''.join(f'; {part}' for part in parts))

    def _rates(self, now: float) -> str:
        estimator = self._system.estimator
        if not estimator:
            return ''
        # Of magnetometers where there are no IMUs.
        only_fields = estimator.fields if not estimator.configuration.imus.ids else None
        received = dict(only_fields.received if only_fields else estimator.received)
        elapsed = now - self._last
        rates = {
            i: max(0, received.get(i, 0) - self._received.get(i, 0)) / elapsed if elapsed else 0.0
            for i in (received if only_fields else estimator.configuration.imus.ids)
        }
        self._received = received
        return f'Hz {_line(rates, ".0f")}'

    def _tips(self) -> str:
        estimator = self._system.estimator
        if estimator is None or estimator.latest is None:
            return ''
        truth = self._true_tip(int(estimator.latest.stamps_ns[0]), estimator.configuration)
        parts = []
        for name, result in estimator.latest.models.items():
            tip = result.ends[0, -1]
            off = '' if truth is None else f' ({1e3 * np.linalg.norm(tip - truth):.1f} mm off)'
            parts.append(f'{name} tip ' + ' '.join(f'{v:+.3f}' for v in tip) + ' m' + off)
        return ' | '.join(parts)

    def _control(self) -> str:
        """What the tip controller does, and what is left between the target and each tip that is known."""
        node, estimator = self._system.tip_controller, self._system.estimator
        if not node:
            return ''
        controller = node.controller
        text = f'tip controller {controller.state.value}' + (
            f': {controller.reason}' if controller.reason else ''
        )
        if (target := controller.target) is None:
            return f'{text}, no target'
        tips = {}
        if estimator and estimator.latest:
            c = estimator.configuration
            tips['tip'] = estimator.latest.models[c.controller.model].ends[0, -1]
            tips['true tip'] = self._true_tip(int(estimator.latest.stamps_ns[0]), c)
        tips['open loop'] = self._open_loop.tip if self._open_loop else None
        left = [
            f'{k} {1e3 * np.linalg.norm(p - target):.1f} mm off' for k, p in tips.items() if p is not None
        ]
        return ', '.join([text, 'target ' + ' '.join(f'{v:+.3f}' for v in target) + ' m', *left])

    def _follow_open_loop(self, now: float) -> None:
        """Beside a simulated arm another goes that nobody feels, from where the first was when it was set to run."""
        node, plant = self._system.tip_controller, self._system.plant
        reached = node.controller.reached if node else None
        if not (node and plant and reached and node.controller.state in _DRIVES):
            self._open_loop = None
            return
        if self._open_loop is None:
            controller = node.controller
            arm, racks = plant.open_loop_arm()
            order = [controller.options.names.index(name) for name in racks]
            self._open_loop = OpenLoop(arm, controller.reach, order, controller.options.length_rate, now)
        self._open_loop.advance(now, reached.coordinates)

    def _true_tip(self, stamp_ns: int, c: Configuration) -> FloatArray | None:
        """Where the tip was that the plant or the virtual board plays, in the output frame; (3,), m."""
        if self._system.plant:
            return self._system.plant.tip_at(stamp_ns)
        if self._system.field_source:
            return self._system.field_source.tip_at(stamp_ns)
        board = next(iter(self._system.boards), None)
        if board is None or c.run.trial:  # the arm of a trial is no arcs: its truth is in the trial
            return None
        # Stamps are of the wall clock; boards know the steady one. All of them play the same arm.
        at_ns = stamp_ns - (time.time_ns() - steady_ns())
        orientations = board.truth(board.motion_time(at_ns))[: len(c.imus.ids)]
        tip = (
            create_model('pcc_exact', c.layout)
            .fit(Measured(orientations, c.base, c.layout.rest_lengths))
            .positions([c.arm.length])[0]
        )
        return tip if c.arm.output_frame == 'world' else rotate(conjugate(c.base), tip)

    def _link(self) -> str:
        bridge = self._system.bridge
        if not bridge:
            return ''
        counters = [link.session.counters() for link in bridge.links]
        lost, damaged = (
            sum(n) for n in zip(*((c.lost_sweeps, c.frame_errors.total) for c in counters), strict=True)
        )
        silent = [link.settings.port for link in bridge.links if not link.session.connected]
        gone = f', no board on {" and ".join(silent)}' if silent and len(bridge.links) > 1 else ''
        return f'lost {lost} sweeps, {damaged} frames damaged{gone}'

    def _scores(self) -> str:
        bridge = self._system.bridge
        imus = bridge.imus() if bridge else {}
        worst = {i: min(status.scores) for i, status in imus.items() if status.scores}
        return f'calibration {_line(worst, "d")}' if worst else ''


def _line(values: Mapping[int, float], form: str) -> str:
    """A value of each IMU; of more than fit on a line their span, and which are far below the others."""
    if len(values) <= CHANNELS:
        return ' '.join(f'{value:{form}}' for value in values.values())
    least, most = min(values.values()), max(values.values())
    low = ' '.join(str(imu_id) for imu_id, value in values.items() if value < _LOW * most)
    span = f'{least:{form}}' if f'{least:{form}}' == f'{most:{form}}' else f'{least:{form}} to {most:{form}}'
    return f'{span} of {len(values)}' + (f', low: IMU {low}' if low else '')
