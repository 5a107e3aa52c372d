"""What a configuration holds. Each field says its default, meaning and range; validation and ROS read them here."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache
from typing import Any, get_type_hints

import numpy as np

from sesa2.configuration.magnetic_sections import (
    FieldSourceSection,
    MagnetometerSection,
    MagnetSection,
    magnetic_readings,
)
from sesa2.control.controller_options import ControllerOptions
from sesa2.control.tip_controller import TipController
from sesa2.plant.plant_options import PlantOptions
from sesa2.plant.simulated_arm import Plant
from sesa2.sensing.imu.error_model import Bno055Errors
from sesa2.sensing.lengths import BackboneLengths
from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings
from sesa2.shape.arm import Arm, GeometryError
from sesa2.shape.layout import Layout
from sesa2.shape.model import Model
from sesa2.shape.models import MODELS
from sesa2.shape.options import REQUIRED, ModelOptions, parameter
from sesa2.shape.rotations import FloatArray

Floats = tuple[float, ...]


@dataclass(frozen=True)
class Run:
    """What `sesa2 run` starts."""

    source: str = parameter(
        'sim', 'where orientations come from', choices=('sim', 'serial', 'bag', 'external')
    )
    mode: str = parameter(
        'stream', 'estimate the shape, or calibrate the sensors', choices=('stream', 'calibrate')
    )
    plant: bool = parameter(
        True, 'with the source sim, an arm whose lengths are measured is one that obeys `command`'
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
    frame_prefix: str = parameter(
        '', 'in front of the names of all frames, so that several arms share one tree of them'
    )


@dataclass(frozen=True)
class SegmentSection:
    """The pieces of the arm that bend and stretch each for itself; without them each section between IMUs is one."""

    lengths: Floats = parameter(
        (), 'length of each segment at rest, base to tip, m; together arm.length', above=0.0
    )
    radii: Floats = parameter(
        (), 'radius of each segment, m, one for all or one each; left out: arm.radius', above=0.0
    )
    bend_max: float = parameter(
        1.6, 'largest bend of a segment, rad; limits fits and commands', above=0.0, high=6.2832
    )
    stretch: Floats = parameter(
        (0.5, 1.5),
        'smallest and largest length over that at rest; limits fits and commands, outside is warned of',
        above=0.0,
    )


@dataclass(frozen=True)
class LengthSection:
    """The backbones whose length is measured; every list but the names has one entry per name, or one for all."""

    names: tuple[str, ...] = parameter((), 'name of each backbone on backbone_lengths')
    segments: tuple[int, ...] = parameter((1,), 'segment that the backbone ends with, 1 the first', low=1)
    starts: tuple[int, ...] = parameter(
        (1,), 'segment that the backbone begins with; 1: it runs from the clamp', low=1
    )
    angles: Floats = parameter(
        (0.0,), 'where the backbone runs, about the axis of the arm from x towards y, rad'
    )
    radii: Floats = parameter(
        (0.0,),
        "distance of the backbone from the axis, m; 0: on it, the segments' length itself, preferred over others",
        low=0.0,
    )
    scales: Floats = parameter((1.0,), 'length of the backbone = scale × what is said + offset')
    offsets: Floats = parameter((0.0,), 'length of the backbone where 0 is said, m')
    timeout: float = parameter(0.2, 'age after which a length is none, s', above=0.0)


@dataclass(frozen=True)
class Imus:
    """The IMUs; every list has one entry per id."""

    ids: tuple[int, ...] = parameter(
        REQUIRED,
        'id of each IMU, base to tip; on a board: multiplexer channel + 1, and 8 more for each further port',
        low=1,
    )
    topics: tuple[str, ...] = parameter(
        (), 'topic of each IMU instead of imu_<id>/data, that of the one on the base last'
    )
    positions: Floats = parameter(REQUIRED, 'arc length of each IMU from the clamp, m', above=0.0)
    enabled: tuple[bool, ...] = parameter(REQUIRED, 'whether each IMU is used')
    mount_orientations: Floats = parameter(
        (0.0, 0.0, 0.0, 1.0), 'q_LS, the sensor in its link: x y z w, one for all or one per IMU'
    )
    headings: Floats = parameter(
        (0.0,), 'heading error of each IMU about the vertical, rad, one for all or one per IMU'
    )
    base_id: int = parameter(0, 'id of an IMU on the base instead of base_orientation; 0: none', low=0)
    base_mount_orientation: Floats = parameter((0.0, 0.0, 0.0, 1.0), 'q_BS of the IMU on the base, x y z w')
    stamps: str = parameter(
        'header', "time of a sample: its message's stamp, or its arrival", choices=('header', 'arrival')
    )
    latency: float = parameter(0.0, 'delay of the sensors, s, taken off the stamps', low=0.0, high=1.0)
    fusion: str = parameter(
        'none',
        'orientations as measured, or from angular velocity and acceleration (6d) and magnetic field (9d)',
        choices=('none', '6d', '9d'),
    )
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
class Serial:
    """The boards' ports and what is asked of the boards."""

    port: str = parameter('/dev/ttyACM0', 'serial port; a name under /dev/serial/by-id stays the same')
    ports: tuple[str, ...] = parameter((), 'instead of port: that of each board, IMUs 1 to 8 first')
    baud: int = parameter(500000, 'bit rate of the port, as built into the firmware', low=9600, high=2000000)
    rate_hz: int = parameter(100, 'sweeps per second', low=1, high=100)
    fusion: str = parameter(
        'NDOF',
        "the chips' fusion mode; RAW: none, for imus.fusion",
        choices=('NDOF', 'NDOF_FMC_OFF', 'IMU', 'RAW'),
    )
    acceleration: bool = parameter(False, 'stream acceleration too; RAW always does')

    @property
    def all_ports(self) -> tuple[str, ...]:
        """Port of each board."""
        return self.ports or (self.port,)

    def on(self, ports: Sequence[str]) -> 'Serial':
        """The same on other ports."""
        one = len(ports) == 1
        return replace(self, port=ports[0] if one else '', ports=() if one else tuple(ports))


