"""What a configuration holds. Each field says its default, meaning and range; validation and ROS read them here."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from typing import Any, get_type_hints

import numpy as np

from sesa2.shape.arm import Arm
from sesa2.shape.models import MODELS
from sesa2.shape.rotations import FloatArray

Floats = tuple[float, ...]

REQUIRED = ()  # a list that is not given and has no default of its own is filled in by validation, or missed there


def parameter(
    default: Any,
    meaning: str,
    *,
    low: float | None = None,
    high: float | None = None,
    above: float | None = None,
    choices: tuple[Any, ...] = (),
) -> Any:
    """A field of a record.

    Parameters
    ----------
    default
        its value where the file says nothing.
    meaning
        for people, with the unit.
    low, high
        bounds, inclusive, of a number or of each entry of a list.
    above
        bound, exclusive.
    choices
        allowed values, of it or of each entry.
    """
    return field(
        default=default,
        metadata={'meaning': meaning, 'low': low, 'high': high, 'above': above, 'choices': choices},
    )


@dataclass(frozen=True)
class Run:
    """What `sesa2 run` starts."""

    source: str = parameter(
        'sim', 'where orientations come from', choices=('sim', 'serial', 'bag', 'external')
    )
    mode: str = parameter(
        'stream', 'estimate the shape, or calibrate the sensors', choices=('stream', 'calibrate')
    )
    bag: str = parameter('', 'recording that the source `bag` plays')
    rate: float = parameter(1.0, 'speed of playing, 1 is real time', above=0.0)
    start: float = parameter(0.0, 'where in the bag playing starts, s', low=0.0)
    loop: bool = parameter(False, 'play the bag again and again')
    trial: str = parameter('', 'simulated trial whose motion the virtual board plays; empty: its own motion')
    clock: bool = parameter(False, "publish the bag's time on /clock while playing")


@dataclass(frozen=True)
class ArmSection:
    """The arm."""

    length: float = parameter(0.0, 'arc length from the clamp to the tip, m', above=0.0)
    radius: float = parameter(0.0125, 'radius of the cross-section, m, for drawing', above=0.0)
    base_orientation: Floats = parameter(
        (0.0, 0.0, 0.0, 1.0), 'q_WB, x y z w: orientation of the clamp, its z axis along the straight arm'
    )
    output_frame: str = parameter('base', 'frame of the results', choices=('base', 'world'))


@dataclass(frozen=True)
class Imus:
    """The IMUs; every list has one entry per id."""

    ids: tuple[int, ...] = parameter(
        REQUIRED, 'multiplexer channel + 1 of each IMU, base to tip', low=1, high=8
    )
    positions: Floats = parameter(REQUIRED, 'arc length of each IMU from the clamp, m', above=0.0)
    enabled: tuple[bool, ...] = parameter(REQUIRED, 'whether each IMU is used')
    mount_orientations: Floats = parameter(
        (0.0, 0.0, 0.0, 1.0), 'q_LS, the sensor in its link: x y z w, one for all or one per IMU'
    )
    headings: Floats = parameter(
        (0.0,), 'heading error of each IMU about the vertical, rad, one for all or one per IMU'
    )
    base_id: int = parameter(
        0, 'id of an IMU on the base instead of base_orientation; 0: none', low=0, high=8
    )
    base_mount_orientation: Floats = parameter((0.0, 0.0, 0.0, 1.0), 'q_BS of the IMU on the base, x y z w')
    latency: float = parameter(0.0, 'delay of the sensors, s, taken off the stamps', low=0.0, high=1.0)
    heading_filter: bool = parameter(False, 'correct slow heading drift while running')

    @property
    def all_ids(self) -> tuple[int, ...]:
        """Ids of all IMUs: those along the arm, base to tip, then the one on the base, if there is one."""
        return (*self.ids, self.base_id) if self.base_id else self.ids

    @property
    def used_ids(self) -> tuple[int, ...]:
        """Of these, the ids of those that are used."""
        used = tuple(i for i, on in zip(self.ids, self.enabled, strict=True) if on)
        return (*used, self.base_id) if self.base_id else used

    @property
    def indices(self) -> dict[int, int]:
        """Place of each id in `all_ids`."""
        return {imu_id: index for index, imu_id in enumerate(self.all_ids)}


@dataclass(frozen=True)
class Markers:
    """Points of the arm whose positions are published."""

    names: tuple[str, ...] = parameter((), 'a name for each marker')
    positions: Floats = parameter((), 'arc length of each marker from the clamp, m', low=0.0)


@dataclass(frozen=True)
class RigidSection:
    """Options of the model `rigid`."""

    boundaries: str | Floats = parameter(
        'midpoint', 'where links meet: midpoint or endpoint, or the arc lengths between the IMUs, m'
    )
    base_link_length: float = parameter(0.0, 'L₀, length of a first link oriented as the base, m', low=0.0)


@dataclass(frozen=True)
class PccSection:
    """Options of the model `pcc`."""

    segments: tuple[int, ...] = parameter(
        REQUIRED, 'number of links of each section, one per IMU', low=1, high=1000
    )


@dataclass(frozen=True)
class Serial:
    """The board's port and what is asked of the board."""

    port: str = parameter('/dev/ttyACM0', 'serial port; a name under /dev/serial/by-id stays the same')
    baud: int = parameter(500000, 'bit rate of the port, as built into the firmware', low=9600, high=2000000)
    rate_hz: int = parameter(100, 'sweeps per second', low=1, high=100)
    fusion: str = parameter('NDOF', "the chips' fusion mode", choices=('NDOF', 'NDOF_FMC_OFF', 'IMU'))
    acceleration: bool = parameter(False, 'stream acceleration too')


