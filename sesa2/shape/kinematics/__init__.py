"""Families of shapes with coordinates, a file each: a further one is a further file with a class that has a `name`."""

from importlib import import_module
from pkgutil import iter_modules
from typing import Any

from numpy.typing import ArrayLike

from sesa2.shape.arm import GeometryError
from sesa2.shape.kinematics.coordinates import KINEMATICS, Kinematics

__all__ = ['KINEMATICS', 'create_kinematics']

for _file in iter_modules(__path__):
    import_module(f'{__name__}.{_file.name}')


def create_kinematics(name: str, segment_lengths: ArrayLike) -> Kinematics[Any]:
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
