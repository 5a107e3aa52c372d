"""Lengths of backbones from the graph to the sweeps, and what has to be said of them."""

import time
from collections import Counter
from collections.abc import Callable

import numpy as np
from sensor_msgs.msg import JointState

from sesa2.configuration import Configuration
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep, SweepAssembler
from sesa2.messages.length_messages import LengthIntake
from sesa2.messages.length_words import about_clocks, about_lengths
from sesa2.messages.topic_names import BACKBONE_LENGTHS
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.diagnostics import ERROR, OK, WARN, Part
from sesa2.ros.qos import ANY_BURSTS, BURSTS, telling_why_unheard
from sesa2.time import NS

_NO_STAMP = 'have no stamp (0); the time of their arrival stands in'


class LengthListening:
    """Listens to `backbone_lengths` for a node that makes sweeps.

    Parameters
    ----------
    node
        the node.
    configuration
        that has lengths.
    estimator, assembler
        of the sweeps.
    clock
        for how long the node has listened, ns.
    pass_on
        is given each sweep once it has its lengths.

    Attributes
    ----------
    sweeps
        gives sweeps their lengths.
    intake
        reads the messages.
    """

    def __init__(
        self,
        node: ConfinedNode,
        configuration: Configuration,
        estimator: Estimator,
        assembler: SweepAssembler,
        clock: Callable[[], int],
        pass_on: Callable[[Sweep], None],
    ):
        self._node, self._clock, self._pass_on = node, clock, pass_on
        self._names = configuration.lengths.names
        self._timeout = configuration.lengths.timeout
        self.intake = LengthIntake.of(configuration)
        self.sweeps = estimator.sweep_lengths(assembler)
        self._heard_ns: list[int | None] = [None] * len(self._names)
        self._unstamped = 0
        self._told: set[str] = set()
        self._taken_before = [0] * len(self._names)
        self._without_before = Counter[int]()
        self._counted_before: list[str] = []
        self._reported = time.monotonic()
        qos = ANY_BURSTS if configuration.run.source == 'external' else BURSTS
        self._subscription = node.create_subscription(
            JointState,
            BACKBONE_LENGTHS,
            self._take,
            qos,
            event_callbacks=telling_why_unheard(node, BACKBONE_LENGTHS),
            raw=True,
        )

    def put(self, sweeps: list[Sweep], arrival_ns: int) -> None:
        """Let sweeps wait, which came at a time of the clock, ns, and pass on those that need not wait any longer."""
        for sweep in self.sweeps.put(sweeps, arrival_ns):
            self._pass_on(sweep)

    def _take(self, data: bytes) -> None:
        arrival_ns = self._clock()
        said = self.intake.take(data)
        for reason, example in self.intake.example.items():
            self._tell_once(f'{BACKBONE_LENGTHS}: message not used: {reason}: {example}')
        if said is None or not len(said.stamps_ns):
            return
        stamps_ns = said.stamps_ns
        if not stamps_ns[0]:
            self._unstamped += 1
            self._tell_once(f'{BACKBONE_LENGTHS}: its messages {_NO_STAMP}')
            stamps_ns = np.array([self._node.get_clock().now().nanoseconds])
        for index in said.backbones:
            self._heard_ns[index] = arrival_ns
        # By the same clock as the IMUs, with whose lateness it is compared.
        self.sweeps.add(said.backbones, stamps_ns, said.lengths, np.array([time.monotonic_ns()]))
        self.put([], arrival_ns)

    def _tell_once(self, line: str) -> None:
        if line not in self._told:
            self._told.add(line)
            self._node.get_logger().warning(line)

    def report(self) -> Part:
        """The part `lengths` of the diagnostics."""
        now = time.monotonic()
        elapsed, self._reported = now - self._reported, now
        values: dict[str, object] = {}
        errors, rates = [], []
        for index, (name, track) in enumerate(zip(self._names, self.sweeps.tracks, strict=True)):
            rates.append((track.n_taken - self._taken_before[index]) / elapsed)
            self._taken_before[index] = track.n_taken
            values[f'{name}: rate_hz'] = f'{rates[-1]:.1f}'
            heard_ns = self._heard_ns[index]
            age = None if heard_ns is None else (self._clock() - heard_ns) / NS
            values[f'{name}: age_s'] = 'never heard' if age is None else f'{age:.2f}'
            values[f'{name}: sweeps without'] = self.sweeps.n_without[index]
            without = self.sweeps.n_without[index] - self._without_before[index]
            if age is None:
                errors.append(f'{name} was never heard')
            elif age > self._timeout:
                errors.append(f'{name} is silent for {age:.1f} s')
            elif without:
                errors.append(f'{name} had no length for {without} sweeps')
            values |= {f'{name}: dropped: {reason}': n for reason, n in track.dropped.items()}
        self._without_before = Counter(self.sweeps.n_without)
        values |= {f'refused: {reason}': n for reason, n in self.intake.refused.items()}
        counted = about_lengths(self._names, self.intake, self.sweeps)
        if self._unstamped:
            counted.append(f'{self._unstamped} messages {_NO_STAMP}')
        # What has been told and not become more is over; the counts still show it.
        doubts = [line for line in counted if line not in self._counted_before]
        self._counted_before = counted
        doubts += about_clocks(self._names, self.sweeps)
        if errors:
            publishers = self._node.count_publishers(BACKBONE_LENGTHS)
            nobody = '' if publishers else f'; nobody publishes {BACKBONE_LENGTHS}'
            text = f'{", ".join(errors)}{nobody}: no result without a length within {self._timeout:g} s'
            return 'lengths', ERROR, '; '.join([text, *doubts]), values
        text = f'{min(rates):.1f} Hz'
        return 'lengths', WARN if doubts else OK, '; '.join([text, *doubts]), values
