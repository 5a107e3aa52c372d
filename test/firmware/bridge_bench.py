"""The serial bridge on a simulated board: real node, ROS graph, link, pseudo-terminal and firmware, in simulated time.

Time moves only while the link waits for bytes, and only as far as the test allows. So a fault strikes at a known time,
and what follows does not depend on the machine.
"""

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from graph_fixtures import PATIENCE_S, Graph, Line
from rclpy.qos import QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import Imu
from simulated_board import SimulatedBoard

from sesa2.configuration import validate
from sesa2.link import board_client as link_board
from sesa2.link import clock as link_clock
from sesa2.link import intake as link_intake
from sesa2.link import session as link_session
from sesa2.link.framing import FrameDecoder
from sesa2.link.packets import Data, State, decode_stream
from sesa2.link.requests import Command, Reply, decode_reply, is_reply
from sesa2.link.serial_port import SerialPort
from sesa2.link.status import OffsetsState
from sesa2.nodes.serial_bridge import SerialBridge
from sesa2.ros.parameters import overrides
from sesa2.sensing.imu.bno055.offsets import Offsets, save_offsets

IDS = range(1, 9)
SAVED = {i: Offsets((i, -2, 3), (-400, 500 + i, -600), (1, -1, i), 1000, 480 + i) for i in IDS}
QUATERNIONS = {i: (8192, -8192 + i, 8192 + i, 8192 - i) for i in IDS}
"""What the chips show, raw, w x y z: told apart by their last digits."""

_OFFSETS_REGISTER = 0x55
_CHIPS_BOOTED_US = 660_000
_STEP_US = 1000
_SLICE_S = 0.01
# Holds what comes while nobody listens, since time stands still for the test and not for the machine.
_EVERYTHING = QoSProfile(depth=10_000)
# Logs are latched: what was said before the two knew each other is heard too.
_EPOCH_NS = 1_700_000_000 * 10**9


class Clock:
    """The simulated time in place of the module `time`, with a wall clock that never steps."""

    def __init__(self, timeline: 'Timeline') -> None:
        self._timeline = timeline

    def monotonic(self) -> float:
        """Simulated time, s."""
        return self._timeline.now_s

    def monotonic_ns(self) -> int:
        """Simulated time, ns."""
        return self._timeline.simulated.now_us * 1000

    def time_ns(self) -> int:
        """Simulated time since 1970, ns."""
        return _EPOCH_NS + self.monotonic_ns()


class Timeline:
    """Simulated time: moved by the link's thread, which waits for bytes, as far as the test has allowed.

    Attributes
    ----------
    heard
        every packet that the board has sent to an open port, and when, s: what the link is measured by.
    damage
        what becomes of the bytes from the board on their way.
    noise
        what becomes of the bytes to the board.
    """

    def __init__(self, simulated: SimulatedBoard) -> None:
        self.simulated = simulated
        self.heard: list[tuple[float, Data | Reply]] = []
        self.damage: Callable[[bytes], bytes] = lambda portion: portion
        self.noise: Callable[[bytes], bytes] = lambda frame: frame
        self._changed = threading.Condition()
        self._allowed_us = 0
        self._waiting = False
        self._written = self._taken = 0
        self._decoder = FrameDecoder()

    @property
    def now_s(self) -> float:
        """Simulated time."""
        return self.simulated.now_us * 1e-6

    def plug_in(self, simulated: SimulatedBoard) -> None:
        """Another board, whose time has gone on as far as that of the one before."""
        with self._changed:
            self.simulated = simulated
            self._written = self._taken = 0

    def rests(self) -> bool:
        """Whether the link has dealt with all that has come, and waits for more time; asked after a little while."""
        with self._changed:
            return self._changed.wait_for(self._resting, 0.005)

    def _resting(self) -> bool:
        return self._waiting and self.simulated.now_us >= self._allowed_us

    def allow(self, seconds: float) -> None:
        """Let the link's waiting take that much time."""
        with self._changed:
            self._allowed_us = self.simulated.now_us + round(seconds * 1e6)
            self._changed.notify_all()

    def skip(self, seconds: float) -> None:
        """Let time pass while the link has no port."""
        with self._changed:
            assert not self._waiting
            self.simulated.now_us = int(self.simulated.command('run', round(seconds * 1e6)).split()[0])
            self._allowed_us = self.simulated.now_us

    # ---- called by the port ----
    def opened(self) -> int:
        """How much the board has sent so far: nobody will ever read it."""
        with self._changed:
            self._written = self._taken
            self._decoder.resynchronise()
            return int(self.simulated.command('time').split()[1])

    def wrote(self, count: int) -> None:
        """The board is to have these bytes before time goes on."""
        self._written += count

    def step(self, end_us: float, hopeless: Callable[[], bool]) -> int | None:
        """Let a millisecond pass; how much the board has sent so far, or None if waiting ends without that."""
        with self._changed:
            while self.simulated.now_us < end_us and not hopeless():
                if self.simulated.now_us < self._allowed_us:
                    now, sent = map(int, self.simulated.command('run', _STEP_US, self._written).split())
                    self._taken, self.simulated.now_us = self._written, now
                    return sent
                self._waiting = True
                self._changed.notify_all()
                self._changed.wait(0.05)
                self._waiting = False
        return None

    def note(self, portion: bytes) -> None:
        """These are the board's own words."""
        for body in self._decoder.feed(portion):
            packet = decode_reply(body) if is_reply(body) else decode_stream(body)
            self.heard.append((self.now_s, packet))