@dataclass(frozen=True)
class Calibration:
    """Where the chips' offsets are kept."""

    file: str = parameter('', 'YAML file of the offsets; empty: none')


@dataclass(frozen=True)
class Record:
    """What is recorded, and where."""

    file: str = parameter('', 'bag to write; empty: none')
    imu: bool = parameter(True, 'record what is measured: orientations, fields, lengths')
    acceleration: bool = parameter(False, 'record acceleration')
    results: bool = parameter(True, 'record what the estimator publishes')


@dataclass(frozen=True)
class Configuration:
    """A whole configuration; made by `validate`, which fills in and checks.

    In files and as parameters `options` is not seen: each model's options stand in a section of its name.
    """

    run: Run = field(default_factory=Run)
    arm: ArmSection = field(default_factory=ArmSection)
    segments: SegmentSection = field(default_factory=SegmentSection)
    lengths: LengthSection = field(default_factory=LengthSection)
    imus: Imus = field(default_factory=Imus)
    magnets: MagnetSection = field(default_factory=MagnetSection)
    magnetometers: MagnetometerSection = field(default_factory=MagnetometerSection)
    field_source: FieldSourceSection = field(default_factory=FieldSourceSection)
    markers: Markers = field(default_factory=Markers)
    models: tuple[str, ...] = parameter(('rigid', 'pcc'), 'shape models to run', choices=MODELS)
    links: int = parameter(64, 'links that stand for a curve on the ROS graph', low=1, high=1000)
    options: Mapping[str, ModelOptions] = field(
        default_factory=lambda: {n: m.Options() for n, m in MODELS.items()}
    )
    time_alignment: str = parameter(
        'none', 'samples as they come, or interpolated to one instant', choices=('none', 'interpolate')
    )
    sweep_timeout: float = parameter(
        0.05, 'time after which a sweep is closed without its missing IMUs, s', above=0.0
    )
    serial: Serial = field(default_factory=Serial)
    calibration: Calibration = field(default_factory=Calibration)
    record: Record = field(default_factory=Record)
    plant: PlantOptions = field(default_factory=PlantOptions)
    controller: ControllerOptions = field(default_factory=ControllerOptions)

    @property
    def layout(self) -> Layout:
        """The arm and its sensors as the shape models want them."""
        bare = Layout(
            Arm(self.arm.length),
            self.imus.positions,
            self.segments.lengths,
            stretches=self.has_lengths,
            bend_max=self.segments.bend_max,
            stretch_limits=self.segments.stretch,
            n_magnetometers=len(self.magnetometers.ids),
            backbone_radii=self.backbones.mean_radii if self.has_lengths else (),
        )
        return replace(bare, readings=magnetic_readings(self.magnets, self.magnetometers, bare.segment_ends))

    def models_of(self, kind: str) -> tuple[str, ...]:
        """Those of its models that magnetometers feed (`fields`), or those that IMUs do (`orientations`)."""
        return tuple(name for name in self.models if kind in MODELS[name].needs)

    def stretches(self, model: str) -> bool:
        """Whether the shapes of a model have segments of changing length, measured or found."""
        return self.has_lengths or MODELS[model].finds_lengths

    @property
    def has_lengths(self) -> bool:
        """Whether the present lengths of the segments are measured."""
        return bool(self.lengths.names)

    @property
    def backbones(self) -> BackboneLengths:
        """What the lengths of the backbones say of the segments.

        Raises
        ------
        GeometryError
            no length is measured.
        """
        a = self.lengths
        return BackboneLengths(
            len(self.segments.lengths),
            len(a.names),
            a.segments,
            a.starts,
            a.angles,
            a.radii,
            a.scales,
            a.offsets,
        )

    @property
    def base(self) -> FloatArray:
        """q_WB as configured, (4,), x y z w, unit norm; with an IMU on the base, what is assumed until it is heard."""
        return _unit(self.arm.base_orientation)

    @property
    def base_mounting(self) -> FloatArray:
        """q_BS of the IMU on the base, (4,), x y z w, unit norm."""
        return _unit(self.imus.base_mount_orientation)

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
        return self.frame('base_link' if self.arm.output_frame == 'base' else 'world')

    def frame(self, name: str) -> str:
        """The full name of one of this arm's frames."""
        return self.arm.frame_prefix + name

    def with_alignment(self, mountings: FloatArray, headings: FloatArray) -> 'Configuration':
        """The same with other mountings q_LS, (n_imu, 4), and headings, (n_imu,), rad."""
        imus = replace(
            self.imus,
            mount_orientations=tuple(np.round(mountings, 9).ravel().tolist()),
            headings=tuple(np.round(headings, 9).tolist()),
        )
        return replace(self, imus=imus)

    def with_magnets(self, found: MagneticReadings) -> 'Configuration':
        """The same with magnets and magnetometers as a predictor of them has them."""
        return replace(
            self,
            magnets=self.magnets.calibrated(found, self.layout.segment_ends),
            magnetometers=self.magnetometers.calibrated(found),
        )

    def with_options(self, model: str, **values: Any) -> 'Configuration':
        """The same with other options of a model."""
        return replace(self, options={**self.options, model: replace(self.options[model], **values)})

    def create_model(self, name: str, layout: Layout | None = None) -> Model[Any]:
        """A model with its options, for this arm and its sensors or for another layout.

        Raises
        ------
        GeometryError
            its options do not fit.
        """
        options, layout = self.options[name], layout or self.layout
        shared = {name: getattr(self, name) for name in _shared() if hasattr(options, name)}
        return MODELS[name](layout, replace(options, **shared).filled(layout.n_imu))

    @property
    def has_controller(self) -> bool:
        """Whether the tip is driven: the backbones that do it are named."""
        return bool(self.controller.names)

    def create_controller(self) -> TipController:
        """The tip controller, with the segments, backbones and IMUs of this arm.

        Raises
        ------
        ControlError, GeometryError
            the backbones that it names do not drive the segments, or its limits leave nothing.
        """
        driven = [self.lengths.names.index(name) for name in self.controller.names]
        places = dict(zip(self.imus.ids, self.imus.positions, strict=True))
        return TipController(
            self.controller,
            segment_lengths=self.segments.lengths,
            backbones=self.backbones.chosen(driven),
            bend_max=self.segments.bend_max,
            stretch=self.segments.stretch,
            imu_positions=places | ({self.imus.base_id: 0.0} if self.imus.base_id else {}),
        )

    @property
    def has_field_source(self) -> bool:
        """Whether an arm with magnets is simulated."""
        return self.run.source == 'sim' and bool(self.models_of('fields')) and not self.imus.all_ids

    @property
    def has_plant(self) -> bool:
        """Whether the arm is a simulated one that racks drive."""
        return self.run.source == 'sim' and self.run.plant and self.has_lengths and not self.run.trial

    def create_plant(self, **options: Any) -> Plant:
        """The simulated arm, with the segments, backbones and IMUs of this one.

        Parameters
        ----------
        options
            other values of the section `plant`.

        Raises
        ------
        GeometryError
            no length is measured, or the section does not fit the arm.
        """
        chosen = replace(self.plant, **options)
        errors = Bno055Errors().times(chosen.imu_errors)
        return Plant(
            chosen,
            segment_lengths=self.segments.lengths,
            backbones=self.backbones,
            imu_positions=self.imus.positions,
            base=self.base,
            base_imu=self.imus.base_id != 0,
            # What does not fuse has no errors of fusion.
            errors=errors.only('mounting') if self.serial.fusion == 'RAW' else errors,
        )

    def flat(self) -> dict[str, Any]:
        """Every parameter by its dotted name, as ROS wants them."""
        return {path: self._value(path) for path, _, _ in leaves()}

    def _value(self, path: str) -> Any:
        section, _, name = path.rpartition('.')
        if not section:
            return getattr(self, name)
        return getattr(self.options[section] if section in self.options else getattr(self, section), name)


