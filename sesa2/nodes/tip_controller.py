"""The tip controller's node: feedback and targets in, commands of backbone lengths out."""

import time
from collections import Counter
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped, PoseStamped
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from sesa2.configuration import ConfigurationError, Mistake
from sesa2.control import ControlState
from sesa2.control.tip_controller import ControlError
from sesa2.errors import Sesa2Error
from sesa2.messages.imu_messages import read_imu
from sesa2.messages.length_messages import LengthIntake
from sesa2.messages.topic_names import BACKBONE_LENGTHS, COMMAND, TARGET, imu_topics, of_model
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.diagnostics import ERROR, OK, WARN, Diagnostics, Part
from sesa2.ros.parameters import declare_configuration
from sesa2.ros.qos import ANY_BURSTS, STREAM
from sesa2.ros.spinning import run_alone
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

# A step that comes late is taken for no longer than this, s.
_LONGEST_STEP_S = 0.1
_NOT_ALL = 'without all of the backbones that are driven'
_LEVELS = {
    ControlState.STOPPED: OK,
    ControlState.RUNNING: OK,
    ControlState.LIMITED: WARN,
    ControlState.HOLD: ERROR,
}


class TipControllerNode(ConfinedNode):
    """Drives the tip to `target`, from `tip_controller/start` to `tip_controller/stop`; it starts stopped.

    What goes on is told by the steady clock of receipt, whatever clock the senders have.

    Attributes
    ----------
    controller
        what it does, without ROS.
    n_commands
        number of commands published.
    """

    def __init__(self, **options: Any):
        super().__init__('tip_controller', automatically_declare_parameters_from_overrides=True, **options)
        self.configuration = c = declare_configuration(self)
        if not c.has_controller:
            raise ConfigurationError(
                [Mistake('controller.names', 'is empty, expected the backbones that are driven')],
                'tip_controller',
            )
        self.controller = c.create_controller()
        self._names = list(c.controller.names)
        self._driven = [c.lengths.names.index(name) for name in self._names]
        self._backbones = c.backbones
        self._intake = LengthIntake.of(c)
        self._tips: dict[int, FloatArray] = {}
        self._coordinates: dict[int, FloatArray] = {}
        self._n_coordinates = len(c.create_model(c.controller.model).coordinate_names)
        self._frame = c.frame('base_link')
        self._refused = Counter[str]()
        self._last_refused = 0
        self.n_commands = 0
        model = c.controller.model
        self._subscriptions_kept = [
            self.create_subscription(PointStamped, TARGET, self._take_target, STREAM),
            self.create_subscription(PoseStamped, of_model(model, 'tip'), self._take_tip, ANY_BURSTS),
            self.create_subscription(
                JointState, of_model(model, 'coordinates'), self._take_coordinates, ANY_BURSTS
            ),
            self.create_subscription(JointState, BACKBONE_LENGTHS, self._take_lengths, ANY_BURSTS, raw=True),
            *(
                self.create_subscription(Imu, topic, partial(self._take_imu, imu), ANY_BURSTS, raw=True)
                for imu, topic in imu_topics(c).items()
            ),
        ]
        kind = JointTrajectory if c.controller.output == 'joint_trajectory' else Float64MultiArray
        self._publisher = self.create_publisher(kind, COMMAND, STREAM)
        self._services = [
            self.create_service(Trigger, '~/start', self._start),
            self.create_service(Trigger, '~/stop', self._stop),
        ]
        self._diagnostics = Diagnostics(self, 'tip_controller', self._report)
        self._stepped = time.monotonic()
        self._timer = self.create_timer(1.0 / c.controller.rate, self._step)

    def close(self) -> None:
        """Leave with the arm held where it is."""
        self.controller.stop()
        self._step()

    # Called by the executor

    def _take_target(self, message: PointStamped) -> None:
        frame, p = message.header.frame_id, message.point
        if frame != self._frame:
            self._refuse(
                'target', f'target in the frame {frame!r}, expected {self._frame!r}; the one before stays'
            )
            return
        try:
            self.controller.hear_target([p.x, p.y, p.z])
        except ControlError as error:
            self._refuse('target', str(error))

    def _take_tip(self, message: PoseStamped) -> None:
        p = message.pose.position
        self._pair(_stamp(message), self._tips, np.array([p.x, p.y, p.z]))

    def _take_coordinates(self, message: JointState) -> None:
        self._pair(_stamp(message), self._coordinates, np.array(message.position))

    def _pair(self, stamp_ns: int, mine: dict[int, FloatArray], values: FloatArray) -> None:
        """Tip and coordinates of one instant make an estimate."""
        mine[stamp_ns] = values
        if stamp_ns in self._tips and stamp_ns in self._coordinates:
            tip, coordinates = self._tips[stamp_ns], self._coordinates[stamp_ns]
            for kept in (self._tips, self._coordinates):
                for old in [s for s in kept if s <= stamp_ns]:
                    del kept[old]
            if len(coordinates) == self._n_coordinates:
                self.controller.hear_estimate(time.monotonic(), stamp_ns, tip, coordinates)
            else:
                self._refuse('coordinates', f'{len(coordinates)} numbers, expected {self._n_coordinates}')
        elif len(mine) > 2 * STREAM.depth:
            mine.clear()  # one of the two topics is not there: told by the estimate that does not come

    def _take_lengths(self, data: bytes) -> None:
        now = time.monotonic()
        said = self._intake.take(data)
        if said is None:
            return
        if not set(self._driven) <= set(said.backbones):
            self._refuse(_NOT_ALL, ', '.join(self.configuration.lengths.names[k] for k in said.backbones))
            return
        raw = np.full(self._backbones.n_backbones, np.nan)
        raw[list(said.backbones)] = said.lengths[0]
        stamp_ns = int(said.stamps_ns[0]) or self.get_clock().now().nanoseconds
        try:
            self.controller.hear_lengths(now, stamp_ns, self._backbones.calibrated(raw)[self._driven])
        except ControlError as error:
            self._refuse('lengths', str(error))

    def _take_imu(self, imu_id: int, data: bytes) -> None:
        try:
            sample = read_imu(data)
        except Sesa2Error:
            return  # told and counted by the estimator
        if any(sample[1:]):
            self.controller.hear_imu(time.monotonic(), imu_id, sample[1:])

    def _refuse(self, kind: str, why: str) -> None:
        self._refused[kind] += 1
        if self._refused[kind] == 1:
            self.get_logger().warning(f'refused: {why}')

    def _step(self) -> None:
        now = time.monotonic()
        dt, self._stepped = min(now - self._stepped, _LONGEST_STEP_S), now
        before = self.controller.state
        lengths = self.controller.step(now, max(dt, 1e-4))
        if lengths is not None:
            self._publish(lengths)
        if self.controller.state is ControlState.HOLD and before is not ControlState.HOLD:
            self.get_logger().error(
                f'hold: {self.controller.reason}; tip_controller/start goes on from where the arm is'
            )

    def _publish(self, lengths: FloatArray) -> None:
        """As the driver wants them: without the scale and offset by which its own are corrected."""
        all_of_them = np.zeros(self._backbones.n_backbones)
        all_of_them[self._driven] = lengths
        positions = self._backbones.uncalibrated(all_of_them)[self._driven].tolist()
        if self.configuration.controller.output == 'float64_array':
            message = Float64MultiArray(data=positions)
        else:
            point = JointTrajectoryPoint(positions=positions)
            point.time_from_start.nanosec = round(NS / self.configuration.controller.rate)
            message = JointTrajectory(joint_names=self._names, points=[point])
        self._publisher.publish(message)
        self.n_commands += 1

    def _start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:  # noqa: ARG002
        self.controller.start()
        response.success = True
        response.message = (
            'runs' if self.controller.target is not None else 'runs; no target yet: it holds the tip'
        )
        return response

    def _stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:  # noqa: ARG002
        self.controller.stop()
        response.success, response.message = True, 'stopped'
        return response

    def _report(self) -> list[Part]:
        k = self.controller
        level, text = _LEVELS[k.state], k.state.value
        if k.reason:
            text = f'{text}: {k.reason}'
        values: dict[str, Any] = {'state': k.state.name, 'commands': self.n_commands}
        if k.reached is not None:
            values['left_mm'] = f'{1e3 * k.reached.left:.1f}'
            if k.state is ControlState.LIMITED:
                text = f'{text}, {1e3 * k.reached.left:.0f} mm are left'
        refused = self._refused.total() + self._intake.refused.total()
        if refused > self._last_refused:
            what = ', '.join([*self._refused, *self._intake.refused])
            text, level = f'{text}; {refused - self._last_refused} messages refused: {what}', max(level, WARN)
        self._last_refused = refused
        values['refused'] = refused
        for topic in (TARGET, COMMAND):
            n = self.count_publishers(topic)
            if n > 1:
                text, level = f'{text}; {n} nodes publish {topic}, expected one', max(level, WARN)
        return [('tip', level, text, values)]


def _stamp(message: PoseStamped | JointState) -> int:
    return message.header.stamp.sec * NS + message.header.stamp.nanosec


def main() -> int:
    """`ros2 run sesa2 tip_controller`."""
    return run_alone(TipControllerNode)


if __name__ == '__main__':
    raise SystemExit(main())
