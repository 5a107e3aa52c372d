"""The whole configuration as a form in three tabs: every parameter, in plain words, checked as it is typed."""

import threading
from collections.abc import Callable, Iterable
from itertools import count
from typing import Any

import viser

from sesa2.configuration import Configuration, ConfigurationError, Mistake, validate
from sesa2.configuration.records import leaves
from sesa2.shape.models import MODELS
from sesa2.viewer.fields import Field, mistake_html, nested

_RUN = {
    'Source': {
        'run.source': 'source',
        'run.mode': 'mode',
        'run.trial': 'simulated trial',
        'run.plant': 'sim obeys commands',
    },
    'Board': {
        'serial.port': 'port',
        'serial.ports': 'or ports of several',
        'serial.baud': 'baud rate',
        'serial.rate_hz': 'sweeps per s',
        'serial.fusion': 'fusion mode',
        'serial.acceleration': 'acceleration',
        'calibration.file': 'offsets file',
    },
    'Recording to play': {
        'run.bag': 'bag',
        'run.rate': 'speed',
        'run.start': 'start at [s]',
        'run.loop': 'again and again',
        'run.clock': 'publish /clock',
    },
    'Record': {
        'record.file': 'into bag',
        'record.imu': 'IMUs',
        'record.acceleration': 'acceleration',
        'record.results': 'results',
    },
}
_ARM = {
    'Arm': {
        'arm.length': 'length [m]',
        'arm.radius': 'radius [m]',
        'arm.base_orientation': 'base q_WB xyzw',
        'arm.output_frame': 'results in',
        'arm.frame_prefix': 'frames begin with',
    },
    'Links': {
        'links': 'links of a curve',
        'rigid.boundaries': 'rigid: joints',
        'rigid.base_link_length': 'rigid: L₀ [m]',
    },
    'Timing': {
        'time_alignment': 'align in time',
        'sweep_timeout': 'wait for IMUs [s]',
        'imus.stamps': 'stamps',
        'imus.latency': 'IMU latency [s]',
        'imus.fusion': 'fusion on the host',
        'imus.heading_filter': 'heading filter',
    },
}
_TOPICS = {'imus.topics': 'instead of imu_<id>/data'}
_BASE_IMU = {'imus.base_id': 'IMU id, 0: none', 'imus.base_mount_orientation': 'mounting xyzw'}


