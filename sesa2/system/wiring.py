"""The nodes that a configuration asks for, wired in one process."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from rclpy.parameter import Parameter

from sesa2.bags.reading import ImuRecording
from sesa2.bags.recording import open_recording
from sesa2.configuration import Configuration, ConfigurationError, Mistake
from sesa2.errors import Sesa2Error
from sesa2.faults import fault_line
from sesa2.link.virtual.virtual_board import VirtualBoard
from sesa2.nodes.calibration import CalibrationNode
from sesa2.nodes.estimator import EstimatorNode
from sesa2.nodes.field_source import FieldSource
from sesa2.nodes.plant import PlantNode
from sesa2.nodes.player import Player
from sesa2.nodes.recorder import Recorder
from sesa2.nodes.serial_bridge import SerialBridge
from sesa2.nodes.tip_controller import TipControllerNode
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.hand_over import HandOver
from sesa2.ros.parameters import ORIGIN, overrides
from sesa2.ros.spinning import Spinner
from sesa2.system.claims import Claims
from sesa2.system.virtual_source import make_virtual_boards

_Node = TypeVar('_Node', bound=ConfinedNode)

# Without these the others go on: only what they keep is lost.
_EXPENDABLE = (Recorder, CalibrationNode)

# A Mega's boot loader takes up to 3 s before the firmware answers.
_BOARD_PATIENCE_S = 5.0


class System:
    """The nodes of a configuration, started and stopped together.

    Parameters
    ----------
    spinner
        runs the nodes.
    namespace
        of all of them.
    origin
        the file that the configuration came from; None where there is none.
    with_page
        whether they are steered from a page.

    Attributes
    ----------
    nodes
        those that run now.
    boards
        the virtual boards, where the source is `sim` and no plant has them.
    configuration
        of what runs, or ran last; None before the first start.
    lost
        what became of nodes that ended before the others, or could not end well; of all starts.
    """

    def __init__(
        self,
        spinner: Spinner,
        namespace: str = '',
        origin: Path | None = None,
        with_page: bool = False,
    ):
        self._spinner = spinner
        self.namespace = namespace
        self._origin = origin
        self._claims = Claims(namespace, with_page)
        self._options: dict[str, Any] = {}
        self.nodes: list[ConfinedNode] = []
        self.boards: list[VirtualBoard] = []
        self.configuration: Configuration | None = None
        self.lost: list[Sesa2Error] = []

    @property
    def failure(self) -> Sesa2Error | None:
        """Why a node cannot go on that the others need; None while all can."""
        return next((node.failure for node in self._needed if node.failure), None)

    @property
    def finished(self) -> bool:
        """Whether a node that the others need has come to its end: a bag was played, a link cannot be made."""
        return any(node.finished for node in self._needed)

    @property
    def _needed(self) -> list[ConfinedNode]:
        return [node for node in self.nodes if not isinstance(node, _EXPENDABLE)]

    def end_failed(self) -> None:
        """End the nodes that have failed and that the others do not need; why is in `lost` then."""
        for node in [node for node in self.nodes if isinstance(node, _EXPENDABLE) and node.failure]:
            self.nodes.remove(node)
            self._end(node)

    def check_claims(self, configuration: Configuration | None = None) -> None:
        """Look whether somebody else publishes what this configuration would, or, where it is None, what runs does.

        Raises
        ------
        ClaimError
            somebody does, and it is this run that has to end.
        """
        if configuration:
            self._claims.check(configuration)
        else:
            self._claims.check_again(self.configuration if self.nodes else None)

    def start(self, configuration: Configuration) -> None:
        """Start the nodes that a configuration asks for.

        Raises
        ------
        Sesa2Error
            one cannot start; then none runs.
        """
        self.configuration = configuration
        self.check_claims(configuration)
        served = configuration
        try:
            if configuration.run.source == 'bag':
                # Seen before the recorder makes a bag that nothing would go into.
                with open_recording(configuration.run.bag) as recording:
                    ImuRecording(recording, configuration).check_lengths()
            given = overrides(configuration)
            if self._origin:
                given.append(Parameter(ORIGIN, value=str(self._origin)))
            self._options = {
                'parameter_overrides': given,
                'namespace': self.namespace,
                'use_global_arguments': False,
            }
            if configuration.run.source == 'sim' and configuration.imus.all_ids:
                boards = self._simulate(configuration)
                serial = configuration.serial.on([board.path for board in boards])
                served = replace(configuration, serial=serial)
            hand_over = HandOver() if configuration.run.source in ('sim', 'serial') else None
            for make in _wanted(configuration):
                own: dict[str, Any] = {}
                if make in (EstimatorNode, SerialBridge):
                    own['hand_over'] = hand_over
                if make is SerialBridge:
                    # The ports of virtual boards are of no use to anybody else, nor in a file that is saved.
                    own['parameter_overrides'] = overrides(served)
                self._keep(make(**{**self._options, **own}))
        except Sesa2Error:
            self.stop()
            raise

    def _simulate(self, configuration: Configuration) -> list[VirtualBoard]:
        """Virtual boards, on an arm that racks drive where the configuration has one."""
        if configuration.models_of('fields'):
            raise Sesa2Error('run.source: sim plays an arm with IMUs or one with magnets, got one with both')
        if not configuration.has_plant:
            self.boards = make_virtual_boards(configuration)
            return self.boards
        plant = PlantNode(**self._options)
        self._keep(plant)
        return plant.boards

    def wait_until_it_runs(self) -> None:
        """Wait until the board streams or the recording plays, where there is one, or it is known that it will not.

        Raises
        ------
        Sesa2Error
            it will not; then nothing runs.
        """
        bridge, player, deadline = self.bridge, self._running(Player), time.monotonic() + _BOARD_PATIENCE_S
        while time.monotonic() < deadline and (
            (bridge and not (bridge.connected or bridge.finished))
            or (player and not (player.n_played or player.finished or player.failure))
        ):
            time.sleep(0.02)
        if failure := self.failure:
            self.stop()
            raise failure

    def stop(self) -> None:
        """End all nodes, the last started first."""
        while self.nodes:
            self._end(self.nodes.pop())
        while self.boards:
            self.boards.pop().close()
        self._claims.release()

    def end(self) -> None:
        """End all nodes for good."""
        self.stop()
        self._claims.close()

    def _end(self, node: ConfinedNode) -> None:
        """End a node, whatever it says to that."""
        name = node.get_name()
        if isinstance(node, _EXPENDABLE) and node.failure:
            self.lost.append(node.failure)
        try:
            self._spinner.remove(node)
        except Sesa2Error as error:
            self.lost.append(error)
        except Exception as error:
            self.lost.append(Sesa2Error(f'{name}: {fault_line(error)}'))

    def record(self, file: str) -> Path:
        """Start recording into a new bag; its path.

        Raises
        ------
        Sesa2Error
            it cannot be written, nothing runs, or a recording is going on.
        """
        if self.recorder:
            raise Sesa2Error(f'recording into {self.recorder.path} already')
        if not self.nodes:
            raise Sesa2Error('nothing runs that could be recorded')
        if not file:
            raise ConfigurationError([Mistake('record.file', 'is empty, expected a bag to write')])
        given = [p for p in self._options['parameter_overrides'] if p.name != 'record.file']
        recorder = Recorder(
            **{**self._options, 'parameter_overrides': [*given, Parameter('record.file', value=file)]}
        )
        self._keep(recorder)
        return recorder.path

    def stop_recording(self) -> Path:
        """Make the bag whole; its path.

        Raises
        ------
        Sesa2Error
            nothing is being recorded.
        """
        recorder = self.recorder
        if recorder is None:
            raise Sesa2Error('nothing is being recorded')
        self.nodes.remove(recorder)
        self._spinner.remove(recorder)
        return recorder.path

    @property
    def unheard(self) -> str:
        """Why nothing was estimated from what others publish: no sensor was ever heard; empty where one was."""
        estimator = self.estimator
        heard = estimator and (estimator.received or (estimator.fields and estimator.fields.received))
        if not estimator or heard or estimator.configuration.run.source != 'external':
            return ''
        return estimator.unheard

    @property
    def estimator(self) -> EstimatorNode | None:
        """The estimator, where one runs."""
        return self._running(EstimatorNode)

    @property
    def bridge(self) -> SerialBridge | None:
        """The serial bridge, where one runs."""
        return self._running(SerialBridge)

    @property
    def field_source(self) -> FieldSource | None:
        """The simulated arm with magnets, where one runs."""
        return self._running(FieldSource)

    @property
    def plant(self) -> PlantNode | None:
        """The simulated arm that racks drive, where one runs."""
        return self._running(PlantNode)

    @property
    def tip_controller(self) -> TipControllerNode | None:
        """The tip controller, where one runs."""
        return self._running(TipControllerNode)

    @property
    def calibration(self) -> CalibrationNode | None:
        """The calibration node, where one runs."""
        return self._running(CalibrationNode)

    @property
    def recorder(self) -> Recorder | None:
        """The recorder, where one runs."""
        return self._running(Recorder)

    def _running(self, kind: type[_Node]) -> _Node | None:
        return next((node for node in self.nodes if isinstance(node, kind)), None)

    def _keep(self, node: ConfinedNode) -> None:
        self.nodes.append(node)
        self._spinner.add(node)


def _wanted(c: Configuration) -> list[Callable[..., ConfinedNode]]:
    """Listeners first, so that nothing which is said is missed."""
    wanted: list[Callable[..., ConfinedNode]] = []
    if c.run.mode == 'stream':
        if c.record.file:
            wanted.append(Recorder)
        if c.has_controller:
            wanted.append(TipControllerNode)
        wanted.append(EstimatorNode)
    if c.run.source == 'bag':
        wanted.append(Player)
    if c.has_field_source:
        wanted.append(FieldSource)
    if c.run.source in ('sim', 'serial') and c.imus.all_ids:
        if c.calibration.file:
            wanted.append(CalibrationNode)
        wanted.append(SerialBridge)
    return wanted
