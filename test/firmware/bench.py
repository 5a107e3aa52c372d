"""A simulated board with the link's own client on it, in simulated time, and what is to be seen in the packets."""

from collections.abc import Callable, Iterable

from simulated_board import Reading, SimulatedBoard, pattern, tick_at

from sesa2.link.board_client import Board
from sesa2.link.packets import Acceleration, Data, Packet, RawData, State
from sesa2.link.requests import BoardConfiguration, FusionMode, Hello, Stream

CHIP_BOOT_S = 0.65
CLOCK_SLACK_US = (
    1500  # the board's clock starts a little after power-on; a chip is read within its slot of a sweep
)


class Bench:
    """A simulated board and the link's client, both in simulated time; the packets that came, in order."""

    def __init__(self, simulated: SimulatedBoard) -> None:
        self.simulated = simulated
        self.packets: list[Packet] = []
        self.client = Board(simulated.port(), lambda packet, _: self.packets.append(packet))

    def boot(self) -> Hello:
        """Wait until the chips have booted."""
        self.simulated.run(CHIP_BOOT_S + 0.01)
        return self.client.hello()

    def start(
        self,
        mask: int = 0xFF,
        rate_hz: int = 100,
        mode: FusionMode = FusionMode.NDOF,
        i2c_100khz: int = 0,
        flags: int = Stream.QUATERNIONS,
    ) -> None:
        """Configure and stream, and wait until every chip of the mask that is there runs."""
        present = self.client.hello().channels
        self.client.configure(BoardConfiguration(mask, rate_hz, mode, i2c_100khz))
        self.client.stream(flags)
        if flags & Stream.QUATERNIONS:
            self.until(
                lambda data: all(data.state_of(k) is State.RUN for k in range(8) if (present & mask) >> k & 1)
            )
            self.packets.clear()

    def watch(self, seconds: float) -> 'list[Watched]':
        """The DATA packets of the next time."""
        self.packets.clear()
        self.wait(seconds)
        return self.data()

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        end_us = self.simulated.now_us + seconds * 1e6
        while self.simulated.now_us < end_us:
            self.client.poll((end_us - self.simulated.now_us) * 1e-6)

    def data(self) -> 'list[Watched]':
        """The DATA packets so far."""
        return [Watched(packet) for packet in self.packets if isinstance(packet, Data)]

    def raw(self) -> list[RawData]:
        """The RAW packets so far."""
        return [packet for packet in self.packets if isinstance(packet, RawData)]

    def accelerations(self) -> list[Acceleration]:
        """The ACCELERATION packets so far."""
        return [packet for packet in self.packets if isinstance(packet, Acceleration)]

    def until(self, condition: 'Callable[[Watched], bool]', patience_s: float = 2.0) -> float:
        """Wait for a DATA packet that meets a condition; how long that took, s."""
        start_us = self.simulated.now_us
        self.packets.clear()
        while not any(condition(data) for data in self.data()):
            assert self.simulated.now_us < start_us + patience_s * 1e6, f'not within {patience_s} s'
            self.client.poll(0.01)
        return (self.simulated.now_us - start_us) * 1e-6


class Watched:
    """A DATA packet, asked by channel and in raw numbers."""

    def __init__(self, packet: Data) -> None:
        self.sweep = packet.sweep
        self._packet = packet
        self._row = {imu_id - 1: row for row, imu_id in enumerate(packet.sweep.ids)}

    def state_of(self, channel: int) -> State:
        """State of a channel."""
        return self._packet.states[self._row[channel]]

    def errors_of(self, channel: int) -> int:
        """Errors of a channel."""
        return self._packet.errors[self._row[channel]]

    def calibration_of(self, channel: int) -> int:
        """Register 0x35 of a channel."""
        return self._packet.calib[self._row[channel]]

    def quaternion_of(self, channel: int) -> tuple[int, ...]:
        """Quaternion w x y z, raw."""
        x, y, z, w = (round(value * 16384) for value in self._packet.orientations[self._row[channel]])
        return w, x, y, z

    def read_us(self, channel: int) -> float:
        """When the channel was read, by the board's clock."""
        return self.sweep.t_us + self.sweep.read_ns()[self._row[channel]] / 1000


def assert_quaternions_right(data: Iterable[Watched], channels: Iterable[int] = range(8)) -> None:
    """Each is what its chip showed when it was read."""
    for packet in data:
        for channel in channels:
            read_us = packet.read_us(channel)
            ticks = {tick_at(channel, read_us + slack) for slack in (-CLOCK_SLACK_US, 0, CLOCK_SLACK_US)}
            assert packet.quaternion_of(channel) in {pattern(Reading(channel, tick)) for tick in ticks}, (
                f'IMU {channel + 1}, sweep {packet.sweep.seq}'
            )


def assert_no_gap(data: list[Watched]) -> None:
    """The sequence numbers of the packets leave none out."""
    first = data[0].sweep.seq
    assert [packet.sweep.seq for packet in data] == [(first + i) % 65536 for i in range(len(data))]
