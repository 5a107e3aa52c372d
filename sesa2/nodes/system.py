"""The nodes that a configuration asks for, wired in one process: what `sesa2 run` and `sesa2 board` do."""

import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from rclpy.node import Node

from sesa2.configuration import Configuration
from sesa2.link.virtual.arm import Arm
from sesa2.link.virtual.board import VirtualBoard
from sesa2.link.virtual.motion import ArmMotion
from sesa2.nodes.calibration import CalibrationNode
from sesa2.nodes.estimator import EstimatorNode
from sesa2.nodes.parameters import overrides
from sesa2.nodes.player import Player
from sesa2.nodes.recorder import Recorder
from sesa2.nodes.runtime import ros, spin, stop_on_signals
from sesa2.nodes.serial_bridge import SerialBridge
from sesa2.nodes.status import Status


def run(configuration: Configuration, duration: float | None = None) -> int:
    """Run until Ctrl-C, SIGTERM, the end of the bag or the given time.

    Parameters
    ----------
    configuration
        says by its source, mode and files which nodes are wanted.
    duration
        s; None: no end.

    Returns
    -------
    Exit code 0.

    Raises
    ------
    Sesa2Error
        a node cannot start, or cannot go on.
    """
    ends = time.monotonic() + duration if duration else float('inf')
    with stop_on_signals() as stop, ExitStack() as stack:
        board = None
        if configuration.run.source == 'sim':
            board = stack.enter_context(make_virtual_board(configuration))
            configuration = replace(configuration, serial=replace(configuration.serial, port=board.path))
        stack.enter_context(ros([]))
        nodes = _nodes(configuration)
        status = Status(configuration, nodes, board)

        def ended() -> bool:
            status.show_when_due()
            return (
                stop.is_set() or time.monotonic() > ends or any(getattr(n, 'finished', False) for n in nodes)
            )

        spin(nodes, ended)
        for node in nodes:
            if failure := getattr(node, 'failure', None):
                raise failure
        status.show_summary()
    return 0


def _nodes(c: Configuration) -> list[Node]:
    """Listeners first, so that nothing which is said is missed."""
    options = {'parameter_overrides': overrides(c), 'use_global_arguments': False}
    nodes: list[Node] = []
    if c.run.mode == 'stream':
        if c.record.file:
            nodes.append(Recorder(**options))
        nodes.append(EstimatorNode(**options))
    if c.run.source == 'bag':
        nodes.append(Player(**options))
    if c.run.source in ('sim', 'serial'):
        if c.calibration.file:
            nodes.append(CalibrationNode(**options))
        nodes.append(SerialBridge(**options))
    return nodes


def make_virtual_board(c: Configuration, link: Path | None = None) -> VirtualBoard:
    """A virtual board with the configuration's IMUs, on a plausible arm that moves.

    Parameters
    ----------
    c
        its IMUs, mountings and headings; what the estimator corrects is what the board plays.
    link
        name to give the pseudo-terminal.
    """
    motion = ArmMotion(c.imus.positions, c.base)
    arm = Arm(c.imus.ids, motion, mount_orientations=c.mountings, headings=c.headings)
    return VirtualBoard(arm, link=link)


def virtual_board(configuration: Configuration, link: Path | None) -> int:
    """`sesa2 board`: a virtual board, until Ctrl-C or SIGTERM."""
    with stop_on_signals() as stop, make_virtual_board(configuration, link) as board:
        print(f'virtual board on {board.path}; in another terminal:')
        print(f'  sesa2 run --config … --source serial --port {board.path}')
        stop.wait()
    return 0
