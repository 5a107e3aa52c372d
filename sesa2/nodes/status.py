"""One line a second on the terminal: what the system does, and how far it is from the truth where that is known."""

import time
from collections.abc import Sequence

import numpy as np
from rclpy.node import Node

from sesa2.configuration import Configuration
from sesa2.link.virtual.board import VirtualBoard
from sesa2.nodes.estimator import EstimatorNode
from sesa2.nodes.serial_bridge import SerialBridge
from sesa2.shape.models import create_model
from sesa2.shape.rotations import FloatArray, conjugate, rotate

_PERIOD_S = 1.0


class Status:
    """Prints rate of the IMUs, tip of every model, its distance from the truth, lost packets and calibration.

    Parameters
    ----------
    configuration
        of the nodes.
    nodes
        the nodes, asked directly since they are in this process.
    board
        the virtual board, which knows the truth that it plays; None with real ones.
    """

    def __init__(self, configuration: Configuration, nodes: Sequence[Node], board: VirtualBoard | None):
        self._configuration = configuration
        self._estimator = next((n for n in nodes if isinstance(n, EstimatorNode)), None)
        self._bridge = next((n for n in nodes if isinstance(n, SerialBridge)), None)
        self._board = board
        self._truth = create_model('pcc_exact', configuration.geometry)
        self._due = self._last = time.monotonic()
        self._received: dict[int, int] = {}
        self._cpu = time.process_time()

    def show_when_due(self) -> None:
        """Print the line, once a second."""
        now = time.monotonic()
        if now >= self._due:
            self._due = now + _PERIOD_S
            if self._estimator.latest if self._estimator else self._scores():
                parts = [
                    part for part in (self._rates(now), self._tips(), self._link(), self._scores()) if part
                ]
                print(' | '.join(parts))
            self._last = now

    def show_summary(self) -> None:
        """Print what the whole run came to."""
        parts = []
        if self._estimator:
            parts.append(f'{self._estimator.n_sweeps} sweeps estimated')
            parts += [f'{n} samples dropped: {why}' for why, n in self._estimator.assembler.dropped.items()]
        if self._bridge:
            parts.append(self._link())
        print('done: ' + '; '.join(parts))

    def _rates(self, now: float) -> str:
        if not self._estimator:
            return ''
        received = dict(self._estimator.received)
        elapsed = now - self._last
        rates = [
            (received.get(i, 0) - self._received.get(i, 0)) / elapsed if elapsed else 0.0
            for i in self._configuration.imus.ids
        ]
        self._received = received
        return 'Hz ' + ' '.join(f'{rate:.0f}' for rate in rates)

    def _tips(self) -> str:
        estimate = self._estimator.latest if self._estimator else None
        if estimate is None:
            return ''
        truth = self._true_tip(int(estimate.stamps_ns[0]))
        parts = []
        for name, result in estimate.models.items():
            tip = result.ends[0, -1]
            off = '' if truth is None else f' ({1e3 * np.linalg.norm(tip - truth):.1f} mm off)'
            parts.append(f'{name} tip ' + ' '.join(f'{v:+.3f}' for v in tip) + ' m' + off)
        return ' | '.join(parts)

    def _true_tip(self, stamp_ns: int) -> FloatArray | None:
        """Where the tip was that the virtual board plays, in the output frame; (3,), m."""
        if self._board is None:
            return None
        # Stamps are of the wall clock; the board knows the monotonic one.
        monotonic_ns = stamp_ns - (time.time_ns() - time.monotonic_ns())
        orientations = self._board.truth(self._board.motion_time(monotonic_ns))
        c = self._configuration
        tip = self._truth.fit(orientations, c.base).positions([c.arm.length])[0]
        return tip if c.frame_id == 'world' else rotate(conjugate(c.base), tip)

    def _link(self) -> str:
        if not self._bridge:
            return ''
        counters = self._bridge.session.counters()
        return f'lost {counters.lost_sweeps} sweeps, {counters.frame_errors.total} frames damaged'

    def _scores(self) -> str:
        if not self._bridge:
            return ''
        imus = self._bridge.session.imus()
        worst = [min(status.scores) for status in imus.values()]
        return 'calibration ' + ' '.join(map(str, worst)) if worst else ''
