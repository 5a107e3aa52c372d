"""What a motion capture system recorded, whatever it was written by."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from sesa2.errors import Sesa2Error, shown
from sesa2.shape.rotations import FloatArray

# Metres in one, by the names that exports give it.
LENGTH_UNITS: Mapping[str, float] = {
    'm': 1.0, 'meter': 1.0, 'meters': 1.0, 'metre': 1.0, 'metres': 1.0,
    'mm': 1e-3, 'millimeter': 1e-3, 'millimeters': 1e-3, 'millimetre': 1e-3, 'millimetres': 1e-3,
    'cm': 1e-2, 'centimeter': 1e-2, 'centimeters': 1e-2, 'centimetre': 1e-2, 'centimetres': 1e-2,
    'in': 0.0254, 'inch': 0.0254, 'inches': 0.0254,
    'ft': 0.3048, 'foot': 0.3048, 'feet': 0.3048,
}  # fmt: skip


class MocapError(Sesa2Error):
    """An export that cannot be read."""


@dataclass(frozen=True, eq=False)
class TrackedBody:
    """A marker or a rigid body over time.

    Attributes
    ----------
    times : (n,)
        s, any origin, in the order of the recording.
    positions : (n, 3)
        x y z, m; NaN where it was not seen. None of a body that has orientations alone.
    orientations : (n, 4)
        x y z w, from the body into the recording's frame; NaN where it was not seen. None of a marker.
    frame
        in which it is, empty where that is not known.
    """

    times: FloatArray
    positions: FloatArray | None
    orientations: FloatArray | None = None
    frame: str = ''


@dataclass(frozen=True, eq=False)
class MotionCapture:
    """A recording.

    Attributes
    ----------
    kind
        what wrote it, e.g. `Motive CSV`.
    bodies
        by name, as the recording calls them.
    notes
        what a reader has to know, one sentence each.
    axes
        what is to be known of its axes unless a rotation is fitted, a sentence; empty where there is nothing.
    """

    kind: str
    bodies: Mapping[str, TrackedBody]
    notes: tuple[str, ...] = field(default=())
    axes: str = ''


def metres_in(unit: str, where: str) -> float:
    """How many metres one of a unit of length has.

    Raises
    ------
    MocapError
        no such unit is known.
    """
    try:
        return LENGTH_UNITS[unit.strip().strip('[]()').lower()]
    except KeyError:
        raise MocapError(f'{where}: unit of length {shown(unit)}, expected m, mm, cm, in or ft') from None
