"""The unit of a column of times that does not say it, or says it wrongly."""

import re
from typing import NamedTuple

import numpy as np

from sesa2.mocap.capture import MocapError
from sesa2.shape.rotations import FloatArray

# How a column of time is called, and its unit.
TIME_COLUMN = re.compile(
    r'(?:time|timestamp|t|zeit|temps|tiempo|tempo)(?:\s*[_ (\[]\s*(s|sec|seconds|ms|us|µs|ns)\s*[)\]]?)?',
    re.IGNORECASE,
)
TIME_UNITS = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'µs': 1e-6, 'ns': 1e-9}  # seconds in one
_NAMES = {1e-3: 'milliseconds', 1e-6: 'microseconds', 1e-9: 'nanoseconds'}
# Orientations and positions of an arm are taken 2 to 2000 times a second. That is a factor of 1000, as between units.
_LONGEST_STEP = 0.5  # s
# Slow recordings are in seconds, and then tell little: with fewer samples than this nobody counts frames either.
_FEW = 20
_SLOWEST_STEP = 5.0  # s


class TimesInSeconds(NamedTuple):
    """Times, s, and what has to be said of their unit."""

    times: FloatArray
    notes: tuple[str, ...]


def in_seconds(times: FloatArray, column: str, where: str) -> TimesInSeconds:
    """Times that are said to be seconds, in seconds.

    Parameters
    ----------
    times : (n,)
        as the file has them.
    column, where
        for messages.

    Raises
    ------
    MocapError
        they step by whole numbers that may be anything.
    """
    steps = np.diff(times)
    steps = steps[steps > 0.0]
    step = float(np.median(steps)) if len(steps) else 0.0
    if step <= _LONGEST_STEP:
        return TimesInSeconds(times, ())
    if step <= _SLOWEST_STEP:
        if len(times) >= _FEW and step >= 1.0 and (times == np.round(times)).all() and np.ptp(steps) == 0.0:
            raise MocapError(
                f'{where}: {column} steps by {step:g}, always: frames? milliseconds? Expected seconds, or the column '
                f'time_ms, or frame with the rate of the frames'
            )
        return TimesInSeconds(times, ())
    unit = next(u for u in (1e-3, 1e-6, 1e-9) if step * u <= _LONGEST_STEP or u == 1e-9)
    if step * unit > _SLOWEST_STEP:
        raise MocapError(
            f'{where}: {column} steps by {step:.4g}, which is no time of a recording in any unit'
        )
    note = f'{where}: {column} steps by {step:.4g}: it is in {_NAMES[unit]}, and was converted to seconds'
    return TimesInSeconds(times * unit, (note,))
