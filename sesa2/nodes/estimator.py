"""The estimator: orientations of the IMUs in; joint states, markers, tip and backbone of every model out."""

import time
from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray, PoseStamped
from nav_msgs.msg import Path
from sensor_msgs.msg import Imu, JointState, MagneticField
from std_msgs.msg import String
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from sesa2.alignment.straight_pose import Alignment, align_straight
from sesa2.configuration import Configuration, files
from sesa2.configuration.kept_accelerometers import keep_accelerometers
from sesa2.errors import Sesa2Error
from sesa2.estimation.arrivals import lag_in_words
from sesa2.estimation.estimator import Estimate, Estimator
from sesa2.estimation.sweeps import Sweep
from sesa2.messages.orientation_intake import OrientationIntake, unaligned_headings
from sesa2.messages.results import TYPES, ResultMessages
from sesa2.messages.robot import describe_robot
from sesa2.messages.topic_names import CONFIGURATION, imu_data, imu_field, imu_name, of_model
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.diagnostics import ERROR, OK, WARN, Diagnostics, Part
from sesa2.ros.parameters import declare_configuration
from sesa2.ros.qos import ANY_STREAM, LATCHED, STREAM
from sesa2.ros.spinning import run_alone
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

# What of the past `~/align` looks at: the arm was straight for so long.
_POSE_NS = 3 * NS
# How often the clock is looked at for sweeps that need not wait any longer.
_LOOK_EVERY_NS = NS // 20

_CLASSES = {
    'joint_states': JointState,
    'markers': PoseArray,
    'tip': PoseStamped,
    'shape': Path,
    'marker_array': MarkerArray,
}


