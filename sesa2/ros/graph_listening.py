"""What the viewer hears on the graph; of streams only the newest message is read, thirty times a second."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import rclpy.node
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, PoseArray, PoseStamped
from nav_msgs.msg import Path
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import Imu
from sesa2_msgs.msg import ImuCalibration

from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.messages.imu_messages import read_imu
from sesa2.messages.poses import read_path, read_pose, read_pose_array
from sesa2.messages.topic_names import (
    DIAGNOSTICS,
    TARGET,
    TRUTH_MARKERS,
    TRUTH_SHAPE,
    TRUTH_TIP,
    imu_calibration,
    imu_topics,
    of_model,
)
from sesa2.ros.qos import LATCHED
from sesa2.sensing.imu.bno055.scores import Scores
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS
from sesa2.viewer.live import Diagnostic, Live

_SILENT_S = 0.5  # an IMU that has said nothing for so long is drawn grey
_NO_TRUTH_S = 2.0  # a truth that has said nothing for so long is not drawn; some cameras are slow
# Of a stream only the newest message is wanted, and nobody must ever wait for a viewer.
_NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class _Newest:
    """The newest message of a topic, fetched when a frame is drawn: a callback for each message would cost far more."""

    def __init__(self, node: rclpy.node.Node, kind: type, topic: str):
        self._node = node
        self.subscription: Subscription = node.create_subscription(kind, topic, _ignore, _NEWEST, raw=True)

    def take(self) -> tuple[bytes, int] | None:
        """The bytes and when they arrived, ns; None where nothing new has come."""
        with self.subscription.handle:
            taken = self.subscription.handle.take_message(self.subscription.msg_type, True)
        return None if taken is None else (taken[0], taken[1]['received_timestamp'])

    def close(self) -> None:
        """Stop listening."""
        self._node.destroy_subscription(self.subscription)


def _ignore(_: bytes) -> None: ...


class Listener:
    """Keeps a `Live` filled.

    Streams are on a node that no executor knows, so that their messages wait until they are fetched.

    Parameters
    ----------
    node
        for what comes seldom.
    streams
        for what comes often.
    """

    def __init__(self, node: rclpy.node.Node, streams: rclpy.node.Node):
        self.live = Live()
        self.unreadable = 0
        self._node, self._streams = node, streams
        self._namespace = node.get_namespace().strip('/')
        self._results: dict[tuple[str, str], _Newest] = {}
        self._imus: dict[int, _Newest] = {}
        self._imu_topics: dict[int, str] = {}
        self._last_heard: dict[int, float] = {}
        self._calibrations: dict[int, Subscription] = {}
        self._truth_markers = _Newest(streams, PoseArray, TRUTH_MARKERS)
        self._truth_heard = {'markers': 0.0, 'shape': 0.0, 'tip': 0.0}
        self._truth_shape = _Newest(streams, Path, TRUTH_SHAPE)
        self._truth_tip = _Newest(streams, PoseStamped, TRUTH_TIP)
        node.create_subscription(DiagnosticArray, DIAGNOSTICS, self._take_diagnostics, 10)
        self._targets: Subscription | None = None

    def listen_to(self, c: Configuration) -> None:
        """Subscribe to what a configuration publishes, and to nothing else."""
        live = self.live
        live.configuration = c
        live.backbones, live.markers, live.latency_s, live.target = {}, {}, None, None
        if c.has_controller and self._targets is None:
            self._targets = self._node.create_subscription(PointStamped, TARGET, self._take_target, 10)
        kinds = {'shape': Path, 'markers': PoseArray}
        wanted = {(model, kind) for model in c.models for kind in kinds}
        for key in set(self._results) - wanted:
            self._results.pop(key).close()
        for model, kind in wanted - set(self._results):
            self._results[model, kind] = _Newest(self._streams, kinds[kind], of_model(model, kind))
        topics = imu_topics(c)
        for i in [i for i, topic in self._imu_topics.items() if topics.get(i) != topic]:
            self._imus.pop(i).close()
            self._node.destroy_subscription(self._calibrations.pop(i))
            live.sensors.pop(i, None)
            live.scores.pop(i, None)
        for i in set(topics) - set(self._imus):
            self._imus[i] = _Newest(self._streams, Imu, topics[i])
            self._calibrations[i] = self._node.create_subscription(
                ImuCalibration, imu_calibration(i), partial(self._take_calibration, i), LATCHED
            )
        self._imu_topics = topics

    def update(self) -> None:
        """Fetch the newest of every stream."""
        live, now = self.live, time.monotonic()
        for (model, kind), newest in self._results.items():
            got = self._read(newest, read_path if kind == 'shape' else read_pose_array)
            if got is None:
                continue
            poses, arrived_ns = got
            if kind == 'shape':
                live.backbones[model] = poses.poses
                live.latency_s = (arrived_ns - poses.stamp_ns) / NS
            else:
                live.markers[model] = poses.poses
        for i, newest in self._imus.items():
            if sample := self._read(newest, _orientation):
                live.sensors[i], self._last_heard[i] = sample[0], now
            elif now - self._last_heard.get(i, 0.0) > _SILENT_S:
                live.sensors.pop(i, None)
        if got := self._read(self._truth_markers, read_pose_array):
            live.truth_markers, self._truth_heard['markers'] = got[0].poses, now
        elif now - self._truth_heard['markers'] > _NO_TRUTH_S:
            live.truth_markers = None
        if got := self._read(self._truth_shape, read_path):
            live.truth_backbone, self._truth_heard['shape'] = got[0].poses, now
        elif now - self._truth_heard['shape'] > _NO_TRUTH_S:
            live.truth_backbone = None
        if got := self._read(self._truth_tip, read_pose):
            live.truth_tip, self._truth_heard['tip'] = got[0].poses[0, :3], now
        elif now - self._truth_heard['tip'] > _NO_TRUTH_S:
            live.truth_tip = None

    def _read(self, newest: _Newest, read: Callable[[bytes], Any]) -> tuple[Any, int] | None:
        taken = newest.take()
        if taken is None:
            return None
        try:
            return read(taken[0]), taken[1]
        except Sesa2Error:
            self.unreadable += 1
            return None

    def _take_calibration(self, imu: int, message: ImuCalibration) -> None:
        self.live.scores[imu] = Scores(message.sys, message.gyro, message.accel, message.mag)

    def _take_target(self, message: PointStamped) -> None:
        """Of others only what the controller takes: it is the one that complains."""
        c, p = self.live.configuration, message.point
        target = np.array([p.x, p.y, p.z])
        if c and message.header.frame_id == c.frame('base_link') and np.isfinite(target).all():
            self.live.target = target

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        now = time.monotonic()
        said = {}
        for status in message.status:
            node, _, part = status.name.partition(': ')
            namespace, _, name = node.rpartition('/')
            if namespace == self._namespace:  # else of another arm
                values = {pair.key: pair.value for pair in status.values}
                said[f'{name}: {part}'] = Diagnostic(status.level[0], status.message, values, now)
        self.live.hear(said)


def _orientation(data: bytes) -> FloatArray:
    return np.array(read_imu(data)[1:])
