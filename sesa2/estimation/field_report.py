"""What is wrong with magnetometers, and what they do not tell, gathered over estimates and put into words."""

from collections import Counter, defaultdict
from collections.abc import Sequence

import numpy as np

from sesa2.configuration import Configuration
from sesa2.estimation.estimator import Estimate
from sesa2.shape.models.magnetic import MagneticBackbone
from sesa2.shape.reading_faults import ReadingFault

LOST = 'no shape explains what the magnetometers read'
DOUBTFUL = 'the magnetometers contradict each other, and no choice of few of them explains it'

FAULTS_IN_WORDS = {
    ReadingFault.SILENT: 'silent, or zero to the last bit',
    ReadingFault.SATURATED: 'saturated: beyond magnetometers.range',
    ReadingFault.REPEATING: 'stuck: repeats its last reading while others move',
    ReadingFault.JUMPING: 'jumping: not what the others and the instants before say',
    ReadingFault.DOUBTED: 'one of several that contradict each other, which of them cannot be told; all left out',
}


class FieldReport:
    """Gathers, for one configuration.

    Attributes
    ----------
    n, n_lost, n_doubtful
        number of sweeps of a model, those without a shape, and those whose readings contradict each other; by model.
    """

    def __init__(self, configuration: Configuration):
        section = configuration.magnetometers
        self._used = [i for i in section.ids if i not in section.masked]
        self.clear()

    def clear(self) -> None:
        """Begin anew."""
        self.n: Counter[str] = Counter()
        self.n_lost: Counter[str] = Counter()
        self.n_doubtful: Counter[str] = Counter()
        self._faults: dict[int, Counter[ReadingFault]] = defaultdict(Counter)
        self._untold: dict[str, str] = {}

    def add(self, estimate: Estimate) -> None:
        """Look at what the models made of some sweeps."""
        for name, backbone in estimate.backbones.items():
            if not isinstance(backbone, MagneticBackbone):
                continue
            n = len(backbone.faults)
            self.n[name] += n
            self.n_lost[name] += 0 if backbone.lost is None else int(np.count_nonzero(backbone.lost))
            self.n_doubtful[name] += int(np.count_nonzero(backbone.doubtful))
            for fault in FAULTS_IN_WORDS:
                for k in np.flatnonzero((backbone.faults == fault).any(axis=0)).tolist():
                    self._faults[self._used[k]][fault] += int(
                        np.count_nonzero(backbone.faults[:, k] == fault)
                    )
            self._untold[name] = '; '.join(
                f'{_listed(each.names)}: {100 * each.left:.0f} % of what was unknown is left'
                for each in backbone.untold()
            )

    def faults(self, magnetometer: int) -> Counter[ReadingFault]:
        """How many sweeps found what is wrong with a magnetometer."""
        return self._faults.get(magnetometer, Counter())

    def untold(self, model: str) -> str:
        """What the readings of the last sweep did not tell, in words; empty where they told all."""
        return self._untold.get(model, '')

    @property
    def lines(self) -> list[str]:
        """All of it, for people."""
        lines = []
        for magnetometer, faults in sorted(self._faults.items()):
            for fault, count in faults.items():
                lines.append(
                    f'magnetometer {magnetometer}: left out of {count} of {max(self.n.values())} sweeps: '
                    f'{FAULTS_IN_WORDS[fault]}'
                )
        lines += [
            f'{m}: {k} of {self.n[m]} sweeps without a result: {LOST}' for m, k in self.n_lost.items() if k
        ]
        lines += [f'{m}: {k} of {self.n[m]} sweeps: {DOUBTFUL}' for m, k in self.n_doubtful.items() if k]
        return lines + [
            f'{m}: not told at the end by the magnetometers: {t}' for m, t in self._untold.items() if t
        ]


def _listed(names: Sequence[str]) -> str:
    return ', '.join(names)
