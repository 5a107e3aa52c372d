"""The shape models, a file each: a further one is a further file here, or anywhere, with a class that has a `name`."""

from dataclasses import fields
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

from sesa2.shape.arm import GeometryError
from sesa2.shape.layout import Layout
from sesa2.shape.model import MODELS, Model

__all__ = ['MODELS', 'create_model']

for _file in iter_modules(__path__):
    import_module(f'{__name__}.{_file.name}')


def create_model(name: str, layout: Layout, **options: Any) -> Model[Any]:
    """Make a model by name.

    Parameters
    ----------
    name
        a key of MODELS.
    layout
        the arm and where its sensors sit.
    options
        fields of the model's `Options`; the others keep their defaults.

    Returns
    -------
    The model, ready to fit.

    Raises
    ------
    GeometryError
        no such model, no such option, or options that do not fit the arm.
    """
    if name not in MODELS:
        raise GeometryError(f'model {name!r} is not known, expected one of {", ".join(MODELS)}')
    model = MODELS[name]
    known = {field.name for field in fields(model.Options)}
    if unknown := sorted(set(options) - known):
        raise GeometryError(
            f'model {name!r} has no option {unknown[0]!r}, expected some of {", ".join(sorted(known)) or "none"}'
        )
    return model(layout, model.Options(**options).filled(layout.n_imu))
