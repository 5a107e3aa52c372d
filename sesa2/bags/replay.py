"""The estimator over a whole recording, as fast as the machine can, with the results of a live run."""

from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import repeat
from operator import itemgetter
from pathlib import Path

import numpy as np

from sesa2.bags.definitions import STRING, string_message
from sesa2.bags.reading import ImuRecording, Sample
from sesa2.bags.recording import open_recording
from sesa2.bags.writing import BagWriter, new_bag
from sesa2.configuration import Configuration, files
from sesa2.errors import Sesa2Error
from sesa2.estimation.arrivals import OFFLINE_PATIENCE, lag_in_words
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import NO_BASE, Sweep
from sesa2.estimation.time_steps import AHEAD_NS
from sesa2.messages.imu_messages import TYPE as IMU_TYPE
from sesa2.messages.results import ResultMessages
from sesa2.messages.topic_names import CONFIGURATION, imu_data
from sesa2.time import NS

# Samples that are worked on at once: enough to make numpy worth its while, few enough to stay in the processor's cache.
BLOCK = 2048
# Samples that are kept back for results that are to come before them.
_PENDING_MAX = 16 * BLOCK


@dataclass
class Summary:
    """What a replay read, left out and wrote.

    Attributes
    ----------
    samples
        number of samples of each configured IMU, by id.
    unknown
        number of messages of ids that the configuration does not have.
    unreadable
        number of messages, by id, that were no whole sensor_msgs/Imu.
    dropped
        number of samples that no sweep could use, by reason.
    sweeps
        number of sweeps; each gave a result of every model.
    partial
        number of sweeps in which an enabled IMU was missing.
    resets
        how often time jumped back.
    lags
        how far stamps of IMUs are behind those of the others, s, by id; ahead: negative.
    silent_base
        the IMU on the base, if results are missing for lack of it; else 0.
    near_singular
        number of results with a joint beyond 80° about z, by model.
    messages
        number of messages written, by topic.
    duration
        of the recording as the samples' stamps tell it, s, summed over what lies between jumps back.
    problems
        of the recording, for people.
    """

    samples: Counter[int] = field(default_factory=Counter)
    unknown: Counter[int] = field(default_factory=Counter)
    unreadable: Counter[int] = field(default_factory=Counter)
    dropped: Counter[str] = field(default_factory=Counter)
    sweeps: int = 0
    partial: int = 0
    resets: int = 0
    lags: dict[int, float] = field(default_factory=dict)
    silent_base: int = 0
    near_singular: Counter[str] = field(default_factory=Counter)
    messages: Counter[str] = field(default_factory=Counter)
    duration: float = 0.0
    problems: list[str] = field(default_factory=list)

    @property
    def warnings(self) -> list[str]:
        """All that was not as it should be, for people."""
        lines = list(self.problems)
        lines += [f'IMU {id_}: {n} messages not used: not in imus.ids' for id_, n in self.unknown.items()]
        lines += [f'IMU {id_}: {n} messages not used: damaged' for id_, n in self.unreadable.items()]
        lines += [f'{n} samples not used: {reason}' for reason, n in self.dropped.items()]
        lines += [f'IMU {id_}: {lag_in_words(lag)}' for id_, lag in self.lags.items()]
        if self.silent_base:
            lines.append(f'IMU {self.silent_base} on the base was silent; without it there is no shape')
        if self.partial:
            lines.append(f'{self.partial} of {self.sweeps} sweeps lack an IMU, which was interpolated')
        if self.resets:
            lines.append(f'time jumped back {self.resets} times; the estimate began anew there')
        lines += [
            f'{model}: {n} of {self.sweeps} results have a joint beyond 80° about z'
            for model, n in self.near_singular.items()
            if n
        ]
        return lines


