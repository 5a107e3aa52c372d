"""What a session tells its owner: events, counts, and how each IMU is."""

from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import NamedTuple, Protocol

from sesa2.link.framing import FrameErrors
from sesa2.link.packets import Acceleration, Data, MagneticFields, RawData, State
from sesa2.sensing.imu.bno055.offsets import Offsets
from sesa2.sensing.imu.bno055.scores import Scores


class Level(IntEnum):
    """How serious an event is."""

    INFO = 0
    WARN = 1
    ERROR = 2


class Event(NamedTuple):
    """Something that the user is to be told, once."""

    level: Level
    message: str


class OffsetsState(Enum):
    """Whether a chip works with the offsets that were saved for it."""

    NONE_SAVED = 'none saved'
    NOT_CHECKED = 'given to the board, not read back yet'
    AS_SAVED = 'as saved'
    DIFFERENT = 'different from those saved'


class ImuStatus(NamedTuple):
    """One IMU in the latest sweep."""

    state: State
    errors: int
    """I2C errors since it last ran, saturating at 15."""
    scores: Scores | None
    """None without fusion."""
    offsets: OffsetsState


@dataclass
class Counters:
    """What happened since the session was made."""

    sweeps: int = 0
    lost_sweeps: int = 0
    """Gaps in the sequence numbers while connected."""
    silent_s: float = 0.0
    """Time without sweeps: while disconnected, while the board started, while it said nothing."""
    frame_errors: FrameErrors = field(default_factory=FrameErrors)
    """Frames dropped by the decoder."""
    malformed: int = 0
    """Intact frames that were no packet of the protocol."""
    stray_frames: int = 0
    """Frames dropped before HELLO was answered: what a boot loader says, or a packet cut by opening the port."""
    stray_packets: int = 0
    """Stream packets that this session had not asked for."""
    retries: int = 0
    """Commands sent again because no reply came."""
    reconnects: int = 0
    board_resets: int = 0
    """Found by an uptime that went back."""
    stalls: int = 0
    """Times that the board answered, but did not stream, without a reset."""
    comebacks: int = 0
    """Chips that were gone and came back."""
    offset_differences: int = 0
    """Times that a chip's offsets were not those saved."""
    clock_jumps: int = 0
    """Times that the board's clock or the host's did not go on as it had."""
    clock_doubts: int = 0
    """Packets whose time was not believed: they were stamped by their arrival."""
    wall_clock_steps: int = 0


class Handler(Protocol):
    """Whom a session tells. All is called from the session's thread, and gives no commands itself."""

    def on_data(self, data: Data | RawData, stamps_ns: list[int]) -> None:
        """A sweep's orientations or raw measurements, and when each was measured: wall clock, ns since 1970."""

    def on_acceleration(self, acceleration: Acceleration, stamps_ns: list[int]) -> None:
        """A sweep's accelerations, and when each of them was measured: wall clock, ns since 1970."""

    def on_magnetic_fields(self, fields: MagneticFields, stamps_ns: list[int]) -> None:
        """A sweep's magnetic fields, and when each of them was measured: wall clock, ns since 1970."""

    def on_offsets(self, imu_id: int, offsets: Offsets) -> None:
        """What was read from a chip."""

    def on_event(self, event: Event) -> None:
        """Something that the user is to be told."""
