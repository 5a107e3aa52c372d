"""What a session makes of the packets that stream in: stamps, losses, silences, and chips that go and come back."""

import time

from sesa2.link.clock import BoardClock, WallClock
from sesa2.link.packets import Acceleration, Data, MagneticFields, Packet, RawData, State
from sesa2.link.status import Counters, Event, Handler, Level
from sesa2.sensing.imu.addresses import mask_of
from sesa2.time import NS

_SILENCE_S = 0.25
_SILENT_SWEEPS = 10


class Intake:
    """Takes the packets of one session, over all its connections.

    Parameters
    ----------
    ids
        IMUs that were asked for, all of one board.
    baud
        Of the line: what a packet takes on it is no part of its delay.
    rate_hz
        Sweeps per second that were asked for.
    handler
        Whom to hand sweeps and events.
    counters
        Where to count.

    Attributes
    ----------
    latest
        The latest orientations, or what the raw sensors measured.
    absent
        Chips that did not answer and do not run yet.
    returned
        Chips that were absent and run again, until the session has looked after them.
    """

    def __init__(
        self, ids: tuple[int, ...], baud: int, rate_hz: int, handler: Handler, counters: Counters
    ) -> None:
        self.clock = BoardClock()
        self.wall = WallClock()
        self.latest: Data | RawData | None = None
        self.returned: set[int] = set()
        self._mask = mask_of(ids)
        self._byte_ns = 10 * NS // baud
        self._patience_s = max(_SILENCE_S, _SILENT_SWEEPS / rate_hz)
        self._handler = handler
        self._counters = counters
        self._latest_s: float | None = None
        self.begin()
        self.end()

    def begin(self) -> None:
        """Expect the stream of a board that was just set up: its clock and its count begin somewhere."""
        self.clock.restart()
        self.returned = set()
        self.absent: set[int] = set()
        self._health = b''
        self._seq: int | None = None
        self._stamped_seq: int | None = None
        self._stamp_ns = 0
        self._heard_s = time.monotonic()
        self._wanted = True

    def end(self) -> None:
        """Expect nothing: what comes now was not asked for."""
        self._wanted = False

    def is_silent(self) -> bool:
        """Whether nothing has come for much longer than a sweep takes."""
        return time.monotonic() - self._heard_s > self._patience_s

    def take(self, packet: Packet, arrival_ns: int) -> None:
        """Stamp a packet that has arrived, and hand it on."""
        sweep = packet.sweep
        if not self._wanted or sweep.mask != self._mask:
            self._counters.stray_packets += 1
            return
        if sweep.seq != self._stamped_seq:  # the packets of a sweep share their stamp
            sent_ns = arrival_ns - packet.line_bytes * self._byte_ns
            jumps = self.clock.jumps
            self._stamp_ns = self.clock.stamp(sweep.t_us, sent_ns - 1000 * sweep.scan_us)
            if self.clock.jumps > jumps:
                text = 'the clock of the board or of this computer was stepped; stamps follow it'
                self._handler.on_event(Event(Level.WARN, text))
            self._stamped_seq = sweep.seq
        start_ns = self.wall.of(self._stamp_ns)
        stamps_ns = [start_ns + read_ns for read_ns in sweep.read_ns()]
        if isinstance(packet, Acceleration):
            self._handler.on_acceleration(packet, stamps_ns)
        elif isinstance(packet, MagneticFields):
            self._handler.on_magnetic_fields(packet, stamps_ns)
        else:
            self._count(packet)
            self._handler.on_data(packet, stamps_ns)

    def _count(self, data: Data | RawData) -> None:
        now_s = time.monotonic()
        if self._latest_s is not None and now_s - self._latest_s > self._patience_s:
            self._counters.silent_s += now_s - self._latest_s
        if self._seq is not None:
            self._counters.lost_sweeps += (data.sweep.seq - self._seq - 1) % (1 << 16)
        self._counters.sweeps += 1
        self._latest_s = self._heard_s = now_s
        self.latest, self._seq = data, data.sweep.seq
        if data.health != self._health:
            self._health = data.health
            self._watch(data)

    def _watch(self, data: Data | RawData) -> None:
        for imu_id, state in zip(data.sweep.ids, data.states, strict=True):
            if state is State.ABSENT and imu_id not in self.absent:
                self.absent.add(imu_id)
                self._handler.on_event(Event(Level.WARN, f'IMU {imu_id} does not answer'))
            elif state is State.RUN and imu_id in self.absent:
                self.absent.remove(imu_id)
                self.returned.add(imu_id)
