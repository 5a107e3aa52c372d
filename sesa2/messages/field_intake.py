"""What magnetometers in the arm measured, out of their messages, live and in recordings alike."""

import math
from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.messages.field_messages import read_field

_NAN = math.nan


class FieldSample(NamedTuple):
    """A field, x, y, z, T, in the sensor's axes, at a stamp, ns; NaN on axes that the sensor has not.

    Where one that it has is not a finite number, all are NaN.
    """

    stamp_ns: int
    field: tuple[float, float, float]


class FieldIntake:
    """Reads messages of magnetometers.

    Parameters
    ----------
    axes
        of its own that each measures along, z or xyz, by id.

    Attributes
    ----------
    unreadable
        number of messages of each id that were no whole sensor_msgs/MagneticField.
    """

    def __init__(self, axes: Mapping[int, str]):
        self._only_z = {id_ for id_, of in axes.items() if of == 'z'}
        self.unreadable: Counter[int] = Counter()

    @classmethod
    def of(cls, c: Configuration) -> 'FieldIntake':
        """As a configuration has them."""
        ids, axes = c.magnetometers.ids, c.magnetometers.axes
        return cls(dict(zip(ids, axes * len(ids) if len(axes) == 1 else axes, strict=True)))

    def take(self, magnetometer: int, data: bytes) -> FieldSample | None:
        """Take a sensor_msgs/MagneticField in CDR; None, and counted, where it is none."""
        try:
            stamp_ns, field = read_field(data)
        except Sesa2Error:
            self.unreadable[magnetometer] += 1
            return None
        x, y, z = field.tolist()
        if magnetometer in self._only_z:
            return FieldSample(stamp_ns, (_NAN, _NAN, z if math.isfinite(z) else _NAN))
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            return FieldSample(stamp_ns, (_NAN, _NAN, _NAN))
        return FieldSample(stamp_ns, (x, y, z))
