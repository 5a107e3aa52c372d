"""What can be set: fields that say their default, meaning and range, and the options of models made of them."""

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

REQUIRED = ()  # a list that is not given and has no default of its own is filled in by validation, or missed there


def parameter(
    default: Any,
    meaning: str,
    *,
    low: float | None = None,
    high: float | None = None,
    above: float | None = None,
    choices: Collection[Any] = (),
) -> Any:
    """A field of a record.

    Parameters
    ----------
    default
        its value where nothing is said.
    meaning
        for people, with the unit.
    low, high
        bounds, inclusive, of a number or of each entry of a list.
    above
        bound, exclusive.
    choices
        allowed values, of it or of each entry.
    """
    return field(
        default=default,
        metadata={'meaning': meaning, 'low': low, 'high': high, 'above': above, 'choices': choices},
    )


@dataclass(frozen=True)
class ModelOptions:
    """What a shape model can be told; each model extends it by fields of its own.

    In the configuration they stand in a section of the model's name, but for those that have the name of a parameter of
    the whole configuration, such as `links`: these are that parameter.
    """

    def filled(self, n_imu: int) -> 'ModelOptions':
        """The same with lists that were left empty filled in, for an arm of so many IMUs."""
        del n_imu
        return self


@dataclass(frozen=True)
class LinkOptions(ModelOptions):
    """Options of a model whose backbone is a curve."""

    links: int = parameter(64, 'links that stand for a curve on the ROS graph', low=1, high=1000)
