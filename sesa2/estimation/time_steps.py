"""Stamps that step into another time: a glitch of one clock, a bag that loops, a clock that was set."""

from collections import deque
from typing import NamedTuple

from sesa2.time import NS

# A step back by more than this is another time, less is a late or repeated sample.
BACK_NS = NS
# A step ahead by more than this is doubtful; less is a pause, as of a link that was cut.
AHEAD_NS = 10 * NS
# A step that is longer than any recording is believed when it has lasted for so long.
_LASTING_NS = NS
_YEAR_NS = 365 * 86_400 * NS
# Samples that are held of one IMU; what is older is let go.
HELD_MAX = 2000


class HeldSample(NamedTuple):
    """A sample as it came; its arrival is None where there is no clock."""

    imu: int
    stamp_ns: int
    x: float
    y: float
    z: float
    w: float
    arrival_ns: int | None


class TimeSteps:
    """Holds samples of another time, until it is known whether time has stepped or an IMU's clock is wrong."""

    def __init__(self) -> None:
        self._held: dict[int, deque[HeldSample]] = {}
        self._since_ns: dict[int, int] = {}
        self._ahead: dict[int, bool] = {}

    def __contains__(self, index: int) -> bool:
        return index in self._held

    def __len__(self) -> int:
        return len(self._held)

    def hold(self, sample: HeldSample, newest_ns: int) -> list[HeldSample]:
        """Keep a sample; those that are let go for it.

        Parameters
        ----------
        sample
            of another time.
        newest_ns
            the present time, ns.
        """
        index, ahead = sample.imu, sample.stamp_ns > newest_ns
        gone: list[HeldSample] = []
        if index in self._held:
            last_ns = self._held[index][-1].stamp_ns
            if self._ahead[index] != ahead or not 0 < sample.stamp_ns - last_ns <= AHEAD_NS:
                gone = self.drop(index)
        held = self._held.setdefault(index, deque())
        self._since_ns.setdefault(index, sample.stamp_ns)
        self._ahead[index] = ahead
        held.append(sample)
        if len(held) > HELD_MAX:
            gone.append(held.popleft())
        return gone

    def drop(self, index: int) -> list[HeldSample]:
        """Forget what is held of an IMU."""
        self._since_ns.pop(index, None)
        return list(self._held.pop(index, ()))

    def others_go_on(self) -> None:
        """A sample of the present time has come."""
        for index, held in self._held.items():
            self._since_ns[index] = held[-1].stamp_ns

    def believed(self, index: int, newest_ns: int, n_alive: int, *, begun: bool) -> list[HeldSample]:
        """All that is held, in order of arrival, if the step of this IMU is to be believed; else nothing.

        It is when most of the living IMUs made it, or when nothing of the present time has come for a second of the
        stamps. A step of years has to last in any case, but before the first sweep.
        """
        ahead = self._ahead[index]
        stepped = [i for i in self._held if self._ahead[i] == ahead]
        lasting = any(self._held[i][-1].stamp_ns - self._since_ns[i] >= _LASTING_NS for i in stepped)
        most = 2 * len(stepped) > n_alive
        of_years = abs(self._held[index][-1].stamp_ns - newest_ns) > _YEAR_NS
        if not (lasting or (most and not (of_years and begun))):
            return []
        return [sample for i in stepped for sample in self.drop(i)]


def step_in_words(stamp_ns: int, newest_ns: int) -> str:
    """Why a sample that was held is not used."""
    years = round(abs(stamp_ns - newest_ns) / _YEAR_NS)
    how_far = f'{years} years' if years > 1 else 'a year' if years else 'long'
    return f'stamped {how_far} {"before" if stamp_ns < newest_ns else "after"} the rest'