@cache
def _shared() -> frozenset[str]:
    """Names of the parameters that stand in no section; an option of a model that has such a name is that parameter."""
    hints = get_type_hints(Configuration)
    return frozenset(n for n, kind in hints.items() if not is_dataclass(kind) and n != 'options')


def sections() -> dict[str, Any]:
    """Record of every section by its name: those of the configuration, then the options of models."""
    hints = get_type_hints(Configuration)
    kinds: dict[str, Any] = {name: kind for name, kind in hints.items() if is_dataclass(kind)}
    for name, model in MODELS.items():
        if name in hints:
            raise GeometryError(f'a model cannot be named {name!r}: the configuration has a key of this name')
        kinds[name] = model.Options
    return kinds


def leaves() -> Iterator[tuple[str, Any, Any]]:
    """Every parameter: its dotted name, its type and its field; each model's options behind the number of links."""
    hints, records, shared = get_type_hints(Configuration), sections(), _shared()

    def of_section(name: str) -> Iterator[tuple[str, Any, Any]]:
        inner = get_type_hints(records[name])
        for leaf in fields(records[name]):
            if name not in MODELS or leaf.name not in shared:
                yield f'{name}.{leaf.name}', inner[leaf.name], leaf

    for item in fields(Configuration):
        if item.name == 'options':
            for name in MODELS:
                yield from of_section(name)
        elif item.name in records:
            yield from of_section(item.name)
        else:
            yield item.name, hints[item.name], item


def _unit(q: Any) -> FloatArray:
    q = np.asarray(q, dtype=float)
    return q / np.linalg.norm(q, axis=-1, keepdims=True)
