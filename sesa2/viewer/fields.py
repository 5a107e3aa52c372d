"""Fields of a form that write a configuration: each knows its place in it, and shows there what is wrong."""

import html
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, get_args, get_origin

import viser

from sesa2.configuration import Mistake
from sesa2.configuration.records import leaves

_PLACE = re.compile(r'(?P<path>[^\[]+)(?:\[(?P<first>\d+)(?::(?P<end>\d+))?\])?')


class Field:
    """One value, or a few entries of a list, with an input of its own.

    Parameters
    ----------
    gui
        of the page.
    place
        as in mistakes: `arm.length`, `imus.positions[2]`, `imus.mount_orientations[4:8]`.
    label
        in a few plain words.
    value
        to begin with; a sequence where the field holds several.
    changed
        called after each change by the user.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        place: str,
        label: str,
        value: Any,
        changed: Callable[[], None],
    ):
        match = _PLACE.fullmatch(place)
        assert match is not None
        self.path = match['path']
        kind, rule = next((kind, item.metadata) for path, kind, item in leaves() if path == self.path)
        self._span = None
        if match['first']:
            first = int(match['first'])
            self._span = range(first, int(match['end']) if match['end'] else first + 1)
        self._entry, self._several = _entry(kind, self._span)
        self._input: Any  # viser's inputs of different kinds have no common one with a value that can be set
        hint = rule['meaning']
        if self._entry is bool:
            self._input = gui.add_checkbox(label, bool(value), hint=hint)
        elif rule['choices'] and not self._several:
            choices = tuple(map(str, rule['choices']))
            self._input = gui.add_dropdown(label, choices, initial_value=str(value), hint=hint)
        else:
            self._input = gui.add_text(label, _text(value), hint=hint)
        self._mistake = gui.add_html('', visible=False)
        self._input.on_update(lambda _: changed())

    @property
    def value(self) -> Any:
        """What stands in the input; what cannot be read stays a text, for validation to say so."""
        raw = self._input.value
        if not isinstance(raw, str):
            return raw
        if self._entry is str:
            return raw.split() if self._several else raw.strip()
        if not self._several:
            return _number(raw, self._entry)
        words = [w for w in re.split(r'[,\s]+', raw.strip(' \t[]')) if w]
        numbers = [_number(word, self._entry) for word in words]
        if len(words) == 1 and isinstance(numbers[0], str):
            return words[0]  # a rule by its name, as of rigid.boundaries
        return numbers

    @value.setter
    def value(self, value: Any) -> None:
        self._input.value = value if self._entry is bool else _text(value)

    def write(self, flat: dict[str, Any]) -> None:
        """Put the value where it belongs; entries of a list are appended in the order of the fields."""
        value = self.value
        if self._span is None:
            flat[self.path] = value
        elif self._several:
            flat.setdefault(self.path, []).extend(value if isinstance(value, list) else [value])
        else:
            flat.setdefault(self.path, []).append(value)

    def concerns(self, mistake: Mistake) -> bool:
        """Whether a mistake is this field's."""
        match = _PLACE.fullmatch(mistake.place)
        if match is None or match['path'] != self.path:
            return False
        return self._span is None or match['first'] is None or int(match['first']) in self._span

    def show(self, mistakes: Sequence[Mistake]) -> None:
        """Show what is wrong, below the input; nothing: all is well."""
        content = mistake_html([m.message for m in mistakes]) if mistakes else ''
        if self._mistake.content != content:
            self._mistake.content = content
            self._mistake.visible = bool(content)

    def remove(self) -> None:
        """Take it off the page."""
        self._input.remove()
        self._mistake.remove()


def mistake_html(messages: Sequence[str]) -> str:
    """Sentences in red."""
    lines = '<br>'.join(html.escape(m) for m in messages)
    return (
        f'<div class="sesa2-mistake" style="color:#c92a2a;font-size:0.8em;margin:0 0.8em 0.4em">{lines}</div>'
    )


def nested(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Values by dotted name as validation wants them; empty lists are left out, as in a file."""
    values: dict[str, Any] = {}
    for path, value in flat.items():
        if value == []:
            continue
        section, _, key = path.rpartition('.')
        (values.setdefault(section, {}) if section else values)[key] = value
    return values


def _entry(kind: Any, span: range | None) -> tuple[type, bool]:
    """Type of a single value, and whether the field holds several."""
    if get_origin(kind) not in (tuple, None):  # a text or a list
        kind = get_args(kind)[1]
    if get_origin(kind) is tuple:
        return get_args(kind)[0], span is None or len(span) > 1
    return kind, False


def _number(word: str, kind: type) -> Any:
    try:
        return kind(word)
    except ValueError:
        return word


def _text(value: Any) -> str:
    if isinstance(value, (tuple, list)):
        return ' '.join(map(_text, value))
    return value if isinstance(value, str) else repr(value)