@dataclass(frozen=True)
class Calibration:
    """Where the chips' offsets are kept."""

    file: str = parameter('', 'YAML file of the offsets; empty: none')


@dataclass(frozen=True)
class Record:
    """What is recorded, and where."""

    file: str = parameter('', 'bag to write; empty: none')
    imu: bool = parameter(True, 'record what the IMUs measure')
    acceleration: bool = parameter(False, 'record acceleration')
    results: bool = parameter(True, 'record what the estimator publishes')


@dataclass(frozen=True)
class Configuration:
    """A whole configuration; made by `validate`, which fills in and checks."""

    run: Run = field(default_factory=Run)
    arm: ArmSection = field(default_factory=ArmSection)
    imus: Imus = field(default_factory=Imus)
    markers: Markers = field(default_factory=Markers)
    models: tuple[str, ...] = parameter(('rigid', 'pcc'), 'shape models to run', choices=tuple(MODELS))
    links: int = parameter(64, 'links that stand for a curve on the ROS graph', low=1, high=1000)
    rigid: RigidSection = field(default_factory=RigidSection)
    pcc: PccSection = field(default_factory=PccSection)
    time_alignment: str = parameter(
        'none', 'samples as they come, or interpolated to one instant', choices=('none', 'interpolate')
    )
    sweep_timeout: float = parameter(
        0.05, 'time after which a sweep is closed without its missing IMUs, s', above=0.0
    )
    serial: Serial = field(default_factory=Serial)
    calibration: Calibration = field(default_factory=Calibration)
    record: Record = field(default_factory=Record)

    @property
    def geometry(self) -> Arm:
        """The arm as the shape models want it."""
        return Arm(self.arm.length, self.imus.positions)

    @property
    def base(self) -> FloatArray:
        """q_WB, (4,), x y z w, unit norm."""
        return _unit(self.arm.base_orientation)

    @property
    def mountings(self) -> FloatArray:
        """q_LS of each IMU, (n_imu, 4), x y z w, unit norm."""
        one_each = np.reshape(self.imus.mount_orientations, (-1, 4))
        return _unit(np.broadcast_to(one_each, (len(self.imus.ids), 4)))

    @property
    def headings(self) -> FloatArray:
        """Heading error of each IMU, (n_imu,), rad."""
        return np.broadcast_to(np.array(self.imus.headings), (len(self.imus.ids),))

    @property
    def frame_id(self) -> str:
        """Frame in which results are published."""
        return 'base_link' if self.arm.output_frame == 'base' else 'world'

    def with_alignment(self, mountings: FloatArray, headings: FloatArray) -> 'Configuration':
        """The same with other mountings q_LS, (n_imu, 4), and headings, (n_imu,), rad."""
        imus = replace(
            self.imus,
            mount_orientations=tuple(np.round(mountings, 9).ravel().tolist()),
            headings=tuple(np.round(headings, 9).tolist()),
        )
        return replace(self, imus=imus)

    def model_options(self, name: str) -> dict[str, Any]:
        """Options of a model: its own section where it has one, else the number of links of a curve."""
        own = getattr(self, name, None)
        return asdict(own) if is_dataclass(own) and not isinstance(own, type) else {'links': self.links}

    def flat(self) -> dict[str, Any]:
        """Every parameter by its dotted name, as ROS wants them."""
        return {
            path: getattr(getattr(self, path.split('.')[0]), path.split('.')[1])
            if '.' in path
            else getattr(self, path)
            for path, _, _ in leaves()
        }


def leaves() -> Iterator[tuple[str, Any, Any]]:
    """Every parameter: its dotted name, its type and its field."""
    hints = get_type_hints(Configuration)
    for item in fields(Configuration):
        if is_dataclass(hints[item.name]):
            inner = get_type_hints(hints[item.name])
            for leaf in fields(hints[item.name]):
                yield f'{item.name}.{leaf.name}', inner[leaf.name], leaf
        else:
            yield item.name, hints[item.name], item


def _unit(q: Any) -> FloatArray:
    q = np.asarray(q, dtype=float)
    return q / np.linalg.norm(q, axis=-1, keepdims=True)
