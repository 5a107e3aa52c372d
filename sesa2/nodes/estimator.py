"""The estimator: what IMUs and magnetometers measure in; joint states, markers, tip and backbone of every model out."""

import time
from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray, PoseStamped
from nav_msgs.msg import Path
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from sensor_msgs.msg import Imu, JointState, MagneticField
from std_msgs.msg import String
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from sesa2.alignment.earth_frame import BaseComparison
from sesa2.alignment.straight_pose import Alignment, align_straight
from sesa2.configuration import Configuration, files
from sesa2.errors import Sesa2Error
from sesa2.estimation.arrivals import lag_in_words
from sesa2.estimation.estimator import Estimate, Estimator
from sesa2.estimation.left_twist import LeftTwist
from sesa2.estimation.stuck import stuck_in_words, stuck_spans
from sesa2.estimation.sweeps import Sweep
from sesa2.messages.header_bytes import read_stamp, with_stamp
from sesa2.messages.orientation_intake import OrientationIntake, unaligned_headings
from sesa2.messages.results import TYPES, ResultMessages, ResultTopic
from sesa2.messages.robot import describe_robot
from sesa2.messages.topic_names import CONFIGURATION, imu_fields, imu_name, imu_topics, of_model
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.diagnostics import ERROR, OK, WARN, Diagnostics, Part
from sesa2.ros.field_listening import FieldListening
from sesa2.ros.hand_over import HandOver
from sesa2.ros.length_listening import LengthListening
from sesa2.ros.parameters import declare_configuration, origin_of
from sesa2.ros.qos import ANY_BURSTS, BURSTS, LATCHED, STREAM, telling_why_unheard
from sesa2.ros.spinning import run_alone
from sesa2.ros.unheard_imus import PATIENCE_S, why_unheard
from sesa2.sensing.lengths import NO_LENGTHS, outside_in_words
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

# What of the past `~/align` looks at: the arm was straight for so long.
_POSE_NS = 3 * NS
_EVERY_TENTH = 10  # of the sweeps tells as well how the arm stands

# Stamps that go on by so many times more or less than time does are in another unit, if there are enough of them.
_FACTOR, _ENOUGH = 20.0, 20

# How often the clock is looked at for sweeps that need not wait for lengths any longer.
_LOOK_EVERY_NS = NS // 20

# What an alignment changes.
_ALIGNED = ('imus.mount_orientations', 'imus.headings')

_NO_STAMP = 'its messages have no stamp (0); the time of their arrival stands in'

_CLASSES = {
    'joint_states': JointState,
    'coordinates': JointState,
    'markers': PoseArray,
    'tip': PoseStamped,
    'shape': Path,
    'marker_array': MarkerArray,
}


