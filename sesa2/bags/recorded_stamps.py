"""When recorded samples were measured: as their messages say or, where they do not, when they were recorded."""

from collections import Counter

import numpy as np

from sesa2.errors import Sesa2Error
from sesa2.messages.header_bytes import read_stamp, with_stamp


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
        """What stood in, for people."""
        if self._arrival or not self.unstamped:
            return []
        ids, n = ', '.join(map(str, sorted(self.unstamped))), self.unstamped.total()
        return [f'IMU {ids}: {n} messages have no stamp (0); the time of their recording stands in']
