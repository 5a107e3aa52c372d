"""From plain values, as YAML or ROS give them, to a configuration; every mistake is found at once."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from difflib import get_close_matches
from typing import Any, NamedTuple, get_args, get_origin

from sesa2.configuration.controller_checks import check_controller
from sesa2.configuration.magnetic_checks import check_magnets
from sesa2.configuration.records import Configuration, leaves, sections
from sesa2.configuration.ros_names import is_frame_prefix, is_topic_name
from sesa2.configuration.segment_checks import check_segments
from sesa2.errors import Sesa2Error, shortened, shown
from sesa2.sensing.imu.addresses import CHANNELS, ids_by_board, imu_id_at
from sesa2.shape.arm import GeometryError
from sesa2.shape.models import MODELS
from sesa2.shape.options import REQUIRED, ModelOptions

# Of many mistakes the first have the same reason as the rest.
_MOST_TOLD = 40


class Mistake(NamedTuple):
    """One thing that is wrong: where, and what was got and expected."""

    place: str
    message: str


class ConfigurationError(Sesa2Error):
    """A configuration that cannot be used; carries every mistake."""

    def __init__(self, mistakes: Iterable[Mistake], source: str = 'configuration'):
        self.mistakes = tuple(mistakes)
        self.source = source
        count = '1 mistake' if len(self.mistakes) == 1 else f'{len(self.mistakes)} mistakes'
        lines = [
            f'  {m.place}: {m.message}' if m.place else f'  {m.message}' for m in self.mistakes[:_MOST_TOLD]
        ]
        if len(self.mistakes) > _MOST_TOLD:
            lines.append(f'  … and {len(self.mistakes) - _MOST_TOLD} more')
        super().__init__('\n'.join([f'{source}: {count}', *lines]))


def validate(values: Mapping[str, Any], source: str = 'configuration') -> Configuration:
    """Make a configuration.

    Parameters
    ----------
    values
        nested as in the file, under `ros__parameters`.
    source
        where the values are from, for the message.

    Raises
    ------
    ConfigurationError
        with every mistake, its place and what is allowed.
    """
    mistakes: list[Mistake] = []
    given = _flatten(values, mistakes)
    read: dict[str, Any] = {}
    for path, kind, item in leaves():
        if path in given:
            value = _read(path, kind, item.metadata, given.pop(path), mistakes)
            if value is not None:
                read[path] = value
    # A list that could not be read is not also missed.
    known = {path for path, _, _ in leaves()}
    mistakes += [
        Mistake(shortened(path), _unknown(path, known) if n < _MOST_TOLD else 'is not known')
        for n, path in enumerate(given)
    ]
    wrong = {m.place.split('[')[0] for m in mistakes}
    # An arm may have magnetometers and no IMUs.
    imus = ('imus.ids', 'imus.positions')
    known = {*read, *wrong}
    without = 'magnetometers.ids' in known and not known.intersection(imus)
    for path in ('arm.length', *(() if without else imus)):
        if path not in known:
            mistakes.append(Mistake(path, 'is missing'))
    if 'serial.ports' in read:
        read.setdefault('serial.port', '')
    if not mistakes:
        configuration = _fill(_build(read))
        mistakes += _check(configuration)
    if mistakes:
        raise ConfigurationError(mistakes, source)
    return configuration


def _flatten(values: Mapping[str, Any], mistakes: list[Mistake]) -> dict[str, Any]:
    known = sections()
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if key in known and not isinstance(value, Mapping):
            mistakes.append(Mistake(str(key), f'got {shown(value)}, expected a section with keys'))
        elif isinstance(value, Mapping):
            flat.update({f'{key}.{inner}': item for inner, item in value.items()})
        else:
            flat[str(key)] = value
    return flat


def _unknown(path: str, known: set[str]) -> str:
    nearest = get_close_matches(path, known, n=1, cutoff=0.6)
    if not nearest:  # the right key in the wrong section
        nearest = [k for k in known if k.split('.')[-1] == path.split('.')[-1]][:1]
    return f'is not known; did you mean {nearest[0]}?' if nearest else 'is not known'


_NAMES = {float: 'a number', int: 'an integer', bool: 'true or false', str: 'a text'}


def _read(path: str, kind: Any, rule: Mapping[str, Any], value: Any, mistakes: list[Mistake]) -> Any:
    """A value of the kind, or None after noting what is wrong with it."""
    if get_origin(kind) not in (tuple, None):  # a text or a list
        text, several = get_args(kind)
        kind = text if isinstance(value, str) else several
    if get_origin(kind) is tuple:
        kind = get_args(kind)[0]
        if not isinstance(value, (list, tuple)):
            mistakes.append(Mistake(path, f'got {shown(value)}, expected a list, [{_NAMES[kind]}, …]'))
            return None
        if not value:
            mistakes.append(Mistake(path, 'got an empty list, which ROS cannot read; leave the key out'))
            return None
        if kind is float and {type(v) for v in value} == {int, float}:
            at = next(i for i, v in enumerate(value) if type(v) is int)
            mistakes.append(
                Mistake(
                    f'{path}[{at}]',
                    f'got the integer {value[at]} among numbers, which ROS cannot read; write {value[at]}.0',
                )
            )
            return None
        entries = [_one(f'{path}[{i}]', kind, rule, v, mistakes) for i, v in enumerate(value)]
        return None if None in entries else tuple(entries)
    return _one(path, kind, rule, value, mistakes)


def _one(place: str, kind: type, rule: Mapping[str, Any], value: Any, mistakes: list[Mistake]) -> Any:
    if kind is float and type(value) is int and abs(value) < 10**300:
        value = float(value)
    if type(value) is not kind:
        hint = ' (quote it)' if kind is str else ''
        mistakes.append(Mistake(place, f'got {shown(value)}, expected {_NAMES[kind]}{hint}'))
        return None
    if isinstance(value, float) and not math.isfinite(value):
        mistakes.append(Mistake(place, f'got {value}, expected a finite number'))
        return None
    low, high, above, choices = rule['low'], rule['high'], rule['above'], rule['choices']
    allowed = ''
    if choices and value not in choices:
        allowed = f'one of {", ".join(map(str, choices))}'
        nearest = get_close_matches(str(value), map(str, choices), n=1)
        allowed += f'; did you mean {nearest[0]}?' if nearest else ''
    elif (
        (above is not None and not value > above)
        or (low is not None and value < low)
        or (high is not None and value > high)
    ):
        allowed = _range(low, high, above)
    if allowed:
        mistakes.append(Mistake(place, f'got {shown(value)}, expected {allowed}'))
        return None
    return value


def _range(low: float | None, high: float | None, above: float | None) -> str:
    if low is not None and high is not None:
        return f'{low:g} to {high:g}'
    bounds = ((above, 'more than'), (low, 'at least'), (high, 'at most'))
    return ' and '.join(f'{words} {bound:g}' for bound, words in bounds if bound is not None)


def _build(read: Mapping[str, Any]) -> Configuration:
    top: dict[str, Any] = {path: value for path, value in read.items() if '.' not in path}
    options: dict[str, ModelOptions] = {}
    for name, kind in sections().items():
        own = kind(**{path.split('.')[1]: v for path, v in read.items() if path.startswith(f'{name}.')})
        if name in MODELS:
            options[name] = own
        else:
            top[name] = own
    return Configuration(**top, options=options)


def _fill(c: Configuration) -> Configuration:
    """Lists that were not given: every IMU enabled, and what each model makes of its own."""
    n = len(c.imus.ids)
    if c.imus.enabled == REQUIRED:
        c = replace(c, imus=replace(c.imus, enabled=(True,) * n))
    return replace(c, options={name: own.filled(n) for name, own in c.options.items()})


def _check(c: Configuration) -> list[Mistake]:
    """What no single value shows."""
    n = len(c.imus.ids)
    mistakes: list[Mistake] = []

    def expect(ok: bool, place: str, message: str) -> bool:
        if not ok:
            mistakes.append(Mistake(place, message))
        return ok

    for i, name in _repeated(c.imus.ids):
        expect(False, f'imus.ids[{i}]', f'got {name} a second time')
    for name in ('positions', 'enabled'):
        got = len(getattr(c.imus, name))
        expect(got == n, f'imus.{name}', f'has {got} entries, expected {n}: one per id')
    expect(
        any(c.imus.enabled) or not n, 'imus.enabled', 'got false for every IMU, expected at least one true'
    )
    for i, (before, s) in enumerate(zip(c.imus.positions, c.imus.positions[1:], strict=False), start=1):
        expect(s > before, f'imus.positions[{i}]', f'{s:g} m is not after {before:g} m')
    for i, s in enumerate(c.imus.positions):
        expect(s <= c.arm.length, f'imus.positions[{i}]', f'{s:g} m is beyond the tip at {c.arm.length:g} m')
    headings = len(c.imus.headings)
    expect(
        headings in (1, n),
        'imus.headings',
        f'has {headings} entries, expected 1 or {n}: one for all or one per IMU',
    )
    mounts = len(c.imus.mount_orientations)
    if expect(
        mounts in (4, 4 * n),
        'imus.mount_orientations',
        f'has {mounts} numbers, expected 4 or {4 * n}: x y z w, one for all or one per IMU',
    ):
        for i in range(0, mounts, 4):
            _check_unit(f'imus.mount_orientations[{i}:{i + 4}]', c.imus.mount_orientations[i : i + 4], expect)
    for place, q in (
        ('arm.base_orientation', c.arm.base_orientation),
        ('imus.base_mount_orientation', c.imus.base_mount_orientation),
    ):
        if expect(len(q) == 4, place, f'has {len(q)} numbers, expected 4: x y z w'):
            _check_unit(place, q, expect)
    expect(
        c.imus.base_id not in c.imus.ids,
        'imus.base_id',
        f'got {c.imus.base_id}, which is also in imus.ids; it sits on the base',
    )
    names, at = c.markers.names, c.markers.positions
    expect(
        len(names) == len(at),
        'markers.positions',
        f'has {len(at)} entries, expected {len(names)}: one per name',
    )
    for i, name in _repeated(names):
        expect(False, f'markers.names[{i}]', f'got {shown(name)} a second time')
    for i, s in enumerate(at):
        expect(
            s <= c.arm.length, f'markers.positions[{i}]', f'{s:g} m is beyond the tip at {c.arm.length:g} m'
        )
    for i, name in _repeated(c.models):
        expect(False, f'models[{i}]', f'got {shown(name)} a second time')
    _check_names(c, expect)
    check_segments(c, expect)
    check_magnets(c, expect)
    _check_boards(c, expect)
    _check_raw(c, expect)
    expect(
        bool(n) or c.run.source != 'serial' or not c.magnetometers.ids,
        'run.source',
        "got 'serial', and there are no IMUs that a board would have; magnetometers come from a driver: 'external'",
    )
    if c.run.source == 'bag':
        expect(c.run.bag != '', 'run.bag', "is empty, and the source is 'bag'")
    if c.run.mode == 'calibrate':
        expect(
            c.run.source in ('sim', 'serial'),
            'run.mode',
            "got 'calibrate', which needs the source sim or serial",
        )
        expect(c.calibration.file != '', 'calibration.file', "is empty, and the mode is 'calibrate'")
    if not mistakes and c.has_plant:
        try:
            c.create_plant()
        except GeometryError as error:
            mistakes.append(Mistake('plant', str(error)))
    if not mistakes:
        for name in c.models:
            try:
                c.create_model(name)
            except GeometryError as error:
                mistakes.append(Mistake(name, str(error)))
    if not mistakes:
        check_controller(c, expect)
    return mistakes


def _check_names(c: Configuration, expect: Callable[[bool, str, str], bool]) -> None:
    """Names that others on the graph see."""
    topics, n = c.imus.topics, len(c.imus.all_ids)
    also = ', and one for imus.base_id' if c.imus.base_id else ''
    expect(len(topics) in (0, n), 'imus.topics', f'has {len(topics)} entries, expected {n}: one per id{also}')
    for i, name in enumerate(topics):
        right = 'letters, digits and _ between single slashes, as /left/imu_3/data'
        expect(
            is_topic_name(name), f'imus.topics[{i}]', f'got {name!r}, expected the name of a topic: {right}'
        )
    for i, name in _repeated(topics):
        expect(False, f'imus.topics[{i}]', f'got {name!r} a second time')
    prefix = c.arm.frame_prefix
    expect(
        is_frame_prefix(prefix),
        'arm.frame_prefix',
        f'got {prefix!r}, expected nothing, or letters, digits, _ and /, first a letter, as left_',
    )


def _check_boards(c: Configuration, expect: Callable[[bool, str, str], bool]) -> None:
    """Where boards are asked, each IMU hangs on one of them, and each of them has an IMU."""
    ports = c.serial.all_ports
    if c.serial.ports:
        both = 'stands beside serial.ports, expected one of the two: port for one board, ports for several'
        expect(c.serial.port == '', 'serial.port', both)
        for i, name in _repeated(ports):
            expect(False, f'serial.ports[{i}]', f'got {shown(name)} a second time')
    for i, name in enumerate(ports):
        place = f'serial.ports[{i}]' if c.serial.ports else 'serial.port'
        expect(name != '' or c.run.source != 'serial', place, 'is empty, expected a serial port')
    if c.run.source not in ('sim', 'serial'):
        return
    last = CHANNELS * len(ports)
    places = {f'imus.ids[{i}]': imu_id for i, imu_id in enumerate(c.imus.ids)} | {
        'imus.base_id': c.imus.base_id
    }
    for place, imu_id in places.items():
        expect(
            imu_id <= last,
            place,
            f'got {imu_id}, expected 1 to {last}: {CHANNELS} on each board, and serial.ports says where several are',
        )
    boards = ids_by_board(c.imus.all_ids)
    for board in range(len(c.serial.ports)):
        span = f'{imu_id_at(board, 0)} to {imu_id_at(board, CHANNELS - 1)}'
        expect(
            board in boards,
            f'serial.ports[{board}]',
            f'has no IMU, expected one of the ids {span} in imus.ids',
        )


def _check_raw(c: Configuration, expect: Callable[[bool, str, str], bool]) -> None:
    """Chips that fuse nothing need the host to, and it needs them not to."""
    if c.run.source not in ('sim', 'serial'):
        return
    raw, fused = c.serial.fusion == 'RAW', c.imus.fusion != 'none'
    expect(
        not raw or fused or c.run.mode == 'calibrate',
        'serial.fusion',
        "got 'RAW', which gives no orientations by itself, expected imus.fusion 6d or 9d beside it",
    )
    expect(
        raw or not fused or c.run.source == 'sim',  # sim is the default, also of a replay
        'imus.fusion',
        f'got {c.imus.fusion!r}, and the chips fuse by themselves (serial.fusion: {c.serial.fusion}); '
        f'expected none, or serial.fusion RAW beside it',
    )


def _repeated(values: Iterable[Any]) -> list[tuple[int, Any]]:
    seen: set[Any] = set()
    again = []
    for i, value in enumerate(values):
        if value in seen:
            again.append((i, value))
        seen.add(value)
    return again


def _check_unit(place: str, q: tuple[float, ...], expect: Any) -> None:
    norm = math.sqrt(sum(v * v for v in q))
    # A hundredth lets a quaternion with two decimals pass; it is normalised before use.
    expect(abs(norm - 1.0) < 0.01, place, f'has norm {norm:.4g}, expected a unit quaternion x y z w')