class EstimatorNode(ConfinedNode):
    """Publishes one result per sweep and model, stamped with the measurement's time.

    Attributes
    ----------
    intake
        makes orientations of the IMUs' messages.
    latest
        the newest estimate, of one sweep.
    aligned
        the configuration since `~/align`; None before.
    n_sweeps
        number of sweeps estimated.
    received
        number of messages of each IMU.
    """

    def __init__(self, **options: Any):
        super().__init__('estimator', automatically_declare_parameters_from_overrides=True, **options)
        self.configuration = declare_configuration(self)
        self._estimator = Estimator(self.configuration)
        self.assembler = self._estimator.assembler()
        used_ids = self.configuration.imus.used_ids
        self.intake = OrientationIntake(
            self.configuration.imus.fusion, used_ids, keep_accelerometers(self.configuration)
        )
        self.latest: Estimate | None = None
        self.aligned: Configuration | None = None
        self.n_sweeps = 0
        self._messages = ResultMessages(self.configuration, self._estimator)
        self._topics = [
            (topic, self.create_publisher(_CLASSES[topic.name.rpartition('/')[2]], topic.name, STREAM))
            # What control waits for goes first.
            for topic in sorted(self._messages.topics, key=lambda topic: topic.type != TYPES['joint_states'])
        ]
        self._configuration_publisher = self.create_publisher(String, CONFIGURATION, LATCHED)
        self._publish_configuration()
        self._description_publishers = []
        for name in self._estimator.models:
            publisher = self.create_publisher(String, of_model(name, 'robot_description'), LATCHED)
            publisher.publish(String(data=describe_robot(self.configuration, name)))
            self._description_publishers.append(publisher)

        imus = self.configuration.imus
        self._ids = imus.all_ids
        # Our own bridge and player are reliable; with other people's drivers anything that can be heard will do.
        qos = ANY_STREAM if self.configuration.run.source == 'external' else STREAM
        self._subscriptions_of_imus = [
            self.create_subscription(Imu, imu_data(i), self._take(index), qos, raw=True)
            for index, i in enumerate(self._ids)
            if i in imus.used_ids
        ]
        if self.intake.wants_fields:
            self._subscriptions_of_imus += [
                self.create_subscription(
                    MagneticField, imu_field(i), partial(self._take_field, i), qos, raw=True
                )
                for i in imus.used_ids
            ]
        self._last_refused = Counter[int]()
        self._told_refused: set[int] = set()
        self.received = Counter[int]()
        self._unreadable = 0
        self._near_singular = Counter[str]()
        self._last_report = (time.monotonic(), Counter[int](), 0)
        self._listened_ns = 0
        self._looked_ns = time.monotonic_ns()
        self._recent: deque[Sweep] = deque()
        self._align_services = [
            self.create_service(Trigger, '~/align', partial(self._align, headings=False)),
            self.create_service(Trigger, '~/align_headings', partial(self._align, headings=True)),
        ]
        self._watchdog = self.create_timer(_LOOK_EVERY_NS / NS, self._close_overdue)
        self._diagnostics = Diagnostics(self, 'arm', self._report)

    def _take(self, index: int) -> Callable[[bytes], None]:
        add, imu = self.assembler.add, self._ids[index]

        def take(data: bytes) -> None:
            self.received[imu] += 1
            arrival_ns = self._listening_clock()
            try:
                sample = self.intake.take(imu, data)
            except Sesa2Error:
                self._unreadable += 1
                return
            if sample is None:
                return
            for sweep in add(index, *sample, arrival_ns):
                self._publish(sweep)

        return take

    def _take_field(self, imu: int, data: bytes) -> None:
        try:
            self.intake.take_field(imu, data)
        except Sesa2Error:
            self._unreadable += 1

    def _listening_clock(self) -> int:
        """For how long this node has listened, ns: while it is held up, messages wait in their queues unheard."""
        now_ns = time.monotonic_ns()
        self._listened_ns += min(now_ns - self._looked_ns, 2 * _LOOK_EVERY_NS)
        self._looked_ns = now_ns
        return self._listened_ns

    def _close_overdue(self) -> None:
        """When an IMU falls silent, and when all do, no sample comes at the right time to show it."""
        for sweep in self.assembler.close_overdue(self._listening_clock()):
            self._publish(sweep)

    def _publish(self, sweep: Sweep) -> None:
        if self._recent and sweep.stamp_ns <= self._recent[-1].stamp_ns:
            self._recent.clear()  # time has stepped back: what was is not the present pose
        self._recent.append(sweep)
        while sweep.stamp_ns - self._recent[0].stamp_ns > _POSE_NS:
            self._recent.popleft()
        estimate = self._estimator.estimate([sweep])
        for topic, publisher in self._topics:
            if topic.name.endswith('/marker_array') and not publisher.get_subscription_count():
                continue
            publisher.publish(self._messages.make(topic, estimate)[0].tobytes())
        self.latest = estimate
        self.n_sweeps += 1
        for name, result in estimate.models.items():
            self._near_singular[name] += result.near_singular

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
        response.success, response.message = True, self._told(found, headings)
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

    def _publish_configuration(self) -> None:
        self._configuration_publisher.publish(String(data=files.dump(self.configuration)))

    def _report(self) -> list[Part]:
        now, before = time.monotonic(), self._last_report
        elapsed = now - before[0]
        alive, lags = self.assembler.alive, self.assembler.arrivals.lags
        base_id = self.configuration.imus.base_id
        refused = self.intake.refused
        no_base = False
        parts: list[Part] = []
        for index, imu in enumerate(self._ids):
            if imu not in self.configuration.imus.used_ids:
                parts.append((imu_name(imu), OK, 'not enabled; interpolated from its neighbours', {}))
                continue
            rate = (self.received[imu] - before[1][imu]) / elapsed
            publishers = self.count_publishers(imu_data(imu))
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
        if no_base:
            level, text = ERROR, f'no result: IMU {base_id} on the base is silent'
        elif sweeps:
            level, text = OK, f'{sweeps:.1f} Hz'
        else:
            level, text = ERROR, 'no IMU is alive'
        parts.append(('sweeps', level, text, counts))
        imus = self.configuration.imus
        if doubts := [*unaligned_headings(imus.fusion, imus.headings), *self.intake.doubts]:
            parts.append(('fusion', WARN, '; '.join(doubts), {}))
        for name, n in self._near_singular.items():
            if n:
                text = f'{n} sweeps with a joint beyond 80° about z: joint angles are near their singularity'
                parts.append((name, WARN, text, {'near_singular': n}))
        self._near_singular.clear()
        self._last_report = (now, Counter(self.received), self.n_sweeps)
        return parts


def main() -> int:
    """`ros2 run sesa2 estimator`."""
    return run_alone(EstimatorNode)


if __name__ == '__main__':
    raise SystemExit(main())
