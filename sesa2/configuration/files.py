"""The configuration's file: a ROS 2 parameter file, in YAML."""

import errno
import os
import sys
from pathlib import Path
from typing import Any

import yaml

from sesa2.configuration.records import Configuration
from sesa2.configuration.validation import ConfigurationError, Mistake, validate
from sesa2.errors import Sesa2Error, shortened
from sesa2.partial_files import partial_path, sweep_partials
from sesa2.yaml_reading import YamlError, read_yaml, read_yaml_file


def find(name: str) -> Path:
    """A configuration's file, by path or by the name of a shipped one.

    Parameters
    ----------
    name
        a path, or for example `prototype3_8`.

    Raises
    ------
    ConfigurationError
        there is no such file; the message lists the shipped ones.
    """
    path = Path(name)
    try:
        path.lstat()
        there, why = True, ''
    except (OSError, ValueError) as error:
        there, why = False, getattr(error, 'strerror', None) or str(error)
    if there and not path.is_dir():
        return path  # whatever it is: `load` says what is wrong with it
    named = shipped()
    if name in named:
        return named[name]
    if there:
        raise ConfigurationError([Mistake('', 'is a folder, expected a file')], name)
    known = ', '.join(named) or 'none'
    what = 'no such file' if why == os.strerror(errno.ENOENT) else f'cannot be read: {why}'
    mistake = Mistake('', f'{what}, nor a shipped configuration (there are: {known})')
    raise ConfigurationError([mistake], shortened(name))


def shipped() -> dict[str, Path]:
    """The shipped configurations by name."""
    return {p.stem: p for folder in _shipped_folders() for p in sorted(folder.glob('*.yaml'))}


def origin(name: str) -> Path:
    """The file beside which what becomes of a configuration is saved: of a shipped one, as if it were in this folder.

    Parameters
    ----------
    name
        as `find` takes it.
    """
    path = find(name)
    return path.resolve() if path == Path(name) else Path.cwd() / path.name


def _shipped_folders() -> list[Path]:
    """Beside the package in a checkout; under share/ once installed by pip or colcon."""
    package = Path(__file__).resolve().parents[1]
    candidates = [package.parent / 'config', Path(sys.prefix) / 'share/sesa2/config']
    candidates += [folder / 'share/sesa2/config' for folder in package.parents]
    return [folder for folder in candidates if folder.is_dir()][:1]


def load(path: str | Path) -> Configuration:
    """Read and validate a file.

    Raises
    ------
    ConfigurationError
        it is no file or cannot be read, is not YAML, or holds mistakes.
    """
    source = str(path)
    try:
        document = read_yaml_file(path)
    except YamlError as error:
        raise _not_read(error, source) from None
    return validate(_parameters(document, source), source)


def load_configuration(name: str | Path) -> Configuration:
    """Read and validate a configuration, by the path of its file or by the name of a shipped one.

    Parameters
    ----------
    name
        a path, or for example `prototype3_8`.

    Raises
    ------
    ConfigurationError
        there is none, it is not YAML, or it holds mistakes: all of them are in the message, each with its place.
    """
    return load(find(str(name)))


def parse(text: str, source: str) -> Configuration:
    """Read and validate YAML.

    Parameters
    ----------
    text
        YAML, as `dump` writes it.
    source
        where it is from, for messages.

    Raises
    ------
    ConfigurationError
        it is not YAML, or holds mistakes.
    """
    try:
        document = read_yaml(text)
    except YamlError as error:
        raise _not_read(error, source) from None
    return validate(_parameters(document, source), source)


def _not_read(error: YamlError, source: str) -> ConfigurationError:
    problem = f'YAML: {error.problem}' if error.place else error.problem
    return ConfigurationError([Mistake(error.place, problem)], source)


def _parameters(document: Any, source: str) -> dict[str, Any]:
    expected = "expected '/**:' and under it 'ros__parameters:'"
    if not isinstance(document, dict):
        raise ConfigurationError([Mistake('', f'got {type(document).__name__}, {expected}')], source)
    mistakes = [
        Mistake(
            shortened(str(key)),
            f"is not read, {expected}; parameters of one node alone go on that node's command line",
        )
        for key in document
        if key != '/**'
    ]
    node = document.get('/**')
    if mistakes or not isinstance(node, dict) or not isinstance(node.get('ros__parameters'), dict):
        raise ConfigurationError(mistakes or [Mistake('', expected)], source)
    extra = [
        Mistake(f'/**.{shortened(str(key))}', f'is not read, {expected}')
        for key in node
        if key != 'ros__parameters'
    ]
    if extra:
        raise ConfigurationError(extra, source)
    return node['ros__parameters']


def dump(configuration: Configuration) -> str:
    """The configuration as YAML that `load` and ROS read back.

    Empty lists are left out, since ROS cannot read them.
    """
    values: dict[str, Any] = {}
    for path, value in configuration.flat().items():
        section, _, name = path.rpartition('.')
        if value != ():
            (values.setdefault(section, {}) if section else values)[name] = _plain(value)
    return yaml.dump(
        {'/**': {'ros__parameters': values}}, Dumper=_Dumper, sort_keys=False, width=120, allow_unicode=True
    )


def save(path: Path, text: str, instead_of: str = '') -> None:
    """Write a new file, whole or not at all.

    Parameters
    ----------
    path
        of the file; what is there is never lost.
    text
        what `dump` gives.
    instead_of
        a file that holds just this may be replaced.

    Raises
    ------
    Sesa2Error
        there is another file, or it cannot be written.
    """
    beside = partial_path(path)
    sweep_partials(path)
    try:
        if path.exists() and path.read_text('utf-8') != instead_of:
            raise Sesa2Error(f'{path} is there already and was not saved by this node; move it away first')
        beside.write_text(text, encoding='utf-8')
        beside.replace(path)
    except (OSError, UnicodeDecodeError) as error:
        beside.unlink(missing_ok=True)
        raise Sesa2Error(f'{path}: cannot be written: {getattr(error, "strerror", None) or error}') from None


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


class _Dumper(yaml.SafeDumper):
    """Lists on one line; numbers with a point: `1e-05` is a text to YAML 1.1, and an integer is no number to ROS."""


_Dumper.add_representer(
    list, lambda dumper, v: dumper.represent_sequence('tag:yaml.org,2002:seq', v, flow_style=True)
)


def _represent_float(dumper: yaml.SafeDumper, value: float) -> yaml.Node:
    text = repr(value)
    if 'e' in text and '.' not in text:
        text = text.replace('e', '.0e')
    return dumper.represent_scalar('tag:yaml.org,2002:float', text)


_Dumper.add_representer(float, _represent_float)
