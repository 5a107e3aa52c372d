"""A colour for each model, so that several can be told apart: the same in RViz and on the page."""

from collections.abc import Sequence
from itertools import cycle

Colour = tuple[int, int, int]

_KNOWN: dict[str, Colour] = {
    'rigid': (31, 119, 180),
    'pcc': (255, 127, 14),
    'pcc_exact': (44, 160, 44),
    'spline': (214, 39, 40),
}
_FURTHER: tuple[Colour, ...] = ((148, 103, 189), (140, 86, 75), (23, 190, 207))


def model_colours(models: Sequence[str]) -> dict[str, Colour]:
    """A colour for each of a configuration's models: red, green and blue, 0 to 255."""
    further = cycle(_FURTHER)
    return {name: _KNOWN.get(name) or next(further) for name in models}
