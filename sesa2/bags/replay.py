"""The estimator over a whole recording, as fast as the machine can, with the results of a live run."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from sesa2.alignment.earth_frame import BaseComparison
from sesa2.bags.definitions import STRING, string_message
from sesa2.bags.reading import BesideMessage, ImuBlock, ImuRecording, Sample
from sesa2.bags.recorded_lengths import RecordedLengths
from sesa2.bags.recorded_magnetometers import RecordedFields
from sesa2.bags.recording import open_recording
from sesa2.bags.topics import Message
from sesa2.bags.writing import BagWriter, new_bag
from sesa2.configuration import Configuration, files
from sesa2.errors import Sesa2Error
from sesa2.estimation.arrivals import OFFLINE_PATIENCE, lag_in_words
from sesa2.estimation.estimator import Estimate, Estimator
from sesa2.estimation.left_twist import LeftTwist
from sesa2.estimation.stuck import StuckWatch, stuck_in_words
from sesa2.estimation.sweeps import NO_BASE, Sweep
from sesa2.estimation.time_steps import AHEAD_NS
from sesa2.messages.field_messages import FIELD_TYPE
from sesa2.messages.header_bytes import read_stamp
from sesa2.messages.imu_messages import TYPE as IMU_TYPE
from sesa2.messages.length_messages import LENGTHS_TYPE
from sesa2.messages.orientation_intake import OrientationIntake, unaligned_headings
from sesa2.messages.results import ResultMessages
from sesa2.messages.topic_names import (
    BACKBONE_LENGTHS,
    CONFIGURATION,
    imu_fields,
    imu_topics,
    magnetometer_field,
)
from sesa2.sensing.lengths import NO_LENGTHS, outside_in_words
from sesa2.time import NS

# Samples that are kept back for results that are to come before them.
_PENDING_MAX = 32_768
# Samples that are looked at one by one before whole rounds are looked for again.
_ONE_BY_ONE = 64


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
        number of sweeps of IMUs that gave a result, of every model that needs these.
    field_samples, field_sweeps
        the same of magnetometers.
    results
        number of results, by model.
    without_lengths
        number of sweeps without a result, since the length of a segment was not known.
    outside_stretch
        number of results in which a segment was shorter or longer than it should ever be, by its index.
    partial
        number of sweeps in which an enabled IMU was missing.
    resets
        how often time jumped back.
    lags
        how far stamps of IMUs are behind those of the others, s, by id; ahead: negative.
    silent_base
        the IMU on the base, if results are missing for lack of it; else 0.
    against_base
        what may be wrong where all IMUs point against the base, for people; else empty.
    stuck
        for how long IMUs said the same to the last digit while others turned, s, by id.
    near_singular
        number of results with a joint beyond 80° about z, by model.
    fallen_back
        number of results that the model could not solve and gave the shape of another, by model.
    much_twist
        of models whose segments had more twist left over than sound sensors leave, what is to be known, by model.
    messages
        number of messages written, by topic.
    duration
        of the recording as the samples' stamps tell it, s, summed over what lies between jumps back.
    problems
        of the recording and of its IMUs, for people.
    """

    samples: Counter[int] = field(default_factory=Counter)
    unknown: Counter[int] = field(default_factory=Counter)
    unreadable: Counter[int] = field(default_factory=Counter)
    dropped: Counter[str] = field(default_factory=Counter)
    sweeps: int = 0
    field_samples: Counter[int] = field(default_factory=Counter)
    field_sweeps: int = 0
    results: Counter[str] = field(default_factory=Counter)
    without_lengths: int = 0
    outside_stretch: Counter[int] = field(default_factory=Counter)
    partial: int = 0
    resets: int = 0
    lags: dict[int, float] = field(default_factory=dict)
    silent_base: int = 0
    against_base: str = ''
    stuck: dict[int, float] = field(default_factory=dict)
    near_singular: Counter[str] = field(default_factory=Counter)
    fallen_back: Counter[str] = field(default_factory=Counter)
    much_twist: dict[str, str] = field(default_factory=dict)
    messages: Counter[str] = field(default_factory=Counter)
    duration: float = 0.0
    problems: list[str] = field(default_factory=list)

    @property
    def warnings(self) -> list[str]:
        """All that was not as it should be, for people."""
        lines = list(self.problems)
        lines += [f'{n} samples not used: {reason}' for reason, n in self.dropped.items()]
        lines += [f'IMU {id_}: {lag_in_words(lag)}' for id_, lag in self.lags.items()]
        if self.silent_base:
            lines.append(f'IMU {self.silent_base} on the base was silent; without it there is no shape')
        if self.against_base:
            lines.append(self.against_base)
        lines += [f'IMU {id_}: {stuck_in_words(seconds)}' for id_, seconds in self.stuck.items()]
        if self.partial:
            lines.append(f'{self.partial} of {self.sweeps} sweeps lack an IMU, which was interpolated')
        if self.without_lengths:
            lines.append(f'{self.without_lengths} sweeps without a result: {NO_LENGTHS}')
        lines += [
            f'{outside_in_words(k)}: {n} of {self.sweeps} results'
            for k, n in self.outside_stretch.items()
            if n
        ]
        if self.resets:
            lines.append(f'time jumped back {self.resets} times; the estimate began anew there')
        lines += [
            f'{model}: {n} of {self.results[model]} results have a joint beyond 80° about z'
            for model, n in self.near_singular.items()
            if n
        ]
        lines += [
            f'{model}: {n} of {self.results[model]} results could not be solved and are arcs'
            for model, n in self.fallen_back.items()
            if n
        ]
        lines += [f'{model}: {text}' for model, text in self.much_twist.items()]
        return lines


