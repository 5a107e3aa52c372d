"""The measured lengths of a recording, put to its sweeps."""

from bisect import bisect_left
from collections.abc import Iterator, Sequence

import numpy as np

from sesa2.bags.reading import ImuBlock
from sesa2.configuration import Configuration
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep, SweepAssembler
from sesa2.estimation.time_steps import BACK_NS
from sesa2.messages.header_bytes import with_stamp
from sesa2.messages.length_messages import LengthIntake, SaidLengths
from sesa2.messages.length_words import about_clocks, about_lengths


class RecordedLengths:
    """Feeds lengths block by block, and gives sweeps theirs.

    Parameters
    ----------
    configuration
        that has lengths.
    estimator, assembler
        of the sweeps.
    patience : s
        how long a sweep waits by the clock of recording.
    """

    def __init__(
        self, configuration: Configuration, estimator: Estimator, assembler: SweepAssembler, patience: float
    ):
        self._names = configuration.lengths.names
        self.intake = LengthIntake.of(configuration)
        self.sweeps = estimator.sweep_lengths(assembler, patience)
        self._clock_ns = 0
        self._unstamped = 0

    def pieces(self, block: ImuBlock) -> Iterator[ImuBlock]:
        """The block, with its lengths taken; where their time steps back in pieces, with a message each.

        Messages that are refused are gone from it; in the others the time of their recording stands in for a stamp
        of 0.
        """
        data = [message.data for message in block.lengths]
        log_ns = np.array([message.log_ns for message in block.lengths], dtype=np.int64)
        said = [self._stamped(one, log_ns, data) for one in self.intake.take_many(data)]
        samples = _by_backbone(said)
        used, stamps = _in_order([one.rows for one in said], [one.stamps_ns for one in said])
        rows = used.tolist()
        # The order of single messages matters nowhere else.
        cuts = rows[1:] if (np.diff(stamps) < -BACK_NS).any() else []
        messages = [block.lengths[row]._replace(data=data[row]) for row in rows]
        begin = 0
        for row, until in zip([0, *cuts], [*cuts, len(data)], strict=True):
            end = len(block.data)
            if until < len(data):
                end = max(begin, int(np.searchsorted(block.log_ns, log_ns[until])))
            for index, (own_rows, own_stamps, lengths) in samples.items():
                which = slice(*np.searchsorted(own_rows, [row, until]).tolist())
                self.sweeps.add((index,), own_stamps[which], lengths[which, None], log_ns[own_rows[which]])
            whose = slice(bisect_left(rows, row), bisect_left(rows, until))
            piece = block.part(begin, end)._replace(lengths=messages[whose])
            self._clock_ns = max(self._clock_ns, *log_ns[row:until].tolist(), *piece.log_ns[-1:].tolist())
            yield piece
            begin = end

    def put(self, sweeps: Sequence[Sweep]) -> list[Sweep]:
        """Let sweeps wait; those that have their lengths now."""
        return self.sweeps.put(sweeps, self._clock_ns)

    def flush(self) -> list[Sweep]:
        """All that wait."""
        return self.sweeps.flush()

    @property
    def problems(self) -> list[str]:
        """What was not as it should be, for people; complete after reading."""
        lines = about_lengths(self._names, self.intake, self.sweeps)
        lines += about_clocks(self._names, self.sweeps)
        if self._unstamped:
            lines.append(
                f'lengths: {self._unstamped} messages have no stamp (0); the time of their recording stands in'
            )
        lines += [
            f'{self._names[k]}: {n} sweeps had no length of it within lengths.timeout: no result of them'
            for k, n in sorted(self.sweeps.n_without.items())
            if n
        ]
        return lines

    def _stamped(self, said: SaidLengths, log_ns: np.ndarray, data: list[bytes]) -> SaidLengths:
        without = (said.stamps_ns == 0) & (log_ns[said.rows] != 0)  # a recording may begin at 0
        if not without.any():
            return said
        for row in said.rows[without].tolist():
            data[row] = with_stamp(data[row], int(log_ns[row]))
        self._unstamped += int(without.sum())
        return said._replace(stamps_ns=np.where(without, log_ns[said.rows], said.stamps_ns))


def _by_backbone(said: Sequence[SaidLengths]) -> dict[int, tuple[np.ndarray, ...]]:
    """Rows, stamps and lengths of each backbone in the order in which they came, whoever said them."""
    of: dict[int, list[tuple[np.ndarray, ...]]] = {}
    for one in said:
        for column, index in enumerate(one.backbones):
            of.setdefault(index, []).append((one.rows, one.stamps_ns, one.lengths[:, column]))
    return {index: _in_order(*zip(*parts, strict=True)) for index, parts in of.items()}


def _in_order(rows: Sequence[np.ndarray], *columns: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
    """Parts put together and sorted by their rows."""
    if not rows:
        return (np.zeros(0, np.int64),) * (1 + len(columns))
    order = np.argsort(np.concatenate(rows), kind='stable')
    return tuple(np.concatenate(parts)[order] for parts in (rows, *columns))
