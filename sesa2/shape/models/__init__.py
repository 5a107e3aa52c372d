"""The shape models, a file each: a further one is a further file here with a class that has a `name`."""

from importlib import import_module
from pkgutil import iter_modules
from typing import Any

from sesa2.shape.arm import Arm, GeometryError
from sesa2.shape.model import Model


def _registered() -> dict[str, type[Model]]:
    found = {}
    for file in iter_modules(__path__):
        for item in vars(import_module(f'{__name__}.{file.name}')).values():
            if isinstance(item, type) and issubclass(item, Model) and 'name' in vars(item):
                found[item.name] = item
    return found


MODELS: dict[str, type[Model]] = _registered()


def create_model(name: str, arm: Arm, **options: Any) -> Model:
    """Make a model by name.

    Parameters
    ----------
    name
        a key of MODELS.
    arm
        the arm.
    options
        the model's own, as its class lists them.

    Returns
    -------
    The model, ready to fit.

    Raises
    ------
    GeometryError
        no such model, or its options do not fit the arm.
    """
    if name not in MODELS:
        raise GeometryError(f'model {name!r} is not known, expected one of {", ".join(MODELS)}')
    return MODELS[name](arm, **options)
