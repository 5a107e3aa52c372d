"""YAML from people: files, parameters and messages. Whatever they hold, there is a document or a `YamlError`.

YAML can do more than plain values, and some of that does harm: what is written in a few lines can be without end
once its aliases are followed. So a text is limited in size, depth and number of values before any is made.
"""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from sesa2.errors import Sesa2Error, shortened, shown
from sesa2.regular_files import why_no_regular_file

# Without waiting, should the file have become a pipe meanwhile; neither flag is there on every system.
_READ = os.O_RDONLY | getattr(os, 'O_NONBLOCK', 0) | getattr(os, 'O_BINARY', 0)

# A configuration of eight IMUs with everything has 4 levels, 300 values and 5 KiB.
MAX_BYTES = 1 << 18
MAX_DEPTH = 20
MAX_VALUES = 10_000
_MAX_NUMBER = 100  # characters; a text may be longer

_KINDS = {'int': 'integer', 'float': 'number', 'timestamp': 'date; quote it where it is a text'}
_NUMBERS = frozenset(f'tag:yaml.org,2002:{kind}' for kind in _KINDS)
_MERGE = 'tag:yaml.org,2002:merge'
# Controls but tabulators and ends of line, and halves of characters: no path, no terminal and no message takes them.
_NO_TEXT = re.compile('[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x84\x86-\x9f\ud800-\udfff]')


class YamlError(Sesa2Error):
    """A text that is no YAML, or more than is read here.

    Attributes
    ----------
    place
        line and column, from 1; empty where it is about the whole.
    problem
        what is wrong there.
    """

    def __init__(self, problem: str, place: str = ''):
        self.problem, self.place = shortened(problem, 300), place
        super().__init__(f'{place}: {self.problem}' if place else self.problem)


def read_yaml(text: str | bytes) -> Any:
    """The document in a text.

    Parameters
    ----------
    text
        YAML 1.1; bytes are UTF-8.

    Returns
    -------
    Mappings, lists, texts, numbers, truth values, dates and None; in a mapping every key stands once.

    Raises
    ------
    YamlError
        it is no YAML, is too large or too deep, contains itself, or has a key that is a list or stands twice.
    """
    if len(text) > MAX_BYTES:
        raise YamlError(f'is longer than {MAX_BYTES // 1024} KiB')
    if isinstance(text, bytes):
        try:
            text = text.decode('utf-8-sig')
        except UnicodeDecodeError as error:
            before = error.object[: error.start].decode()
            raise YamlError('is not text in UTF-8', _place(before)) from None
    try:
        loader = _Loader(text)
    except yaml.reader.ReaderError as error:  # it is checked as a whole
        problem = f'the character {text[error.position]!a} is not allowed in YAML'
        raise YamlError(problem, _place(text[: error.position])) from None
    try:
        with _located(loader):
            node = loader.get_single_node()
            return None if node is None else loader.construct_document(node)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        raise YamlError(error.problem or str(error), _of(mark) if mark else '') from None
    finally:
        loader.dispose()


def read_yaml_file(path: str | Path) -> Any:
    """The document in a file; see `read_yaml` and `read_small_file`."""
    return read_yaml(read_small_file(path))


def read_small_file(path: str | Path) -> bytes:
    """What is in a file of a size that `read_yaml` takes; of a larger one, a byte more than that.

    Raises
    ------
    YamlError
        it cannot be read, or is no regular file: a pipe would have its reader wait without end.
    """
    if why := why_no_regular_file(path):
        raise YamlError(why)
    try:
        with open(os.open(path, _READ), 'rb') as file:  # noqa: PTH123
            return file.read(MAX_BYTES + 1)
    except OSError as error:
        raise YamlError(f'cannot be read: {error.strerror}') from None


def _of(mark: Any) -> str:
    return f'line {mark.line + 1}, column {mark.column + 1}'


def _place(before: str) -> str:
    """The place at the end of a text."""
    lines = before.split('\n')
    return f'line {len(lines)}, column {len(lines[-1]) + 1}'


@contextmanager
def _located(loader: 'yaml.SafeLoader', node: yaml.Node | None = None) -> Iterator[None]:
    """PyYAML lets through what Python says to an impossible date or `!!int x`; it gets its place here."""
    try:
        yield
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as error:
        if node is None:
            raise yaml.MarkedYAMLError(
                problem=f'cannot be read: {error}', problem_mark=loader.get_mark()
            ) from None
        kind = node.tag.rpartition(':')[2]
        raise _refused(f'{shown(node.value)} is no {_KINDS.get(kind, kind)}', node) from None


class _Loader(yaml.SafeLoader):
    """Counts while it reads, so that it ends soon whatever comes; refuses what would silently be lost."""

    def __init__(self, text: str):
        super().__init__(text)
        self._depth = 0
        self._sizes: dict[yaml.Node, int] = {}  # number of values in each, aliases followed
        self._n_values = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event = self.peek_event()
        if self._depth >= MAX_DEPTH:
            raise _refused(f'is nested deeper than {MAX_DEPTH} levels', event)
        self._depth += 1
        before = self._n_values
        node = super().compose_node(parent, index)
        self._depth -= 1
        if isinstance(event, yaml.AliasEvent):
            # What is named is not yet whole: it is around this place.
            if node not in self._sizes:
                raise _refused(
                    f'*{event.anchor} stands within what it names, and so would have no end', event
                )
            self._n_values += self._sizes[node]
        else:
            self._n_values += 1
            if node is not None:
                self._sizes[node] = self._n_values - before
        if self._n_values > MAX_VALUES:
            raise _refused(f'has more than {MAX_VALUES} values', event)
        return node

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """YAML keeps the last of two equal keys without a word; here that is a mistake."""
        node = super().compose_mapping_node(anchor)
        seen = set()
        for key_node, _ in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                kind = 'list' if isinstance(key_node, yaml.SequenceNode) else 'mapping'
                template = '; is this a {{ template }} that was not filled in?' if kind == 'mapping' else ''
                raise _refused(f'a {kind} as a key, expected a text or a number{template}', key_node)
            if key_node.tag == _MERGE:
                raise _refused('<< is not read here; write out the keys that it stands for', key_node)
            key = self.construct_object(key_node)
            if key in seen:
                raise _refused(f'the key {shown(key)} stands here a second time', key_node)
            seen.add(key)
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if isinstance(node, yaml.ScalarNode):
            if node.tag in _NUMBERS and len(node.value) > _MAX_NUMBER:
                raise _refused(
                    f'a number of {len(node.value)} characters, expected at most {_MAX_NUMBER}', node
                )
            if found := _NO_TEXT.search(node.value):
                raise _refused(f'the character {found[0]!a} in a text cannot be written anywhere', node)
        with _located(self, node):
            return super().construct_object(node, deep)


def _refused(problem: str, at: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=at.start_mark)
