"""The sweeps of a recording as arrays, as alignment and self-calibration take them."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sesa2.bags.reading import ImuRecording
from sesa2.bags.recorded_lengths import RecordedLengths
from sesa2.bags.recording import open_recording
from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.estimation.arrivals import OFFLINE_PATIENCE, lag_in_words
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep
from sesa2.messages.orientation_intake import OrientationIntake
from sesa2.shape.rotations import FloatArray


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


def read_sweeps(
    source: str | Path | Mapping[int, Path], configuration: Configuration, first_id: int | None = None
) -> RecordedSweeps:
    """Read a whole recording.

    Parameters
    ----------
    source
        the recording, or the log of each IMU by id.
    configuration
        says which IMUs are where.
    first_id
        for a bag of the ROS 1 predecessor: the ID in it that is IMU 1; the lowest where it is None.

    Raises
    ------
    Sesa2Error
        it is unusable, or has no sweep of the configured IMUs.
    """
    estimator = Estimator(configuration)
    assembler = estimator.assembler(OFFLINE_PATIENCE)
    indices = configuration.imus.indices
    intake = OrientationIntake.of(configuration)
    sweeps: list[Sweep] = []
    with open_recording(source, first_id) as recording:
        imus = ImuRecording(recording, configuration, intake)
        lengths = (
            RecordedLengths(configuration, estimator, assembler, OFFLINE_PATIENCE)
            if imus.lengths_topic
            else None
        )
        for block in imus.blocks():
            for piece in (block,) if lengths is None else lengths.pieces(block):
                found: list[Sweep] = []
                for sample in piece.samples():
                    if (index := indices.get(sample.id)) is not None:
                        found += assembler.add(index, *sample[1:6], sample.log_ns)
                sweeps += found if lengths is None else lengths.put(found)
        last = assembler.flush()
        sweeps += last if lengths is None else [*lengths.put(last), *lengths.flush()]
        problems = [
            *recording.problems,
            *imus.warnings,
            *intake.reasons,
            *intake.doubts,
            *(lengths.problems if lengths else []),
            *(f'{n} samples not used: {why}' for why, n in assembler.dropped.items()),
            *(
                f'IMU {configuration.imus.all_ids[index]}: {lag_in_words(lag)}'
                for index, lag in assembler.arrivals.lags.items()
            ),
        ]
    if not sweeps:
        raise Sesa2Error(
            f'{recording.path}: no sweep of the configured IMUs; {"; ".join(problems) or "no samples"}'
        )
    return RecordedSweeps(
        np.array([s.stamp_ns for s in sweeps]),
        np.stack([s.orientations for s in sweeps]),
        np.stack([s.measured for s in sweeps]),
        np.array(estimator.bases(sweeps)),
        np.array([s.lengths for s in sweeps]) if lengths else None,
        problems,
    )
