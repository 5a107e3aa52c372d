"""Fields of magnetometers from the graph to shapes, and what has to be said of them."""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial

from sensor_msgs.msg import MagneticField

from sesa2.configuration import Configuration
from sesa2.estimation.arrivals import lag_in_words
from sesa2.estimation.estimator import Estimate, Estimator
from sesa2.estimation.field_report import DOUBTFUL, FAULTS_IN_WORDS, LOST, FieldReport
from sesa2.estimation.sweeps import NO_BASE, Sweep
from sesa2.messages.field_intake import FieldIntake
from sesa2.messages.field_messages import FIELD_TYPE
from sesa2.messages.topic_names import magnetometer_field, magnetometer_name
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.diagnostics import ERROR, OK, WARN, Part
from sesa2.ros.qos import ANY_BURSTS, BURSTS, telling_why_unheard
from sesa2.time import NS

_NO_STAMP = 'its messages have no stamp (0); the time of their arrival stands in'


class FieldListening:
    """Listens to magnetometers for the estimator's node, and makes sweeps and shapes of what they say.

    Parameters
    ----------
    node
        the node.
    configuration
        that has magnetometers.
    publish
        is given each estimate that has results.

    Attributes
    ----------
    estimator
        of the models that magnetometers feed.
    assembler
        of their sweeps.
    received
        number of messages of each magnetometer.
    n_sweeps
        number of sweeps that gave a result.
    """

    def __init__(
        self,
        node: ConfinedNode,
        configuration: Configuration,
        publish: Callable[[Estimate], None],
    ):
        self._node, self._publish = node, publish
        self._section = configuration.magnetometers
        self._by_arrival = configuration.imus.stamps == 'arrival'
        self.estimator = Estimator(configuration, 'fields')
        self.assembler = self.estimator.field_assembler()
        self._intake = FieldIntake.of(configuration)
        self._found = FieldReport(configuration)
        self.received = Counter[int]()
        self.n_sweeps = 0
        self._unstamped = Counter[int]()
        self._heard_ns: dict[int, int] = {}
        self._reported = (time.monotonic(), Counter[int](), 0)
        self._used = [i for i in self._section.ids if i not in self._section.masked]
        qos = ANY_BURSTS if configuration.run.source == 'external' else BURSTS
        self._subscriptions = [
            node.create_subscription(
                MagneticField,
                magnetometer_field(id_),
                partial(self._take, index, id_),
                qos,
                event_callbacks=telling_why_unheard(node, magnetometer_field(id_)),
                raw=True,
            )
            for index, id_ in enumerate(self._section.ids)
            if id_ in self._used
        ]

    def hear_base(self, q: Sequence[float]) -> None:
        """How the IMU on the base measured it, (4,), x y z w."""
        self.assembler.hear_base(q)

    @property
    def unheard(self) -> str:
        """Which magnetometers were never heard; empty where all were."""
        silent = [i for i in self._used if not self.received[i]]
        if not silent:
            return ''
        ids = ', '.join(map(str, silent))
        who = (
            'no magnetometer is heard' if len(silent) == len(self._used) else f'not heard: magnetometer {ids}'
        )
        topic = self._node.resolve_topic_name(magnetometer_field(silent[0]))
        return f'{who}; expected {topic}{" and so on" if silent[1:] else ""} of {FIELD_TYPE}'

    def _take(self, index: int, magnetometer: int, data: bytes) -> None:
        self.received[magnetometer] += 1
        now_ns = time.monotonic_ns()
        sample = self._intake.take(magnetometer, data)
        if sample is None:
            return
        self._heard_ns[magnetometer] = now_ns
        stamp_ns = sample.stamp_ns
        if self._by_arrival or not stamp_ns:
            if not self._by_arrival:
                if not self._unstamped[magnetometer]:
                    self._node.get_logger().warning(f'magnetometer {magnetometer}: {_NO_STAMP}')
                self._unstamped[magnetometer] += 1
            stamp_ns = int(self._node.get_clock().now().nanoseconds)
        self._estimate(self.assembler.take(index, stamp_ns, sample.field, now_ns))

    def _estimate(self, sweeps: list[Sweep]) -> None:
        for sweep in sweeps:
            estimate = self.estimator.estimate([sweep])
            self._found.add(estimate)
            if estimate.models:
                self.n_sweeps += 1
                self._publish(estimate)

    def report(self) -> list[Part]:
        """Parts of the diagnostics: each magnetometer, their sweeps, and what each model makes of them."""
        now, (before, received, n_sweeps) = time.monotonic(), self._reported
        elapsed = now - before
        parts: list[Part] = []
        lags = self.assembler.arrivals.lags
        for index, id_ in enumerate(self._section.ids):
            if id_ not in self._used:
                parts.append((magnetometer_name(id_), OK, 'masked, not used', {}))
                continue
            rate = (self.received[id_] - received[id_]) / elapsed
            parts.append(self._of_one(id_, rate, self.assembler.alive[index], lags.get(index)))
        results = (self.n_sweeps - n_sweeps) / elapsed
        parts += [self._of_sweeps(results), *(self._of_model(name) for name in self.estimator.models)]
        self._found.clear()
        self._reported = now, Counter(self.received), self.n_sweeps
        return parts

    def _of_one(self, id_: int, rate: float, alive: bool, lag: float | None) -> Part:
        level, text = OK, f'{rate:.1f} Hz'
        publishers = self._node.count_publishers(magnetometer_field(id_))
        heard_ns = self._heard_ns.get(id_)
        if publishers > 1:
            level, text = ERROR, f'{publishers} publishers on one topic, expected 1: their samples are mixed'
        elif rate == 0.0:
            level, text = WARN, 'nothing measured; the others do without it'
        elif not alive:
            level, text = WARN, f'{text}, of no use; the others do without it'
        faults = self._found.faults(id_)
        if faults and rate:
            worst = faults.most_common(1)[0][0]
            level, text = max(level, WARN), f'{text}; left out, {FAULTS_IN_WORDS[worst]}'
        if self._unstamped[id_]:
            level, text = max(level, WARN), f'{text}; {_NO_STAMP}'
        if lag is not None:
            level, text = max(level, WARN), f'{text}; {lag_in_words(lag)}'
        if n := self._intake.unreadable[id_]:
            level, text = max(level, WARN), f'{text}; {n} messages were damaged'
        values: dict[str, object] = {
            'rate_hz': f'{rate:.1f}',
            'age_s': 'never heard' if heard_ns is None else f'{(time.monotonic_ns() - heard_ns) / NS:.2f}',
            'publishers': publishers,
        }
        values |= {f'sweeps {fault.name.lower()}': n for fault, n in faults.items()}
        return magnetometer_name(id_), level, text, values

    def _of_sweeps(self, rate: float) -> Part:
        dropped = {f'dropped: {reason}': n for reason, n in self.assembler.dropped.items()}
        values = {'sweeps': self.n_sweeps, 'resets': self.assembler.resets, **dropped}
        if rate:
            return 'fields', OK, f'{rate:.1f} Hz', values
        if sum(self._found.n_lost.values()):
            return 'fields', ERROR, f'no result: {LOST}', values
        if self.assembler.base is None and self.assembler.dropped[NO_BASE]:
            return 'fields', ERROR, 'no result: the IMU on the base is not heard', values
        return 'fields', ERROR, 'no magnetometer is alive', values

    def _of_model(self, name: str) -> Part:
        n, lost, doubtful = (c[name] for c in (self._found.n, self._found.n_lost, self._found.n_doubtful))
        untold = self._found.untold(name)
        values = {'sweeps': n, 'lost': lost, 'doubtful': doubtful, 'untold': untold}
        level, texts = OK, [f'{n - lost} results']
        if lost:
            level = ERROR if lost == n else WARN
            texts.append(f'{lost} sweeps without a result: {LOST}')
        if doubtful:
            level = max(level, WARN)
            texts.append(f'{doubtful} sweeps: {DOUBTFUL}')
        if untold and lost < n:
            level = max(level, WARN)
            texts.append(f'not told by the magnetometers: {untold}')
        return f'{name} fields', level, '; '.join(texts), values