def replay(
    source: str | Path,
    configuration: Configuration,
    out: str | Path,
    *,
    models: Sequence[str] | None = None,
    first_id: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Summary:
    """Estimate shapes over a whole recording and write them as a new bag.

    The bag holds what a live run would have published: the configuration first, then for every model its joint states,
    markers, tip and shape, and the IMUs' messages where `record.imu` says so. Everything is recorded at the time of its
    measurement.

    Parameters
    ----------
    source
        the recording.
    configuration
        the arm, its IMUs and the models.
    out
        folder of the new bag.
    models
        names of models, instead of the configuration's.
    first_id
        for a bag of the ROS 1 predecessor: the ID in it that is IMU 1; the lowest where it is None.
    progress
        told from time to time how many samples of how many are done.

    Raises
    ------
    Sesa2Error
        the recording is unusable, or the bag cannot be written; then there is no bag.
    """
    if models is not None:
        configuration = files.parse(files.dump(replace(configuration, models=tuple(models))), '--models')
    with open_recording(source, first_id) as recording:
        imus = ImuRecording(recording)
        indices = configuration.imus.indices
        if not any(n for id_, n in imus.counts.items() if id_ in indices):
            raise Sesa2Error(
                f'{source}: no message of the configured IMUs {_listed(indices)}; '
                f'it has topics of {_listed(imus.counts)}'
            )
        total = sum(imus.counts.values())
        with new_bag(out) as bag:
            run = _Replay(configuration, imus, bag)
            for done, sample in enumerate(imus.samples(), start=1):
                index = indices.get(sample.id)
                if index is not None:
                    run.add(index, sample)
                if progress and done % BLOCK == 0:
                    progress(done, total)
            summary = run.finish()
            summary.unknown = Counter({id_: n for id_, n in imus.counts.items() if id_ not in indices})
            summary.unreadable = imus.unreadable
            summary.problems = recording.problems
            if not summary.sweeps:
                reasons = '; '.join(summary.warnings) or 'the IMUs with samples are disabled'
                raise Sesa2Error(f'{source}: no sweep in {total} samples: {reasons}')
        if progress:
            progress(total, total)
    return summary


def _listed(ids: Iterable[int]) -> str:
    return ', '.join(map(str, sorted(ids)))


class _Replay:
    """Estimates block by block, and writes samples and results in order of time."""

    def __init__(self, configuration: Configuration, imus: ImuRecording, bag: BagWriter):
        self._bag = bag
        self._namespace = imus.namespace
        self._enabled = np.array(configuration.imus.enabled)
        self._estimator = Estimator(configuration)
        self._assembler = self._estimator.assembler(OFFLINE_PATIENCE)
        self._imu_ids = configuration.imus.all_ids
        self._base_id = configuration.imus.base_id
        self._messages = ResultMessages(configuration, self._estimator)
        self._names: dict[int, str] = {}
        self._configuration = self._topic(CONFIGURATION, STRING, latched=True)
        self._yaml: str | None = files.dump(configuration)  # until it is written
        recorded = (
            sorted(set(imus.counts) & set(configuration.imus.indices)) if configuration.record.imu else []
        )
        self._imus = {id_: self._topic(imu_data(id_), IMU_TYPE) for id_ in recorded}
        self._results = {
            topic: self._topic(*topic)
            for topic in self._messages.topics
            if not topic.name.endswith('/marker_array')  # which is for viewers
        }
        self._block: list[Sweep] = []
        self._pending: list[tuple[int, int, bytes]] = []  # stamp, topic and bytes of what is not written yet
        self._held: list[tuple[int, int, bytes]] = []  # the same of samples of another time
        self._written_ns = 0  # time of the last entry that was written
        self._taken = 0
        self._first_ns: int | None = None  # stamps of the results since time last jumped back
        self._last_ns = 0
        self.summary = Summary()

    def _topic(self, name: str, type_name: str, *, latched: bool = False) -> int:
        number = self._bag.add_topic(f'{self._namespace}{name}', type_name, latched=latched)
        self._names[number] = f'{self._namespace}{name}'
        return number

    def add(self, index: int, sample: Sample) -> None:
        """Take a sample of a configured IMU."""
        id_, stamp_ns, x, y, z, w, data, log_ns = sample
        resets = self._assembler.resets
        sweeps = self._assembler.add(index, stamp_ns, x, y, z, w, log_ns)
        if self._assembler.resets != resets:  # sweeps of before the step go with the samples of before it
            for k, sweep in enumerate(sweeps):
                if self._block and sweep.stamp_ns <= self._block[-1].stamp_ns:
                    sweeps = sweeps[k:]
                    break
                self._block.append(sweep)
            else:
                sweeps = []
            self._end_segment()
        self._block += sweeps
        if id_ in self._imus:
            entry = stamp_ns, self._imus[id_], data
            if self._assembler.holds(index):
                self._held.append(entry)
            else:
                self._pending.append(entry)
        if self._held and (not self._assembler.holding or len(self._held) > _PENDING_MAX):
            self._pending += [(self._placed(stamp), topic, data) for stamp, topic, data in self._held]
            self._held = []
        self.summary.samples[id_] += 1
        self._taken += 1
        if self._taken >= BLOCK:
            self._end_block()

    def _placed(self, stamp_ns: int) -> int:
        """Where a sample of another time goes: to its stamp if time has come to that, else among its neighbours."""
        newest_ns = self._assembler.newest_ns
        if newest_ns is None or 0 <= newest_ns - stamp_ns <= AHEAD_NS:
            return stamp_ns
        return newest_ns

    def finish(self) -> Summary:
        """Write what is left."""
        self._block += self._assembler.flush()
        self._pending += [(self._placed(stamp), topic, data) for stamp, topic, data in self._held]
        self._end_segment()
        self.summary.lags = {
            self._imu_ids[index]: lag for index, lag in self._assembler.arrivals.lags.items()
        }
        if self._assembler.dropped[NO_BASE]:
            self.summary.silent_base = self._base_id
        self.summary.dropped = self._assembler.dropped
        self.summary.resets = self._assembler.resets
        self.summary.messages = Counter({self._names[n]: count for n, count in self._bag.counts.items()})
        return self.summary

    def _end_segment(self) -> None:
        self._end_block()
        self._write(self._pending)
        self._pending = []
        self._written_ns = 0
        if self._first_ns is not None:
            self.summary.duration += (self._last_ns - self._first_ns) / NS
        self._first_ns = None

    def _end_block(self) -> None:
        """Estimate, and write what is not newer than the last result: a result can be older than the next sample."""
        self._taken = 0
        if not self._block:
            if len(self._pending) > _PENDING_MAX:  # nothing but samples that make no sweep
                self._write(self._pending)
                self._pending = []
            return
        estimate = self._estimator.estimate(self._block)
        stamps = estimate.stamps_ns.tolist()
        for topic, number in self._results.items():
            rows = self._messages.make(topic, estimate)
            self._pending += zip(stamps, repeat(number), map(bytes, rows))
        self.summary.sweeps += len(stamps)
        self.summary.partial += sum(not sweep.measured[self._enabled].all() for sweep in self._block)
        self.summary.near_singular.update({m: r.near_singular for m, r in estimate.models.items()})
        self._block = []
        self._first_ns = stamps[0] if self._first_ns is None else self._first_ns
        self._last_ns = stamps[-1]
        self._pending.sort(key=itemgetter(0))
        written = bisect_right(self._pending, stamps[-1], key=itemgetter(0))
        self._write(self._pending[:written])
        del self._pending[:written]

    def _write(self, entries: list[tuple[int, int, bytes]]) -> None:
        """Write in the order given; what comes too late for its place goes to the end.

        A bag knows no time before 0, to which the latency can lead in simulated time.
        """
        if entries and self._yaml is not None:
            self._bag.write(self._configuration, max(entries[0][0], 0), string_message(self._yaml))
            self._yaml = None
        for stamp_ns, topic, data in entries:
            self._written_ns = max(stamp_ns, self._written_ns)
            self._bag.write(topic, self._written_ns, data)