class TimedPort(SerialPort):
    """The real port, which lets simulated time pass while it waits."""

    def __init__(self, timeline: Timeline, path: str, baud: int) -> None:
        super().__init__(path, baud)
        self._timeline = timeline
        self._received = timeline.opened()

    def write(self, frame: bytes) -> None:
        """Send, with what the test does to it on its way."""
        frame = self._timeline.noise(frame)
        super().write(frame)
        self._timeline.wrote(len(frame))

    def read(self, timeout_s: float) -> bytes:
        """What arrives first within a simulated time."""
        end_us = self._timeline.simulated.now_us + timeout_s * 1e6
        while (sent := self._timeline.step(end_us, self._hopeless)) is not None:
            portion = b''
            while self._received + len(portion) < sent:
                arrived = super().read(PATIENCE_S)
                assert arrived, 'the pseudo-terminal has lost bytes'
                portion += arrived
            if portion:
                self._received += len(portion)
                self._timeline.note(portion)
                return self._timeline.damage(portion)
        return super().read(0.0)

    def _hopeless(self) -> bool:
        """Cancelled, or the cable is out: else there is nothing to read between two steps."""
        return self._cancelled or bool(self._poll.poll(0))


class Part(NamedTuple):
    """What /diagnostics says of one thing."""

    level: bytes
    text: str
    values: dict[str, str]


class Report(NamedTuple):
    """What /diagnostics said at one time."""

    parts: dict[str, Part]
    stamp_ns: int


