"""Which body of a recording is which marker or IMU of ours."""

import re
from collections.abc import Collection, Mapping, Sequence

from sesa2.mocap.capture import MocapError

_MOST = 30  # names in a message


def find_bodies(
    there: Collection[str], wanted: Sequence[str], given: Mapping[str, str] | None = None, where: str = ''
) -> dict[str, str]:
    """Find ours among the bodies of a recording.

    A body is ours that has its name, else that has it behind a prefix (`Arm:M1`, `rig/M1`), else whatever its case.

    Parameters
    ----------
    there
        names in the recording.
    wanted
        names of ours.
    given
        ours → theirs, where the names differ.
    where
        the recording, for messages.

    Returns
    -------
    ours → theirs, of those that are there.

    Raises
    ------
    MocapError
        two bodies could be meant, a given name is not there or not of ours, or nothing is found.
    """
    given = dict(given or {})
    unknown = [name for name in given if name not in wanted]
    if unknown:
        raise MocapError(f'no marker is called {unknown[0]}, expected one of {", ".join(wanted)}')
    found = {}
    for name in wanted:
        asked = given.get(name, name)
        fitted = ([body for body in there if rule(body, asked)] for rule in _RULES)
        fitting = next(filter(None, fitted), [])
        if len(fitting) > 1:
            raise MocapError(
                f'{where}: {name} may be {" or ".join(fitting)}; say which: --marker {name}={fitting[0]}'
            )
        if fitting:
            found[name] = fitting[0]
        elif name in given:
            raise MocapError(f'{where}: no body is called {asked}; there are {listed(there)}')
    if not found and len(wanted) == len(there) == 1:
        found = {wanted[0]: next(iter(there))}
    if not found:
        raise MocapError(
            f'{where}: none of {", ".join(wanted)} is in it; there are {listed(there)}. '
            f'Where the names differ: --marker {wanted[0]}=NAME'
        )
    return found


def told_apart(names: Sequence[str]) -> list[str]:
    """Names of which those that were there before get a number behind: M1, M2, `M1 (2)`."""
    return [numbered(name, names[:k].count(name)) for k, name in enumerate(names)]


def numbered(name: str, before: int) -> str:
    """A name that so many had before."""
    return f'{name} ({before + 1})' if before else name


def place_column(bodies: dict[str, dict[str, int]], name: str, part: str, column: int) -> None:
    """Give a column to the first body of a name that lacks this component; where none does, to a further one."""
    before = 0
    while part in bodies.setdefault(numbered(name, before), {}):
        before += 1
    bodies[numbered(name, before)][part] = column


def about_namesakes(names: Collection[str], where: str) -> list[str]:
    """What has to be said where several bodies had one name, for people."""
    first = [name.removesuffix(' (2)') for name in names if name.endswith(' (2)')]
    return [
        f'{where}: several bodies are called {name}; the first was taken, the next is {name} (2)'
        for name in first
        if name in names
    ]


def listed(names: Collection[str]) -> str:
    """Names for a message."""
    more = f' and {len(names) - _MOST} more' if len(names) > _MOST else ''
    return (', '.join(list(names)[:_MOST]) or 'none') + more


def _without_prefix(body: str) -> str:
    return re.split('[:/]', body)[-1].strip()


def _same(body: str, asked: str) -> bool:
    return body == asked


def _behind_prefix(body: str, asked: str) -> bool:
    return _without_prefix(body) == asked


def _whatever_case(body: str, asked: str) -> bool:
    return asked.lower() in (body.lower(), _without_prefix(body).lower())


_RULES = (_same, _behind_prefix, _whatever_case)
