"""The magnetometers of a recording: which topics are theirs, and what sweeps of them give."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence

import numpy as np

from sesa2.bags.recording import Recording
from sesa2.bags.topics import Message, magnetometer_topic
from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.estimation.arrivals import lag_in_words
from sesa2.estimation.estimator import Estimate, Estimator
from sesa2.estimation.field_report import FieldReport
from sesa2.estimation.sweeps import Sweep
from sesa2.messages.field_intake import FieldIntake
from sesa2.messages.field_messages import FIELD_TYPE
from sesa2.messages.header_bytes import with_stamp
from sesa2.messages.topic_names import magnetometer_field
from sesa2.shape.rotations import FloatArray


class MagnetometerTopics:
    """Finds the topics.

    Parameters
    ----------
    recording
        open.
    configuration
        with magnetometers.
    namespace
        of the arm, where its IMUs tell it.

    Attributes
    ----------
    namespace
        of the topics, with a slash at its end.
    ids, counts
        id by topic, and number of messages by id.

    Raises
    ------
    Sesa2Error
        there are those of several arms, or none of one that the configuration has.
    """

    def __init__(self, recording: Recording, configuration: Configuration, namespace: str | None = None):
        by_namespace: defaultdict[str, dict[str, int]] = defaultdict(dict)
        for name, topic in recording.topics.items():
            found = magnetometer_topic(name)
            if found and topic.type == FIELD_TYPE and topic.count and namespace in (None, found.namespace):
                by_namespace[found.namespace][name] = found.id
        if len(by_namespace) > 1:
            raise Sesa2Error(
                f'{recording.path}: topics of magnetometers in the namespaces {" and ".join(sorted(by_namespace))}, '
                'expected those of one arm'
            )
        self.namespace, self.ids = next(iter(by_namespace.items()), (namespace or '/', {}))
        self.counts = {id_: recording.topics[name].count for name, id_ in self.ids.items()}
        section = configuration.magnetometers
        self.unknown = sorted(set(self.counts) - set(section.ids))
        self.absent = [i for i in section.ids if i not in self.counts and i not in section.masked]
        if configuration.models_of('fields') and not set(self.counts) & set(section.ids):
            there = ', '.join(f'{name} ({t.type}, {t.count})' for name, t in recording.topics.items())
            raise Sesa2Error(
                f'{recording.path}: no message of a magnetometer, expected topics '
                f'{magnetometer_field(section.ids[0])} and so on of {FIELD_TYPE}; its topics: {there or "none"}'
            )

    @property
    def warnings(self) -> list[str]:
        """What is there too much and too little, for people."""
        return [
            *(
                f'magnetometer {i}: {self.counts[i]} messages not used: not in magnetometers.ids'
                for i in self.unknown
            ),
            *(f'magnetometer {i}: no message' for i in self.absent),
        ]


class RecordedFields:
    """Makes sweeps and estimates of the messages of magnetometers, block by block.

    Attributes
    ----------
    estimator
        of the models that need them.
    samples
        number of messages of each configured magnetometer, by id.
    """

    def __init__(self, configuration: Configuration, topics: MagnetometerTopics, patience: float):
        self.estimator = Estimator(configuration, 'fields')
        self._topics = topics
        self._assembler = self.estimator.field_assembler(patience)
        self._indices = {id_: k for k, id_ in enumerate(configuration.magnetometers.ids)}
        self._by_arrival = configuration.imus.stamps == 'arrival'
        self._intake = FieldIntake.of(configuration)
        self._report = FieldReport(configuration)
        self.samples: Counter[int] = Counter()
        self._unstamped: Counter[int] = Counter()
        self._n_partial = self._n_sweeps = 0

    @property
    def resets(self) -> int:
        """How often time stepped back."""
        return self._assembler.resets

    def add(
        self, messages: Sequence[Message], base_log_ns: np.ndarray, base: FloatArray
    ) -> Iterator[tuple[list[tuple[int, int, bytes]], Estimate | None]]:
        """Take messages, in the recording's order.

        Parameters
        ----------
        messages
            of magnetometers.
        base_log_ns : (m,) and base : (m, 4)
            when the IMU on the base was recorded among them, ns, and what it measured, q_WS, x y z w.

        Yields
        ------
        Id, stamp, ns, and message in CDR, with a stamp, of each that was used, and what they gave; after a step back of
        time in a new piece.
        """
        taken: list[tuple[int, int, bytes]] = []
        sweeps: list[Sweep] = []
        heard = 0
        for message in messages:
            while heard < len(base) and base_log_ns[heard] <= message.log_ns:
                self._assembler.hear_base(base[heard])
                heard += 1
            id_ = self._topics.ids[message.topic]
            if (index := self._indices.get(id_)) is None:
                continue
            sample = self._intake.take(id_, message.data)
            if sample is None:
                continue
            self.samples[id_] += 1
            stamp_ns, data = sample.stamp_ns, message.data
            if self._by_arrival or not (stamp_ns or not message.log_ns):  # a recording may begin at 0
                self._unstamped[id_] += not self._by_arrival
                stamp_ns, data = message.log_ns, with_stamp(data, message.log_ns)
            resets = self.resets
            now = self._assembler.take(index, stamp_ns, sample.field, message.log_ns)
            if self.resets != resets:
                yield taken, self._estimate([*sweeps, *now])
                taken, sweeps, now = [], [], []
            taken.append((id_, stamp_ns, data))
            sweeps += now
        for q in base[heard:]:
            self._assembler.hear_base(q)
        yield taken, self._estimate(sweeps)

    def flush(self) -> Estimate | None:
        """What the samples give that wait."""
        return self._estimate(self._assembler.flush())

    @property
    def problems(self) -> list[str]:
        """What was not as it should be, for people; complete after reading."""
        ids = list(self._indices)
        return [
            *(
                f'magnetometer {i}: {n} messages not used: damaged'
                for i, n in sorted(self._intake.unreadable.items())
            ),
            *(
                f'magnetometer {i}: {n} messages have no stamp (0); the time of their recording stands in'
                for i, n in sorted(self._unstamped.items())
                if n
            ),
            *(
                f'{n} fields not used: {about_magnetometers(why)}'
                for why, n in self._assembler.dropped.items()
            ),
            *(
                f'magnetometer {ids[k]}: {lag_in_words(lag)}'
                for k, lag in self._assembler.arrivals.lags.items()
            ),
            *(
                [f'{self._n_partial} of {self._n_sweeps} sweeps lack a magnetometer']
                if self._n_partial
                else []
            ),
            *self._report.lines,
        ]

    def _estimate(self, sweeps: Sequence[Sweep]) -> Estimate | None:
        if not sweeps:
            return None
        used = self._assembler.enabled
        self._n_sweeps += len(sweeps)
        self._n_partial += sum(not sweep.measured[used].all() for sweep in sweeps)
        estimate = self.estimator.estimate(sweeps)
        self._report.add(estimate)
        return estimate


def about_magnetometers(reason: str) -> str:
    """Why an assembler has not used samples, where these are of magnetometers."""
    return reason.replace('its IMU', 'its magnetometer')
