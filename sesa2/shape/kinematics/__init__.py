"""Families of shapes with coordinates, a file each: a further one is a further file with a class that has a `name`."""

from abc import ABCMeta
from importlib import import_module
from pkgutil import iter_modules

from numpy.typing import ArrayLike

from sesa2.shape.arm import GeometryError
from sesa2.shape.kinematics.kinematics import Kinematics


def _registered() -> dict[str, type[Kinematics]]:
    found = {}
    for file in iter_modules(__path__):
        for item in vars(import_module(f'{__name__}.{file.name}')).values():
            if isinstance(item, ABCMeta) and issubclass(item, Kinematics) and 'name' in vars(item):
                found[item.name] = item
    return found


KINEMATICS: dict[str, type[Kinematics]] = _registered()


def create_kinematics(name: str, segment_lengths: ArrayLike) -> Kinematics:
    """Make a family by name.

    Parameters
    ----------
    name
        a key of KINEMATICS.
    segment_lengths : (m,)
        lengths of the segments at rest, base to tip, m.

    Returns
    -------
    The family, bound to these segments.

    Raises
    ------
    GeometryError
        no such family, or a length is not a positive number.
    """
    if name not in KINEMATICS:
        raise GeometryError(f'kinematics {name!r} is not known, expected one of {", ".join(KINEMATICS)}')
    return KINEMATICS[name](segment_lengths)
