"""When recorded samples were measured: as their messages say or, where they do not, when they were recorded."""

from collections import Counter, defaultdict

import numpy as np

from sesa2.errors import Sesa2Error
from sesa2.messages.header_bytes import read_stamp, with_stamp
from sesa2.time import NS

_LOOKED_AT = 10_000  # samples that tell how stamps step
_ENOUGH = 50
_REPEATED = 0.6  # of the steps: more than messages that come twice make
# Between units lies a factor of 1000; recordings are played faster or slower by less than this.
_FACTOR = 20.0


class RecordedStamps:
    """Gives messages of IMUs the time of their recording where they have none of their own.

    Parameters
    ----------
    arrival
        whether the time of recording is taken for all of them (`imus.stamps`).

    Attributes
    ----------
    unstamped
        number of messages of each id that had none; complete after reading.
    """

    def __init__(self, arrival: bool = False):
        self._arrival = arrival
        self.unstamped: Counter[int] = Counter()
        self._seen: defaultdict[int, list[np.ndarray]] = defaultdict(list)  # stamps and times of recording
        self._n_seen = 0

    def complete(self, ids: np.ndarray, stamps_ns: np.ndarray, log_ns: np.ndarray, data: list[bytes]) -> None:
        """Fill in, in place.

        Parameters
        ----------
        ids : (n,)
            of the IMUs.
        stamps_ns : (n,)
            0 where there is none, ns.
        log_ns : (n,)
            when each was recorded, ns.
        data
            the messages, in CDR; long enough for a stamp where it is given another one.
        """
        if self._n_seen < _LOOKED_AT:
            self._n_seen += len(ids)
            for imu in np.unique(ids).tolist():
                own = ids == imu
                self._seen[imu].append(np.stack([stamps_ns[own], log_ns[own]]))
        without = (stamps_ns == 0) & (log_ns != 0)  # a recording may begin at 0
        if without.any():
            self.unstamped.update(ids[without].tolist())
        for k in np.flatnonzero(without | self._arrival).tolist():
            stamps_ns[k] = log_ns[k]
            data[k] = with_stamp(data[k], int(log_ns[k]))

    def of_field(self, data: bytes, log_ns: int) -> bytes:
        """A message of a magnetometer beside an IMU, with what stands in for its stamp; damaged ones as they are."""
        try:
            without = self._arrival or not read_stamp(data)
        except Sesa2Error:
            return data
        return with_stamp(data, log_ns) if without else data

    @property
    def problems(self) -> list[str]:
        """What stood in, and stamps that are no times of these messages, for people."""
        if self._arrival:
            return []
        problems = []
        if self.unstamped:
            ids, n = ', '.join(map(str, sorted(self.unstamped))), self.unstamped.total()
            problems.append(
                f'IMU {ids}: {n} messages have no stamp (0); the time of their recording stands in'
            )
        told: defaultdict[str, list[int]] = defaultdict(list)
        for imu in sorted(set(self._seen) - set(self.unstamped)):
            step, apart = _steps(np.hstack(self._seen[imu]))
            if apart and not apart / _FACTOR < step < apart * _FACTOR:
                told[f'step by {step:.2g} s and its messages came every {apart:.2g} s'].append(imu)
        problems += [
            f'IMU {", ".join(map(str, ids))}: its stamps {what}: stamps in another unit, or of something else? '
            'imus.stamps: arrival takes the time of recording'
            for what, ids in told.items()
        ]
        return problems


def _steps(seen: np.ndarray) -> tuple[float, float]:
    """How stamps step and how far apart messages came, s; the latter is 0 where that cannot be told."""
    steps, log_ns = np.diff(seen[0]), seen[1]
    took = float(log_ns[-1] - log_ns[0]) / NS
    if len(steps) < _ENOUGH or took <= 0.0:
        return 0.0, 0.0
    moved = steps[steps != 0]
    step = 0.0 if len(moved) < (1.0 - _REPEATED) * len(steps) else float(np.median(moved)) / NS
    return step, took / (len(moved) if step else len(steps))