class EstimatorNode(ConfinedNode):
    """Publishes one result per sweep and model, stamped with the measurement's time.

    Parameters
    ----------
    hand_over
        what the IMUs' messages come by; None: from their topics.

    Attributes
    ----------
    intake
        makes orientations of the IMUs' messages.
    latest
        the newest estimate, of one sweep.
    aligned
        the configuration since `~/align`; None before.
    fields
        listens to magnetometers, where a model needs these.
    n_sweeps
        number of sweeps of IMUs estimated.
    received
        number of messages of each IMU.
    unstamped
        number of those without a stamp.
    """

    def __init__(self, hand_over: HandOver | None = None, **options: Any):
        super().__init__('estimator', automatically_declare_parameters_from_overrides=True, **options)
        self.configuration = declare_configuration(self, changing=_ALIGNED)
        self._origin = origin_of(self)
        self._saved = ''  # as written last
        self._estimator = Estimator(self.configuration)
        self.assembler = self._estimator.assembler()
        self.intake = OrientationIntake.of(self.configuration)
        self.latest: Estimate | None = None
        self.aligned: Configuration | None = None
        self.n_sweeps = 0
        self._listened_ns = 0
        self._looked_ns = time.monotonic_ns()
        self.fields = (
            FieldListening(self, self.configuration, self._publish_fields)
            if self.configuration.models_of('fields')
            else None
        )
        self._messages = ResultMessages(self.configuration, self._estimator)
        self._outlets = self._make_outlets(self._messages)
        models = dict(self._estimator.models)
        if self.fields is not None:
            self._field_messages = ResultMessages(self.configuration, self.fields.estimator)
            self._field_outlets = self._make_outlets(self._field_messages)
            models |= self.fields.estimator.models
        self._configuration_publisher = self.create_publisher(String, CONFIGURATION, LATCHED)
        self._publish_configuration()
        self._description_publishers = []
        for name in models:
            publisher = self.create_publisher(String, of_model(name, 'robot_description'), LATCHED)
            publisher.publish(String(data=describe_robot(self.configuration, name)))
            self._description_publishers.append(publisher)
        for name, model in models.items():
            for doubt in model.doubts:
                self.get_logger().warning(f'{name}: {doubt}')

        imus = self.configuration.imus
        self._ids = imus.all_ids
        self._imu_topics = imu_topics(self.configuration)
        # Our own bridge and player are reliable; with other people's drivers anything that can be heard will do.
        qos = ANY_BURSTS if self.configuration.run.source == 'external' else BURSTS
        self._hand_over = hand_over
        taken: list[tuple[type, str, Callable[[bytes], None]]] = [
            (Imu, self._imu_topics[i], self._take(index))
            for index, i in enumerate(self._ids)
            if i in imus.used_ids
        ]
        if self.intake.wants_fields:
            taken += [
                (MagneticField, topic, partial(self._take_field, i))
                for i, topic in imu_fields(self.configuration).items()
                if i in imus.used_ids
            ]
        for kind, topic, callback in taken:
            if hand_over:
                hand_over.listen(self, topic, callback)
            else:
                events = telling_why_unheard(self, topic) if kind is Imu else None
                self.create_subscription(kind, topic, callback, qos, event_callbacks=events, raw=True)
        self._newest_ns: dict[int, int] = {}  # stamp of each IMU, and as it was at the last report
        self._reported_ns: dict[int, int] = {}
        self._lengths = (
            LengthListening(
                self,
                self.configuration,
                self._estimator,
                self.assembler,
                self._listening_clock,
                self._publish,
            )
            if self.configuration.has_lengths
            else None
        )
        self._last_refused = Counter[int]()
        self._told_refused: set[int] = set()
        self.received = Counter[int]()
        self.unstamped = Counter[int]()
        self._told_against_base = False
        self._unreadable = 0
        self._near_singular = Counter[str]()
        self._fallen_back = Counter[str]()
        self._left_twists: dict[str, LeftTwist] = {}
        self._without_lengths = 0
        self._outside_stretch = Counter[int]()
        self._last_report = (time.monotonic(), Counter[int](), 0)
        if self._lengths is not None:
            self._watchdog = self.create_timer(_LOOK_EVERY_NS / NS, self._look_for_lengths)
        self._recent: deque[Sweep] = deque()
        self._align_services = [
            self.create_service(Trigger, '~/align', partial(self._align, headings=False)),
            self.create_service(Trigger, '~/align_headings', partial(self._align, headings=True)),
        ]
        self._save_service = self.create_service(Trigger, '~/save', self._save)
        self._aligning = False
        self.add_on_set_parameters_callback(self._refuse_from_outside)
        self._diagnostics = Diagnostics(self, 'arm', self._report)
        if self.configuration.run.source == 'external':  # ours say themselves what they miss
            self._first_look = self.create_timer(PATIENCE_S, self._tell_unheard)

    def _make_outlets(self, messages: ResultMessages) -> list[tuple[ResultTopic, Publisher]]:
        """A publisher of each topic; what control waits for goes first."""
        topics = sorted(messages.topics, key=lambda topic: topic.type != TYPES['joint_states'])
        return [
            (topic, self.create_publisher(_CLASSES[topic.name.rpartition('/')[2]], topic.name, STREAM))
            for topic in topics
        ]

    def _take(self, index: int) -> Callable[[bytes], None]:
        add, imu = self.assembler.add, self._ids[index]
        by_arrival, base_id = self.configuration.imus.stamps == 'arrival', self.configuration.imus.base_id

        def take(data: bytes) -> None:
            self.received[imu] += 1
            now_ns = time.monotonic_ns()
            try:
                if by_arrival or not read_stamp(data):
                    data = with_stamp(data, self._time_of_arrival(imu, read_stamp(data)))
                sample = self.intake.take(imu, data)
            except Sesa2Error:
                self._unreadable += 1
                return
            if sample is None:
                return
            self._newest_ns[imu] = sample[0]
            if self.fields is not None and imu == base_id:
                self.fields.hear_base(sample[1:])
            if sweeps := add(index, *sample, now_ns):
                self._put(sweeps)

        return take

    def _put(self, sweeps: list[Sweep]) -> None:
        """Publish sweeps, those of an arm whose lengths are measured once they have theirs."""
        if self._lengths is not None:
            self._lengths.put(sweeps, self._listening_clock())
            return
        for sweep in sweeps:
            self._publish(sweep)

    @property
    def unheard(self) -> str:
        """Which IMUs and magnetometers were never heard, and what is on the graph; empty where all were."""
        topics = {i: self._imu_topics[i] for i in self.configuration.imus.used_ids}
        fields = self.fields.unheard if self.fields else ''
        return '; '.join(filter(None, [why_unheard(self, topics, self.received), fields]))

    def _tell_unheard(self) -> None:
        """Once: waiting goes on, since a driver may come yet."""
        self._first_look.cancel()
        if unheard := self.unheard:
            self.get_logger().warning(f'{unheard}; waiting for them')

    def _time_of_arrival(self, imu: int, stamp_ns: int) -> int:
        """Now, ns, in place of a stamp; that a message has none is told once an IMU."""
        if not stamp_ns and self.configuration.imus.stamps != 'arrival':
            if not self.unstamped[imu]:
                self.get_logger().warning(f'IMU {imu}: {_NO_STAMP}')
            self.unstamped[imu] += 1
        return int(self.get_clock().now().nanoseconds)

    def _take_field(self, imu: int, data: bytes) -> None:
        try:
            if self.configuration.imus.stamps == 'arrival' or not read_stamp(data):
                data = with_stamp(data, int(self.get_clock().now().nanoseconds))
            self.intake.take_field(imu, data)
        except Sesa2Error:
            self._unreadable += 1

    def _listening_clock(self) -> int:
        """For how long this node has listened, ns: while it is held up, messages wait in their queues unheard."""
        now_ns = time.monotonic_ns()
        self._listened_ns += min(now_ns - self._looked_ns, 2 * _LOOK_EVERY_NS)
        self._looked_ns = now_ns
        return self._listened_ns

    def _look_for_lengths(self) -> None:
        """Sweeps whose lengths will not come any more need not wait, though no sample comes to show it."""
        self._put([])

    def _publish(self, sweep: Sweep) -> None:
        if self._recent and sweep.stamp_ns <= self._recent[-1].stamp_ns:
            self._recent.clear()  # time has stepped back: what was is not the present pose
        self._recent.append(sweep)
        while sweep.stamp_ns - self._recent[0].stamp_ns > _POSE_NS:
            self._recent.popleft()
        estimate = self._estimator.estimate([sweep])
        self._without_lengths += estimate.without_lengths
        if not estimate.models:
            return
        self._send(self._outlets, self._messages, estimate)
        self.latest = estimate
        self.n_sweeps += 1
        for name, result in estimate.models.items():
            self._near_singular[name] += result.near_singular
            self._fallen_back[name] += result.fallen_back
            if result.twists is not None:
                self._left_twists.setdefault(name, LeftTwist()).add(result.twists)
        self._outside_stretch.update(dict(enumerate(estimate.outside_stretch.tolist())))

    def _publish_fields(self, estimate: Estimate) -> None:
        self._send(self._field_outlets, self._field_messages, estimate)
        if not self._estimator.models:
            self.latest = estimate
        for name, result in estimate.models.items():
            self._near_singular[name] += result.near_singular

    def _send(
        self, outlets: list[tuple[ResultTopic, Publisher]], messages: ResultMessages, estimate: Estimate
    ) -> None:
        for topic, publisher in outlets:
            if publisher.get_subscription_count():
                publisher.publish(messages.make(topic, estimate)[0])

    def _align(
        self, request: Trigger.Request, response: Trigger.Response, *, headings: bool
    ) -> Trigger.Response:
        """`~/align`: the arm has been straight for some seconds; take the mountings from that, and use them at once.

        `~/align_headings`: the headings too; in the fusion mode IMU every chip starts with one of its own.
        """
        del request
        sweeps = list(self._recent)
        if not sweeps:
            response.message = 'no sweep has been measured yet'
            return response
        c = self.configuration
        try:
            found = align_straight(
                np.stack([s.orientations for s in sweeps]),
                np.stack([s.measured for s in sweeps]),
                self._estimator.bases(sweeps),
                c.mountings,
                c.headings,
                ids=c.imus.ids,
                correct_headings=headings,
            )
        except Sesa2Error as error:
            response.message = str(error)
            return response
        self.configuration = self.aligned = c.with_alignment(found.mountings, found.headings)
        self._estimator = Estimator(self.configuration)
        self._publish_configuration()
        self._show_alignment()
        response.success, response.message = True, self._told(found, headings)
        return response

    def _show_alignment(self) -> None:
        """The parameters say what is in force."""
        flat = self.configuration.flat()
        self._aligning = True
        self.set_parameters([Parameter(path, value=list(flat[path])) for path in _ALIGNED])
        self._aligning = False

    def _refuse_from_outside(self, parameters: list[Parameter]) -> SetParametersResult:
        if self._aligning or not any(p.name in _ALIGNED for p in parameters):
            return SetParametersResult(successful=True)
        return SetParametersResult(successful=False, reason='read-only: estimator/align changes it')

    def _save(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """`~/save`: the configuration as it is in force, beside the file that it came from, which stays as it is."""
        del request
        if self._origin is None:
            response.message = (
                'it is not known which file the configuration came from; `sesa2 run --config FILE` and '
                '--params-file FILE tell'
            )
            return response
        path = self._origin.with_name(f'{self._origin.stem}_aligned.yaml')
        text = files.dump(self.configuration)
        try:
            files.save(path, text, instead_of=self._saved)
        except Sesa2Error as error:
            response.message = str(error)
            return response
        replaced = ', in place of what was saved there before' if self._saved else ''
        self._saved = text
        response.success = True
        response.message = f'saved in {path}{replaced}; {self._origin} stays as it is'
        return response

    def _told(self, found: Alignment, headings: bool) -> str:
        """What an alignment has found, in a sentence."""

        def each(values: FloatArray, form: str) -> str:
            ids = self.configuration.imus.ids
            return ', '.join(f'{v:{form}}° (IMU {i})' for i, v in zip(ids, np.rad2deg(values), strict=True))

        text = 'mountings corrected by ' + each(np.linalg.norm(found.corrections[:, :2], axis=1), '.1f')
        if headings:
            text += '; headings by ' + each(found.corrections[:, 2], '+.1f')
        text += f'; spread {np.rad2deg(np.nanmax(found.spread)):.2f}° at most'
        return '; '.join([text, *found.doubts(self.configuration.imus.ids)])

    def _compared_with_base(self) -> str:
        """What may be wrong where all IMUs have pointed against the base; logged when it is seen first."""
        some = list(self._recent)[::_EVERY_TENTH]
        doubt = self._estimator.compare(some, BaseComparison()).doubt
        if doubt and not self._told_against_base:
            self.get_logger().warning(doubt)
        self._told_against_base = bool(doubt)
        return doubt

    def _publish_configuration(self) -> None:
        self._configuration_publisher.publish(String(data=files.dump(self.configuration)))

    def _stuck_now(self) -> dict[int, float]:
        """IMUs that have been stuck until now, by index, and for how long at least, s."""
        if not self._recent:
            return {}
        stamps = np.array([s.stamp_ns for s in self._recent]) / NS
        orientations = np.stack([s.orientations for s in self._recent])
        spans = stuck_spans(stamps, orientations, np.stack([s.measured for s in self._recent]))
        return {i: own[-1][1] - own[-1][0] for i, own in enumerate(spans) if own and own[-1][1] == stamps[-1]}

    def _stamps_astray(self, imu: int, elapsed: float) -> str:
        """What is to be said of a driver's stamps that do not go as time does, since the last report."""
        if self.configuration.run.source != 'external' or imu not in self._reported_ns:
            return ''
        advanced = (self._newest_ns[imu] - self._reported_ns[imu]) / NS
        if elapsed / _FACTOR < advanced < elapsed * _FACTOR:
            return ''
        return (
            f'its stamps went on by {advanced:.2g} s in {elapsed:.2g} s: in another unit? imus.stamps: arrival takes '
            'the time of arrival'
        )

    def _report(self) -> list[Part]:
        now, before = time.monotonic(), self._last_report
        elapsed = now - before[0]
        alive, lags = self.assembler.alive, self.assembler.arrivals.lags
        base_id = self.configuration.imus.base_id
        refused = self.intake.refused
        no_base = False
        stuck = self._stuck_now()
        parts: list[Part] = []
        for index, imu in enumerate(self._ids):
            if imu not in self.configuration.imus.used_ids:
                parts.append((imu_name(imu), OK, 'not enabled; interpolated from its neighbours', {}))
                continue
            rate = (self.received[imu] - before[1][imu]) / elapsed
            publishers = self.count_publishers(self._imu_topics[imu])
            level, text = OK, f'{rate:.1f} Hz'
            if publishers > 1:
                level, text = (
                    ERROR,
                    f'{publishers} publishers on one topic, expected 1: their samples are mixed',
                )
            elif (rate == 0.0 or not alive[index]) and imu == base_id:
                no_base = True
                level, text = ERROR, 'nothing measured; without the IMU on the base there is no shape'
            elif rate == 0.0 or not alive[index]:
                level, text = WARN, 'nothing measured; interpolated from its neighbours'
            elif stuck.get(index):
                level, text = WARN, stuck_in_words(stuck[index])
            if self.unstamped[imu]:
                level, text = max(level, WARN), f'{text}; {_NO_STAMP}'
            if rate * elapsed >= _ENOUGH and (astray := self._stamps_astray(imu, elapsed)):
                level, text = max(level, WARN), f'{text}; {astray}'
            n_refused = sum(refused.get(imu, Counter()).values())
            if n_refused - self._last_refused[imu] > (self.received[imu] - before[1][imu]) // 2:
                level, text = max(level, WARN), f'{rate:.1f} Hz, of no use: {self.intake.why(imu)}'
                if imu not in self._told_refused:
                    self._told_refused.add(imu)
                    self.get_logger().warning(f'IMU {imu}: {self.intake.why(imu)}')
            self._last_refused[imu] = n_refused
            if index in lags:
                level, text = max(level, WARN), f'{text}; {lag_in_words(lags[index])}'
            parts.append((imu_name(imu), level, text, {'rate_hz': f'{rate:.1f}', 'publishers': publishers}))
        self._reported_ns = dict(self._newest_ns)
        sweeps = (self.n_sweeps - before[2]) / elapsed
        dropped = {f'dropped: {reason}': n for reason, n in self.assembler.dropped.items()}
        for reasons in refused.values():
            for reason, n in reasons.items():
                dropped[f'dropped: {reason}'] = dropped.get(f'dropped: {reason}', 0) + n
        counts = {
            'sweeps': self.n_sweeps,
            'resets': self.assembler.resets,
            'unreadable': self._unreadable,
            **dropped,
        }
        if self._hand_over and self._hand_over.lost:
            counts['dropped: came faster than they could be taken'] = self._hand_over.lost
        if no_base:
            level, text = ERROR, f'no result: IMU {base_id} on the base is silent'
        elif sweeps:
            level, text = OK, f'{sweeps:.1f} Hz'
        elif self._without_lengths or (self._lengths is not None and self._lengths.sweeps.waiting):
            level, text = ERROR, f'no result: {NO_LENGTHS}'
        else:
            level, text = ERROR, 'no IMU is alive'
        if self._recent and (doubt := self._compared_with_base()):
            level, text = max(level, WARN), f'{text}; {doubt}'
        if self._ids:
            parts.append(('sweeps', level, text, counts))
        if self.fields is not None:
            parts += self.fields.report()
        if self._lengths is not None:
            parts.append(self._lengths.report())
        imus = self.configuration.imus
        if doubts := [*unaligned_headings(imus.fusion, imus.headings), *self.intake.doubts]:
            parts.append(('fusion' if self.intake.fuses else 'orientations', WARN, '; '.join(doubts), {}))
        for name, n in self._near_singular.items():
            if n:
                text = f'{n} sweeps with a joint beyond 80° about z: joint angles are near their singularity'
                parts.append((name, WARN, text, {'near_singular': n}))
        self._near_singular.clear()
        for name, n in self._fallen_back.items():
            if n:
                text = f'{n} sweeps could not be solved and are arcs: neighbouring IMUs differ by half a turn'
                parts.append((name, WARN, text, {'fallen_back': n}))
        self._fallen_back.clear()
        for name, left in self._left_twists.items():
            model = self._estimator.models[name]
            degrees = {f'segment_{k}_deg': f'{d:.1f}' for k, d in enumerate(np.rad2deg(left.rms), start=1)}
            parts.append((f'{name} twist', WARN if left.is_much else OK, left.told(model), degrees))
        self._left_twists.clear()
        if n := self._without_lengths:
            text = f'{n} sweeps without a result: {NO_LENGTHS}'
            parts.append(('segments', ERROR, text, {'without_lengths': n}))
        elif outside := {k: n for k, n in self._outside_stretch.items() if n}:
            text = '; '.join(f'{outside_in_words(k)}: {n} results' for k, n in outside.items())
            parts.append(('segments', WARN, text, {'outside_stretch': sum(outside.values())}))
        self._without_lengths = 0
        self._outside_stretch.clear()
        self._last_report = (now, Counter(self.received), self.n_sweeps)
        return parts


def main() -> int:
    """`ros2 run sesa2 estimator`."""
    return run_alone(EstimatorNode)


if __name__ == '__main__':
    raise SystemExit(main())