class Form:
    """Shows a configuration and reads the user's.

    Parameters
    ----------
    gui
        of the page.
    tabs
        where the form goes.
    refused
        what else is wrong with a valid configuration that was typed here.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        tabs: viser.GuiTabGroupHandle,
        refused: Callable[[Configuration], Iterable[Mistake]],
    ):
        self._gui, self._refused = gui, refused
        self._run_tab = tabs.add_tab('Run')
        self._arm_tab = tabs.add_tab('Arm')
        self._imu_tab = tabs.add_tab('IMUs')
        self._lock = threading.RLock()
        self._contents: list[Any] = []
        self._fields: list[Field] = []
        self._imu_rows: list[tuple[viser.GuiFolderHandle, Field, Field, Field]] = []
        self.mistakes: tuple[Mistake, ...] = ()
        self.configuration: Configuration | None = None  # as last checked
        self.changed: Callable[[], None] = lambda: None

    def fill_in(self, c: Configuration) -> None:
        """Show this configuration instead of what stands there."""
        with self._lock:
            if self.check() == c:
                return  # nothing new, and somebody may be typing
            for item in self._contents:
                item.remove()
            self._fields, self._contents, self._imu_rows = [], [], []
            self._flat = c.flat()
            with self._run_tab:
                self._add_folders(_RUN)
                self._add_folder('Simulated arm', _all_of('plant'), expand=False)
            with self._arm_tab:
                self._add_folder('Arm', _ARM['Arm'])
                self._add_folder('Segments', _all_of('segments'), expand=bool(c.segments.lengths))
                self._add_folder('Measured lengths', _all_of('lengths'), expand=c.has_lengths)
                self._add_markers(c)
                self._add_models(c)
                self._add_folder('Links', _ARM['Links'] | _options_of_models())
                self._add_folder('Timing', _ARM['Timing'])
                for section, labels in _further_sections().items():
                    self._add_folder(section.capitalize(), labels, expand=False)
            with self._imu_tab:
                self._add_imus(c)
                self._add_folder('IMU on the base', _BASE_IMU, expand=False)
                self._add_folder('Topics', _TOPICS, expand=False)
            self.check()

    def take_alignment(self, c: Configuration) -> None:
        """Show the mountings and headings of this configuration; all else stays as it stands there."""
        with self._lock:
            found: dict[str, Any] = {
                'imus.mount_orientations': iter(c.mountings.tolist()),
                'imus.headings': iter(c.headings.tolist()),
            }
            for field in self._fields:
                if field.path in found and (value := next(found[field.path], None)) is not None:
                    field.value = value
            self.check()

    def check(self) -> Configuration | None:
        """Validate what stands there, and show each mistake beside its field; None where there is one."""
        with self._lock:
            if not self._fields:
                self.mistakes = (
                    Mistake('', 'nothing is in the form yet; load a configuration in the tab File'),
                )
                return None
            flat: dict[str, Any] = {}
            for field in self._fields:
                field.write(flat)
            chosen = [name for name, box in self._models.items() if box.value]
            flat['models'] = chosen
            _shorten(flat)
            c: Configuration | None
            mistakes: tuple[Mistake, ...]
            try:
                c = validate(nested(flat), 'form')
                mistakes = tuple(self._refused(c))
                c = None if mistakes else c
            except ConfigurationError as error:
                c, mistakes = None, error.mistakes
            if not chosen:
                c, mistakes = None, (*mistakes, Mistake('models', 'none is chosen, expected at least one'))
            self._models_mistake.content = mistake_html([m.message for m in mistakes if m.place == 'models'])
            for field in self._fields:
                field.show([m for m in mistakes if field.concerns(m)])
            self.mistakes, self.configuration = mistakes, c
            return c

    def _change(self) -> None:
        self.check()
        for folder, id_, position, enabled in self._imu_rows:
            _set_label(folder, id_.value, position.value, enabled.value)
        self.changed()

    def _add_folders(self, folders: dict[str, dict[str, str]]) -> None:
        for label, labels in folders.items():
            self._add_folder(label, labels)

    def _add_folder(self, label: str, labels: dict[str, str], expand: bool = True) -> None:
        folder = self._gui.add_folder(label, expand_by_default=expand)
        self._contents.append(folder)
        with folder:
            for path, text in labels.items():
                self._add(path, text, self._flat[path])

    def _add(self, place: str, label: str, value: Any) -> Field:
        field = Field(self._gui, place, label, value, self._change)
        self._fields.append(field)
        return field

    def _add_models(self, c: Configuration) -> None:
        folder = self._gui.add_folder('Models')
        self._contents.append(folder)
        with folder:
            self._models = {
                name: self._gui.add_checkbox(name, name in c.models)
                for name in dict.fromkeys((*c.models, *MODELS))
            }
            for box in self._models.values():
                box.on_update(lambda _: self._change())
            self._models_mistake = self._gui.add_html('')

    def _add_markers(self, c: Configuration) -> None:
        folder = self._gui.add_folder('Markers')
        self._contents.append(folder)

        def row(i: int, name: str, position: float) -> list[Any]:
            return [
                self._add(f'markers.names[{i}]', f'name {i + 1}', name),
                self._add(f'markers.positions[{i}]', 'at [m]', position),
            ]

        def another() -> tuple[Any, ...]:
            used = {f.value for f in self._fields if f.path == 'markers.names'}
            return next(name for i in count(1) if (name := f'M{i}') not in used), 0.5 * c.arm.length

        rows = list(zip(c.markers.names, c.markers.positions, strict=True))
        self._add_rows(folder, 'marker', rows, row, another, least=0)

    def _add_imus(self, c: Configuration) -> None:
        folder = self._gui.add_folder(None)
        self._contents.append(folder)

        def row(i: int, *values: Any) -> list[Any]:
            id_, position, enabled, links, mounting, heading = values
            one = self._gui.add_folder('', expand_by_default=False)
            _set_label(one, id_, position, enabled)
            with one:
                fields = [
                    self._add(f'imus.ids[{i}]', 'id (channel + 1)', id_),
                    self._add(f'imus.positions[{i}]', 'at [m]', position),
                    self._add(f'imus.enabled[{i}]', 'enabled', enabled),
                    self._add(f'pcc.segments[{i}]', 'pcc: links to it', links),
                    self._add(f'imus.mount_orientations[{4 * i}:{4 * i + 4}]', 'mounting xyzw', mounting),
                    self._add(f'imus.headings[{i}]', 'heading [rad]', heading),
                ]
            self._imu_rows.append((one, fields[0], fields[1], fields[2]))
            return [*fields, one]

        rows = [
            (i, s, on, n, tuple(map(float, q)), float(h))
            for i, s, on, n, q, h in zip(
                c.imus.ids,
                c.imus.positions,
                c.imus.enabled,
                c.flat()['pcc.segments'],
                c.mountings,
                c.headings,
                strict=True,
            )
        ]

        def further() -> tuple[Any, ...]:
            used = {f.value for f in self._fields if f.path == 'imus.ids'}
            free = next(i for i in count(1) if i not in used)
            return free, c.arm.length, True, 2, (0.0, 0.0, 0.0, 1.0), 0.0

        self._add_rows(folder, 'IMU', rows, row, further, least=1)

    def _add_rows(
        self,
        folder: viser.GuiFolderHandle,
        what: str,
        rows: list[tuple[Any, ...]],
        make: Callable[..., list[Any]],
        further: Callable[[], tuple[Any, ...]],
        least: int,
    ) -> None:
        """Rows of a table, and buttons for one more and for one less at its end."""
        made: list[list[Any]] = []
        with folder:
            buttons = self._gui.add_button_group(what, ('add', 'remove last'))
            made += [make(i, *row) for i, row in enumerate(rows)]

        @buttons.on_click
        def _(_: Any) -> None:
            with self._lock:
                if buttons.value == 'add':
                    with folder:
                        made.append(make(len(made), *further()))
                elif len(made) > least:
                    for item in made.pop():
                        if isinstance(item, Field):
                            self._fields.remove(item)
                        self._imu_rows = [row for row in self._imu_rows if row[0] is not item]
                        item.remove()
                self._change()


def _further_sections() -> dict[str, dict[str, str]]:
    """Sections of which no table above has any parameter: per section their path and a label."""
    shown = {path.partition('.')[0] for of in (_RUN, _ARM) for labels in of.values() for path in labels}
    further: dict[str, dict[str, str]] = {}
    for path, _, _ in leaves():
        section, _, key = path.partition('.')
        if key and section not in MODELS and section not in {*shown, 'imus', 'markers'}:
            further.setdefault(section, {})[path] = key.replace('_', ' ')
    return further


def _options_of_models() -> dict[str, str]:
    """Of the models, options that no table above has: their path and a label."""
    shown = {*_ARM['Links'], 'pcc.segments'}  # the latter stand with the IMUs
    return {
        path: path.replace('.', ': ')
        for path, _, _ in leaves()
        if path.partition('.')[0] in MODELS and path not in shown
    }


def _all_of(section: str) -> dict[str, str]:
    """All of a section: their path and a label."""
    return {path: path.partition('.')[2] for path, _, _ in leaves() if path.partition('.')[0] == section}


def _set_label(folder: viser.GuiFolderHandle, id_: Any, position: Any, enabled: bool) -> None:
    label = f'IMU {id_} at {position} m' + ('' if enabled else ', off')
    if folder.label != label:
        folder.label = label


def _shorten(flat: dict[str, Any]) -> None:
    """Where every IMU has the same mounting or heading, one for all is what a person would write."""
    mounts, headings = flat.get('imus.mount_orientations', []), flat.get('imus.headings', [])
    if (
        len(mounts) > 4
        and len(mounts) == 4 * len(flat['imus.ids'])
        and mounts == mounts[:4] * (len(mounts) // 4)
    ):
        flat['imus.mount_orientations'] = mounts[:4]
    if len(set(map(str, headings))) == 1:
        flat['imus.headings'] = headings[:1]