def replay(
    source: str | Path | Mapping[int, Path],
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
        the recording, or the log of each IMU by id.
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
        source = recording.path
        intake = OrientationIntake.of(configuration)
        imus = ImuRecording(recording, configuration, intake)
        imus.check_lengths()
        total = sum(imus.counts.values())
        total += sum(imus.magnetometers.counts.values()) if imus.magnetometers else 0
        with new_bag(out) as bag:
            run = _Replay(configuration, imus, bag)
            done = 0
            for block in imus.blocks():
                run.add(block)
                done += len(block.data) + len(block.magnetic)
                if progress and done < total:
                    progress(done, total)
            summary = run.finish()
            summary.unknown = Counter({id_: imus.counts[id_] for id_ in imus.unknown})
            summary.unreadable = imus.unreadable
            summary.problems = [
                *recording.problems,
                *imus.warnings,
                *run.doubts,
                *unaligned_headings(configuration.imus.fusion, configuration.imus.headings),
                *intake.reasons,
                *intake.doubts,
                *(run.lengths.problems if run.lengths else []),
                *(run.fields.problems if run.fields else []),
            ]
            if not (summary.sweeps or summary.field_sweeps):
                reasons = '; '.join(summary.warnings)
                what = 'result' if summary.without_lengths or summary.field_samples else 'sweep'
                raise Sesa2Error(f'{source}: no {what} in {total} samples: {reasons}')
        if progress:
            progress(total, total)
    return summary


class _Replay:
    """Estimates block by block, and writes samples and results in order of time.

    Attributes
    ----------
    lengths
        those measured, where the configuration has some.
    fields
        of magnetometers, where the configuration has some.
    """

    def __init__(self, configuration: Configuration, imus: ImuRecording, bag: BagWriter):
        self._bag = bag
        self._namespace = imus.namespace
        self._enabled = np.array(configuration.imus.enabled)
        self._estimator = Estimator(configuration)
        self._assembler = self._estimator.assembler(OFFLINE_PATIENCE)
        self.lengths = (
            RecordedLengths(configuration, self._estimator, self._assembler, OFFLINE_PATIENCE)
            if configuration.has_lengths
            else None
        )
        self._indices = configuration.imus.indices
        # By index, the base's, if there is one, and that of unknown ids last.
        self._used = np.array(
            [i in configuration.imus.used_ids for i in configuration.imus.all_ids] + [False]
        )
        self._imu_ids = configuration.imus.all_ids
        self._base_id = configuration.imus.base_id
        self.fields = (
            RecordedFields(configuration, imus.magnetometers, OFFLINE_PATIENCE)
            if imus.magnetometers
            else None
        )
        self._messages = ResultMessages(configuration, self._estimator)
        self._field_messages = ResultMessages(
            configuration, self.fields.estimator if self.fields else Estimator(configuration, 'fields')
        )
        self._names: dict[int, str] = {}
        self._configuration = self._topic(CONFIGURATION, STRING, latched=True)
        self._yaml: str | None = files.dump(configuration)  # until it is written
        recorded = (
            sorted(set(imus.counts) & set(configuration.imus.indices)) if configuration.record.imu else []
        )
        topics = imu_topics(configuration)
        self._imus = {id_: self._topic(topics[id_], IMU_TYPE) for id_ in recorded}
        self._fields = {
            id_: self._topic(imu_fields(configuration)[id_], FIELD_TYPE)
            for id_ in (imus.field_ids if configuration.imus.fusion == '9d' else ())
            if id_ in self._imus
        }
        self._lengths_topic = (
            self._topic(BACKBONE_LENGTHS, LENGTHS_TYPE) if self.lengths and configuration.record.imu else None
        )
        self._results, self._field_results = (
            {
                topic: self._topic(*topic)
                for topic in messages.topics
                if not topic.name.endswith('/marker_array')  # which is for viewers
            }
            for messages in (self._messages, self._field_messages)
        )
        section = configuration.magnetometers
        self._magnetometers = {
            i: self._topic(magnetometer_field(i), FIELD_TYPE)
            for i in section.ids
            if imus.magnetometers and i in imus.magnetometers.counts and configuration.record.imu
        }
        self._only_fields = not configuration.imus.all_ids
        self._comparison = BaseComparison()
        self._sweeps: list[Sweep] = []
        self._before_block: list[int] = []  # stamp of the last sweep before the block, if there is one
        self._stuck = StuckWatch(len(self._enabled))
        self._left_twists: dict[str, LeftTwist] = {}
        self.doubts = [f'{name}: {d}' for name, model in self._estimator.models.items() for d in model.doubts]
        self._pending = _Entries()  # what is not written yet
        self._held = _Entries()  # samples of another time
        self._written_ns = 0  # time of the last entry that was written
        self._first_ns: int | None = None  # stamps of the results since time last jumped back
        self._last_ns = 0
        self.summary = Summary()

    def _topic(self, name: str, type_name: str, *, latched: bool = False) -> int:
        full = name if name.startswith('/') else f'{self._namespace}{name}'
        number = self._bag.add_topic(full, type_name, latched=latched)
        self._names[number] = full
        return number

    def add(self, block: ImuBlock) -> None:
        """Take samples, of any IMUs, lengths and fields of magnetometers."""
        self._pend_fields(block.fields)
        if self.fields and block.magnetic:
            self._add_magnetic(block)
        for piece in (block,) if self.lengths is None else self.lengths.pieces(block):
            self._pend_lengths(piece.lengths)
            if piece.data:
                self._add_samples(piece)
            self._end_block()

    def _add_magnetic(self, block: ImuBlock) -> None:
        assert self.fields is not None
        of_base = (block.ids == self._base_id) & (self._base_id != 0)
        fed = self.fields.add(block.magnetic, block.log_ns[of_base], block.orientations[of_base])
        for k, (taken, estimate) in enumerate(fed):
            if k and self._only_fields:  # time has stepped back
                self._end_segment()
            for id_, stamp_ns, data in taken:
                if id_ in self._magnetometers:
                    self._pending.extend([stamp_ns], [self._magnetometers[id_]], [data])
            self._pend_estimate(estimate)
        if self._only_fields and estimate is not None and len(estimate.stamps_ns):
            self._write(self._pending.taken(int(estimate.stamps_ns[-1])))

    def _pend_estimate(self, estimate: Estimate | None) -> None:
        """Keep results of magnetometers until they can be written."""
        if estimate is None or not estimate.models:
            return
        stamps = estimate.stamps_ns.tolist()
        for topic, number in self._field_results.items():
            self._pending.extend(stamps, [number] * len(stamps), self._field_messages.make(topic, estimate))
        self.summary.field_sweeps += len(stamps)
        for name, result in estimate.models.items():
            self.summary.near_singular[name] += result.near_singular
            self.summary.results[name] += len(stamps)
        if self._only_fields:
            self._first_ns = stamps[0] if self._first_ns is None else self._first_ns
            self._last_ns = stamps[-1]

    def _add_samples(self, block: ImuBlock) -> None:
        indices = np.array([self._indices.get(id_, -1) for id_ in block.ids.tolist()])
        self.summary.samples.update(block.ids[indices >= 0].tolist())
        used = self._used[indices]
        if not used.all():
            self._pend(block.chosen(np.flatnonzero(~used & (indices >= 0))))
            block, indices = block.chosen(np.flatnonzero(used)), indices[used]
        begin = 0
        while begin < len(indices):
            sweeps, taken = self._assembler.add_many(
                indices[begin:], block.stamps_ns[begin:], block.orientations[begin:], block.log_ns[begin:]
            )
            self._sweeps += sweeps
            self._pend(block.part(begin, begin + taken))
            begin += taken
            # Whole rounds can only begin where no sweep is begun.
            some = slice(begin, begin + _ONE_BY_ONE + len(self._used))
            for index, sample in zip(
                indices[some].tolist(), block.part(some.start, some.stop).samples(), strict=True
            ):
                if begin >= some.start + _ONE_BY_ONE and not self._assembler.waiting:
                    break
                self._add_one(index, sample)
                begin += 1

    def _pend(self, block: ImuBlock) -> None:
        """Keep samples until they can be written, where they are to be."""
        if self._imus and block.data:
            topics = [self._imus[id_] for id_ in block.ids.tolist()]
            self._pending.extend(block.stamps_ns.tolist(), topics, block.data)

    def _pend_fields(self, fields: Sequence[BesideMessage]) -> None:
        for one in fields:
            if one.id in self._fields:
                self._pending.extend([read_stamp(one.data)], [self._fields[one.id]], [one.data])

    def _pend_lengths(self, lengths: Sequence[Message]) -> None:
        if self._lengths_topic is not None and lengths:
            newest_ns = self._assembler.newest_ns
            stamps = [read_stamp(message.data) for message in lengths]
            if newest_ns is not None:  # those of another time go among their neighbours
                stamps = [t if abs(t - newest_ns) <= AHEAD_NS else newest_ns for t in stamps]
            topics = [self._lengths_topic] * len(lengths)
            self._pending.extend(stamps, topics, [message.data for message in lengths])

    def _add_one(self, index: int, sample: Sample) -> None:
        id_, stamp_ns, x, y, z, w, data, log_ns = sample
        resets = self._assembler.resets
        sweeps = self._assembler.add(index, stamp_ns, x, y, z, w, log_ns)
        if self._assembler.resets != resets:  # sweeps of before the step go with the samples of before it
            before_these = [s.stamp_ns for s in self._sweeps[-1:]] or self._before_block
            stamps = [*before_these, *(sweep.stamp_ns for sweep in sweeps)]
            steps = [k for k in range(1, len(stamps)) if stamps[k] <= stamps[k - 1]]
            before = steps[0] - (len(stamps) - len(sweeps)) if steps else len(sweeps)
            self._sweeps += sweeps[:before]
            sweeps = sweeps[before:]
            self._end_segment()
        self._sweeps += sweeps
        if id_ in self._imus:
            entries = self._held if self._assembler.holds(index) else self._pending
            entries.extend([stamp_ns], [self._imus[id_]], [data])
        if self._held and (not self._assembler.holding or len(self._held) > _PENDING_MAX):
            self._release_held()

    def _release_held(self) -> None:
        self._pending.extend(
            [self._placed(t) for t in self._held.stamps_ns], self._held.topics, self._held.data
        )
        self._held = _Entries()

    def _placed(self, stamp_ns: int) -> int:
        """Where a sample of another time goes: to its stamp if time has come to that, else among its neighbours."""
        newest_ns = self._assembler.newest_ns
        if newest_ns is None or 0 <= newest_ns - stamp_ns <= AHEAD_NS:
            return stamp_ns
        return newest_ns

    def finish(self) -> Summary:
        """Write what is left."""
        self._sweeps += self._assembler.flush()
        self._release_held()
        if self.fields:
            self._pend_estimate(self.fields.flush())
            self.summary.field_samples = self.fields.samples
        self._end_segment()
        self.summary.lags = {
            self._imu_ids[index]: lag for index, lag in self._assembler.arrivals.lags.items()
        }
        if self._assembler.dropped[NO_BASE]:
            self.summary.silent_base = self._base_id
        self.summary.dropped = self._assembler.dropped
        self.summary.against_base = self._comparison.doubt
        stuck = zip(self._imu_ids, self._stuck.seconds.tolist(), strict=False)
        self.summary.stuck = {id_: seconds for id_, seconds in stuck if seconds}
        self.summary.resets = self._assembler.resets
        if self.fields and self._only_fields:
            self.summary.resets = self.fields.resets
        models = self._estimator.models
        self.summary.much_twist = {
            name: left.told(models[name]) for name, left in self._left_twists.items() if left.is_much
        }
        self.summary.messages = Counter({self._names[n]: count for n, count in self._bag.counts.items()})
        return self.summary

    def _end_segment(self) -> None:
        self._end_block(last=True)
        self._before_block = []
        self._stuck.end()
        self._write(self._pending.taken())
        self._written_ns = 0
        if self._first_ns is not None:
            self.summary.duration += (self._last_ns - self._first_ns) / NS
        self._first_ns = None

    def _end_block(self, *, last: bool = False) -> None:
        """Estimate, and write what is not newer than the last result: a result can be older than the next sample."""
        self._before_block = [sweep.stamp_ns for sweep in self._sweeps[-1:]] or self._before_block
        if self.lengths is not None:
            self._sweeps = self.lengths.put(self._sweeps) + (self.lengths.flush() if last else [])
        if not self._sweeps:
            if len(self._pending) > _PENDING_MAX:  # nothing but samples that make no sweep
                self._write(self._pending.taken())
            return
        estimate = self._estimator.estimate(self._sweeps)
        self._estimator.compare(self._sweeps, self._comparison)
        stamps = estimate.stamps_ns.tolist()
        for topic, number in self._results.items() if stamps else ():
            self._pending.extend(stamps, [number] * len(stamps), self._messages.make(topic, estimate))
        self.summary.sweeps += len(stamps)
        self.summary.results.update(dict.fromkeys(estimate.models, len(stamps)))
        measured = np.array([sweep.measured for sweep in self._sweeps])
        orientations = np.array([sweep.orientations for sweep in self._sweeps])
        all_stamps = np.array([sweep.stamp_ns for sweep in self._sweeps])
        self._stuck.add(all_stamps / NS, orientations, measured)
        partial = ~measured[:, self._enabled].all(axis=1)
        self.summary.partial += int(np.count_nonzero(partial & np.isin(all_stamps, estimate.stamps_ns)))
        self.summary.without_lengths += estimate.without_lengths
        self.summary.outside_stretch.update(dict(enumerate(estimate.outside_stretch.tolist())))
        self.summary.near_singular.update({m: r.near_singular for m, r in estimate.models.items()})
        self.summary.fallen_back.update({m: r.fallen_back for m, r in estimate.models.items()})
        for name, result in estimate.models.items():
            if result.twists is not None:
                self._left_twists.setdefault(name, LeftTwist()).add(result.twists)
        self._sweeps = []
        if stamps:
            self._first_ns = stamps[0] if self._first_ns is None else self._first_ns
            self._last_ns = stamps[-1]
        self._write(self._pending.taken(int(all_stamps[-1])))

    def _write(self, entries: '_Entries') -> None:
        """Write in the order given; what comes too late for its place goes to the end.

        A bag knows no time before 0, to which the latency can lead in simulated time.
        """
        if not entries:
            return
        times = np.maximum.accumulate(np.maximum(entries.stamps_ns, self._written_ns)).tolist()
        if self._yaml is not None:
            self._bag.write(self._configuration, times[0], string_message(self._yaml))
            self._yaml = None
        self._written_ns = times[-1]
        self._bag.write_many(entries.topics, times, entries.data)


class _Entries:
    """Messages that are to be written: stamps, ns, numbers of their topics, and bytes."""

    def __init__(self) -> None:
        self.stamps_ns: list[int] = []
        self.topics: list[int] = []
        self.data: list[bytes] = []

    def __len__(self) -> int:
        return len(self.data)

    def extend(self, stamps_ns: Sequence[int], topics: Sequence[int], data: Sequence[bytes]) -> None:
        self.stamps_ns += stamps_ns
        self.topics += topics
        self.data += data

    def taken(self, until_ns: int | None = None) -> '_Entries':
        """Take those up to a time, all where it is None; in order of time."""
        stamps = np.array(self.stamps_ns, dtype=np.int64)
        order = np.argsort(stamps, kind='stable')
        n = len(order) if until_ns is None else int(np.searchsorted(stamps[order], until_ns, side='right'))
        ready, rest = order[:n].tolist(), order[n:].tolist()
        out = _Entries()
        out.extend(stamps[order[:n]].tolist(), [self.topics[k] for k in ready], [self.data[k] for k in ready])
        self.stamps_ns = [self.stamps_ns[k] for k in rest]
        self.topics = [self.topics[k] for k in rest]
        self.data = [self.data[k] for k in rest]
        return out
