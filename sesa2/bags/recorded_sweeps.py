"""The sweeps of a recording as arrays, as alignment and self-calibration take them."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sesa2.bags.reading import ImuBlock, ImuRecording
from sesa2.bags.recorded_lengths import RecordedLengths
from sesa2.bags.recording import Recording, opened
from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.estimation.arrivals import OFFLINE_PATIENCE, lag_in_words
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep, SweepAssembler
from sesa2.messages.orientation_intake import OrientationIntake
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS


class RecordedSweeps(NamedTuple):
    """Sweeps in order of time.

    Attributes
    ----------
    stamps_ns : (n,)
        ns.
    orientations : (n, n_imu, 4)
        q_WS as measured, x y z w, unit norm.
    measured : (n, n_imu)
        true where the IMU has measured.
    base : (n, 4)
        q_WB.
    lengths : (n, n_backbones) or None
        of the backbones as they are said, m, NaN where one has none; None where the configuration or the recording has
        no lengths.
    problems
        of the recording, for people.
    """

    stamps_ns: np.ndarray
    orientations: FloatArray
    measured: np.ndarray
    base: FloatArray
    lengths: FloatArray | None
    problems: list[str]

    def chosen(self, which: np.ndarray) -> 'RecordedSweeps':
        """Some of the sweeps."""
        lengths = None if self.lengths is None else self.lengths[which]
        return RecordedSweeps(
            self.stamps_ns[which],
            self.orientations[which],
            self.measured[which],
            self.base[which],
            lengths,
            self.problems,
        )


# Samples that are looked at one by one before whole rounds are looked for again.
_ONE_BY_ONE = 64
# Of a long recording, s.
_LONG, _EVERY, _SAMPLED = 600.0, 60.0, 3.0


def read_sweeps(
    source: str | Path | Mapping[int, Path] | Recording,
    configuration: Configuration,
    first_id: int | None = None,
    *,
    sampled: bool = False,
) -> RecordedSweeps:
    """Read a recording.

    Parameters
    ----------
    source
        the recording, or the log of each IMU by id; or an open recording.
    configuration
        says which IMUs are where.
    first_id
        for a bag of the ROS 1 predecessor: the ID in it that is IMU 1; the lowest where it is None.
    sampled
        of one that is longer than ten minutes and has an index, only some seconds of each minute.

    Raises
    ------
    Sesa2Error
        it is unusable, or has no sweep of the configured IMUs.
    """
    estimator = Estimator(configuration)
    used = set(configuration.imus.used_ids)
    indices = {id_: index for id_, index in configuration.imus.indices.items() if id_ in used}
    intake = OrientationIntake.of(configuration)
    parts, problems_of_lengths, dropped, lags = [], Counter[str](), Counter[str](), dict[int, float]()
    with opened(source, first_id) as recording:
        imus = ImuRecording(recording, configuration, intake)
        for span_ns in _spans(recording) if sampled else [None]:
            assembler = estimator.assembler(OFFLINE_PATIENCE)
            lengths = (
                RecordedLengths(configuration, estimator, assembler, OFFLINE_PATIENCE)
                if imus.lengths_topic
                else None
            )
            for block in imus.blocks(span_ns):
                for piece in (block,) if lengths is None else lengths.pieces(block):
                    found = _assembled(assembler, piece, indices)
                    parts.append(_stacked(found if lengths is None else lengths.put(found), estimator))
            last = assembler.flush()
            parts.append(
                _stacked(last if lengths is None else [*lengths.put(last), *lengths.flush()], estimator)
            )
            dropped.update(assembler.dropped)
            lags.update(assembler.arrivals.lags)
            problems_of_lengths.update(lengths.problems if lengths else ())
        problems = [
            *recording.problems,
            *imus.warnings,
            *intake.reasons,
            *intake.doubts,
            *problems_of_lengths,
            *(f'{n} samples not used: {why}' for why, n in dropped.items()),
            *(f'IMU {configuration.imus.all_ids[index]}: {lag_in_words(lag)}' for index, lag in lags.items()),
        ]
    parts = [part for part in parts if part is not None]
    if not parts:
        raise Sesa2Error(
            f'{recording.path}: no sweep of the configured IMUs; {"; ".join(problems) or "no samples"}'
        )
    *columns, of_lengths = zip(*parts, strict=True)
    stamps, orientations, measured, base = map(np.concatenate, columns)
    known = [part for part in of_lengths if part is not None]
    return RecordedSweeps(
        stamps, orientations, measured, base, np.concatenate(known) if known else None, problems
    )


def _spans(recording: Recording) -> Sequence[tuple[int, int] | None]:
    """Some seconds of each minute of a long recording, from its first to its last; else all of it."""
    times = recording.indexed_ns
    if times is None or times[1] - times[0] <= _LONG * NS:
        return [None]
    n = round((times[1] - times[0]) / (_EVERY * NS))
    length = int(_SAMPLED * NS)
    begins = np.linspace(times[0], times[1] + 1 - length, n + 1).astype(np.int64).tolist()
    return [(begin, begin + length) for begin in begins]


def _stacked(
    sweeps: list[Sweep], estimator: Estimator
) -> tuple[np.ndarray, FloatArray, np.ndarray, FloatArray, FloatArray | None] | None:
    """Stamps, orientations, what was measured, the bases and lengths; None where there is no sweep."""
    if not sweeps:
        return None
    return (
        np.array([s.stamp_ns for s in sweeps]),
        np.stack([s.orientations for s in sweeps]),
        np.stack([s.measured for s in sweeps]),
        estimator.bases(sweeps),
        None if sweeps[0].lengths is None else np.array([s.lengths for s in sweeps]),
    )


def _assembled(assembler: SweepAssembler, block: ImuBlock, indices: Mapping[int, int]) -> list[Sweep]:
    """The sweeps that a block completes; round by round where it has whole ones."""
    index = np.array([indices.get(id_, -1) for id_ in block.ids.tolist()])
    if (index < 0).any():
        block, index = block.chosen(np.flatnonzero(index >= 0)), index[index >= 0]
    sweeps: list[Sweep] = []
    begin = 0
    while begin < len(index):
        whole, taken = assembler.add_many(
            index[begin:], block.stamps_ns[begin:], block.orientations[begin:], block.log_ns[begin:]
        )
        sweeps += whole
        begin += taken
        end = begin + _ONE_BY_ONE
        for i, sample in zip(index[begin:end].tolist(), block.part(begin, end).samples(), strict=True):
            sweeps += assembler.add(i, *sample[1:6], sample.log_ns)
        begin = end
    return sweeps