class BridgeBench:
    """A bridge on a simulated board, and a listener to all that it publishes.

    Attributes
    ----------
    simulated
        the board that is on the link's port.
    imus
        messages of each IMU, by id.
    reports
        what the bridge has said on /diagnostics.
    logs
        what the bridge has logged.
    """

    def __init__(self, simulated: SimulatedBoard, graph: Graph, folder: Path, patch: Callable) -> None:
        self.timeline = Timeline(simulated)
        self.graph = graph
        self.bridge: SerialBridge
        self.reports: list[Report] = []
        self.logs: list[Line] = []
        self.imus: dict[int, list[Imu]] = {}
        self.port = folder / 'port'
        self.offsets = folder / 'offsets.yaml'
        for imu_id, offsets in SAVED.items():
            save_offsets(self.offsets, imu_id, offsets)
        clock = Clock(self.timeline)
        for module in (link_board, link_clock, link_intake, link_session):
            patch(module, 'time', clock)
        patch(link_session, 'SerialPort', partial(TimedPort, self.timeline))
        # Where nothing is published, the graph looks at a condition only when something else wakes it.
        self.graph.probe.create_timer(0.002, lambda: None)
        self.put_on_port(simulated)

    @property
    def simulated(self) -> SimulatedBoard:
        """The board that is on the port."""
        return self.timeline.simulated

    def put_on_port(self, simulated: SimulatedBoard) -> None:
        """Plug in a board, whose time goes on from that of the one before."""
        simulated.now_us = int(simulated.command('run', self.simulated.now_us or _CHIPS_BOOTED_US).split()[0])
        for imu_id, wxyz in QUATERNIONS.items():
            simulated.set_quaternion(imu_id - 1, wxyz)
        self.port.unlink(missing_ok=True)
        self.port.symlink_to(simulated.port_path)
        self.timeline.plug_in(simulated)

    def start(self, *, streaming: bool = True, **serial: object) -> SerialBridge:
        """Start the bridge; by default, until all chips run with their offsets and have been checked."""
        values = {
            'arm': {'length': 0.66},
            'imus': {'ids': list(IDS), 'positions': [0.08 * i for i in IDS]},
            'serial': {'port': str(self.port), **serial},
            'calibration': {'file': str(self.offsets)},
        }
        self.graph.probe.create_subscription(DiagnosticArray, '/diagnostics', self._take_report, 10)
        self.logs = self.graph.listen_to_logs()
        self.bridge = self.graph.add(SerialBridge(parameter_overrides=overrides(validate(values))))
        self.imus = {i: self.graph.listen(Imu, f'imu_{i}/data', _EVERYTHING) for i in IDS}
        if streaming:
            self.until(self.settled, 'a link that is set up')
            self.run(0.1)
        return self.bridge

    def _take_report(self, message: DiagnosticArray) -> None:
        prefix = 'serial_bridge: '
        report = {
            status.name.removeprefix(prefix): Part(
                status.level, status.message, {value.key: value.value for value in status.values}
            )
            for status in message.status
        }
        self.reports.append(Report(report, Time.from_msg(message.header.stamp).nanoseconds))

    def settled(self) -> bool:
        """Whether all IMUs run, with offsets that were read and compared."""
        imus = self.bridge.links[0].session.imus().values()
        return self.bridge.links[0].session.connected and [(imu.state, imu.offsets) for imu in imus] == [
            (State.RUN, OffsetsState.AS_SAVED) for _ in IDS
        ]

    # ---- time ----
    def run(self, seconds: float) -> None:
        """Let that much simulated time pass on the link."""
        self.timeline.allow(seconds)
        self.graph.until(self.timeline.rests, f'{seconds} s of simulated time')

    def until(self, condition: Callable[[], object], what: str, patience_s: float = 5.0) -> None:
        """Let simulated time pass until something is so."""
        end_s = self.timeline.now_s + patience_s

        def met() -> bool:
            if condition():
                return True
            if self.timeline.rests():
                assert self.timeline.now_s < end_s, f'not within {patience_s} s of simulated time: {what}'
                self.timeline.allow(_SLICE_S)
            return False

        self.graph.until(met, what)
        self.graph.until(lambda: self.timeline.rests() or self.bridge.finished, 'the link at rest')

    def report(self) -> dict[str, Part]:
        """What /diagnostics says now, while simulated time stands still."""
        now_ns = self.bridge.get_clock().now().nanoseconds
        self.bridge._diagnostics[0].publish()
        self.graph.until(lambda: self.reports and self.reports[-1].stamp_ns >= now_ns, 'diagnostics')
        return self.reports[-1].parts

    # ---- what was on the line ----
    def data(self, since_s: float = 0.0) -> list[tuple[float, Data]]:
        """Sweeps that the link had asked for and the board has sent since a time, and when."""
        asked, found = False, []
        for at_s, packet in self.timeline.heard:
            if isinstance(packet, Reply):
                # What a board streams before it is set up again is a leftover of an earlier connection.
                asked = packet.command is not Command.HELLO and (asked or packet.command is Command.CONFIGURE)
            elif asked and at_s >= since_s:
                found.append((at_s, packet))
        return found

    def replies(self, command: Command, since_s: float = 0.0) -> list[tuple[float, Reply]]:
        """Replies to one command since a time, and when."""
        return [
            (at_s, p)
            for at_s, p in self.timeline.heard
            if isinstance(p, Reply) and p.command is command and at_s >= since_s
        ]

    def assert_all_published(self) -> None:
        """Every orientation that the board has sent, and nothing else, came out of the bridge, in order."""
        sent: dict[int, list[tuple[int, ...]]] = {i: [] for i in IDS}
        for _, data in self.data():
            for imu_id, state, q in zip(data.sweep.ids, data.states, data.orientations, strict=True):
                if state is State.RUN and q.any():
                    x, y, z, w = (int(value * 16384) for value in q)
                    sent[imu_id].append((w, x, y, z))
        self.graph.until(lambda: all(len(self.imus[i]) >= len(sent[i]) for i in IDS), 'all orientations')
        assert {i: [raw(message) for message in self.imus[i]] for i in IDS} == sent

    def assert_offsets_on_chips(self) -> None:
        """As saved, in the registers themselves."""
        for imu_id, offsets in SAVED.items():
            assert self.simulated.registers(imu_id - 1, _OFFSETS_REGISTER, 22) == offsets.to_registers()


def raw(message: Imu) -> tuple[int, int, int, int]:
    """The quaternion of a message as the chip has it, w x y z."""
    q = message.orientation
    return tuple(int(value * 16384) for value in (q.w, q.x, q.y, q.z))
