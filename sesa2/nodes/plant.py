"""The plant: a simulated arm that obeys commands, whose IMUs hang on virtual boards and whose truth is known."""

from collections import Counter
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray, PoseStamped
from nav_msgs.msg import Path
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from sesa2.configuration import ConfigurationError, Mistake
from sesa2.errors import Sesa2Error, shortened
from sesa2.link.clock import WallClock
from sesa2.link.virtual.configured_boards import configured_boards
from sesa2.link.virtual.live_plant import LivePlant
from sesa2.messages.topic_names import (
    BACKBONE_LENGTHS,
    COMMAND,
    TRUTH_COORDINATES,
    TRUTH_MARKERS,
    TRUTH_SHAPE,
    TRUTH_TIP,
)
from sesa2.messages.truth_messages import TruthMessages
from sesa2.plant.simulated_arm import Plant
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.diagnostics import OK, WARN, Diagnostics, Part
from sesa2.ros.parameters import declare_configuration
from sesa2.ros.qos import STREAM
from sesa2.ros.spinning import run_alone
from sesa2.shape.kinematics import create_kinematics
from sesa2.shape.rotations import FloatArray, multiply, rotate
from sesa2.time import NS

_LENGTHS_HZ = 100.0
_TRUTH_HZ = 50.0
_LOOK_EVERY_S = 0.5
_PUSH = 'plant.push'
_TRUTH_CLASSES = {
    TRUTH_TIP: PoseStamped,
    TRUTH_MARKERS: PoseArray,
    TRUTH_SHAPE: Path,
    TRUTH_COORDINATES: JointState,
}


class PlantNode(ConfinedNode):
    """Takes `command`, publishes `backbone_lengths` and the truth; the serial bridge reads its IMUs from its boards.

    The parameter `plant.push` may be set while it runs.

    Attributes
    ----------
    boards
        virtual boards on which its IMUs hang.
    n_commands
        number of commands obeyed.
    refused
        number of commands refused, by reason.
    """

    def __init__(self, **options: Any):
        super().__init__('plant', automatically_declare_parameters_from_overrides=True, **options)
        self.configuration = c = declare_configuration(self, changing=(_PUSH,))
        if not c.has_lengths:
            raise ConfigurationError([Mistake('lengths.names', 'is missing, and a plant needs it')], 'plant')
        try:
            self._live = LivePlant(c)
        except Sesa2Error as error:
            raise ConfigurationError([Mistake('plant', str(error))], 'plant') from None
        self.n_commands = 0
        self.refused: Counter[str] = Counter()
        self._last_refused = self._n_commanders = 0
        self._said_at = -1.0
        self._wall = WallClock()
        plant = self._live.plant
        ends = np.linspace(0.0, plant.segment_lengths.sum(), c.links + 1)
        self._tip = plant.places(ends[-1:])
        self._shown = plant.places([*c.markers.positions, *ends])
        coordinates = create_kinematics('pcc', plant.segment_lengths).coordinate_names
        self._messages = TruthMessages(c, len(ends), coordinates)
        self._truth_publishers = {
            topic: self.create_publisher(kind, topic, STREAM) for topic, kind in _TRUTH_CLASSES.items()
        }
        self._lengths_publisher = self.create_publisher(JointState, BACKBONE_LENGTHS, STREAM)
        self._command_subscription = self.create_subscription(JointTrajectory, COMMAND, self._obey, STREAM)
        self.add_on_set_parameters_callback(self._push)
        self.boards = configured_boards(c, self._live.motion, epoch_ns=self._live.epoch_ns, ahead=1)
        for board in self.boards:
            self.get_logger().info(f'IMUs on {board.path}')
        self._diagnostics = Diagnostics(self, 'plant', self._report)
        self._lengths_timer = self.create_timer(1.0 / _LENGTHS_HZ, self._publish_lengths)
        self._truth_timer = self.create_timer(1.0 / _TRUTH_HZ, self._publish_truth)
        self._look_timer = self.create_timer(_LOOK_EVERY_S, self._look)
        self._look()

    def close(self) -> None:
        """End the boards."""
        for board in self.boards:
            board.close()

    def tip_at(self, stamp_ns: int) -> FloatArray:
        """Where the tip truly was at a stamp of the last seconds, ns, in the frame of the results; (3,), m."""
        at = (stamp_ns - self._wall.of(self._live.epoch_ns)) / NS
        positions, _ = self._live.plant.shape(self._tip, self._live.coordinates_at(at))
        return self._in_output_frame(positions)[0]

    def open_loop_arm(self) -> tuple[Plant, tuple[str, ...]]:
        """A copy of the arm as it is now, and the names of the backbones that drive it."""
        return self._live.copied_arm(), self._live.names

    # Called by the executor

    def _obey(self, message: JointTrajectory) -> None:
        names, wanted = list(message.joint_names), list(self._live.names)
        if not wanted:
            return self._refuse('no backbone of this arm is driven', names)
        if len(message.points) != 1:
            return self._refuse('not of one point', f'{len(message.points)} points')
        if sorted(names) != sorted(wanted):
            return self._refuse(f'not for {", ".join(wanted)}', names)
        lengths = np.array(message.points[0].positions)
        if len(lengths) != len(names):
            return self._refuse('with another number of positions than names', f'{len(lengths)} positions')
        if not (np.isfinite(lengths) & (lengths > 0.0)).all():
            return self._refuse('with a length that is no positive number', lengths.tolist())
        self._live.command([lengths[names.index(name)] for name in wanted])
        self.n_commands += 1
        return None

    def _refuse(self, reason: str, got: Any) -> None:
        self.refused[reason] += 1
        if self.refused[reason] == 1:
            self.get_logger().warning(f'command {reason}, refused: {shortened(str(got))}')

    def _push(self, parameters: list[Parameter]) -> SetParametersResult:
        """Others are refused by what they are declared as: only this one may change."""
        for parameter in parameters:
            if parameter.name == _PUSH:
                bend = parameter.value
                numbers = parameter.type_ is Parameter.Type.DOUBLE_ARRAY and np.isfinite(bend).all()
                if not numbers or len(bend) != 2:
                    reason = f'{_PUSH}: got {bend}, expected two numbers, rad'
                    return SetParametersResult(successful=False, reason=reason)
                self._live.push(bend)
        return SetParametersResult(successful=True)

    def _look(self) -> None:
        self._wall.look()
        self._n_commanders = self.count_publishers(COMMAND)
        # The run's own controller is there from the start, and says nothing until it is started.
        if self._n_commanders > self.configuration.has_controller:
            self._live.obey()

    def _publish_lengths(self) -> None:
        at, lengths = self._live.said_lengths()
        if at == self._said_at:  # the timer was early or late: no step has been made since
            return
        self._said_at = at
        message = JointState(name=list(self.configuration.lengths.names), position=lengths.tolist())
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self._stamp_ns(at), NS)
        self._lengths_publisher.publish(message)

    def _publish_truth(self) -> None:
        now = self._live.now()
        coordinates = self._live.coordinates_at(now)
        positions, orientations = self._live.plant.shape(self._shown, coordinates)
        if self.configuration.arm.output_frame == 'world':
            orientations = multiply(self._live.plant.base, orientations)
        poses = np.concatenate([self._in_output_frame(positions), orientations], axis=-1)
        markers = len(self.configuration.markers.names)
        values = {
            TRUTH_TIP: poses[-1:],
            TRUTH_MARKERS: poses[:markers],
            TRUTH_SHAPE: poses[markers:],
            TRUTH_COORDINATES: coordinates,
        }
        stamp = np.array([self._stamp_ns(now)])
        for topic, publisher in self._truth_publishers.items():
            [data] = self._messages.make_truth(topic, stamp, values[topic][None])
            publisher.publish(data)

    def _stamp_ns(self, at: float) -> int:
        return self._wall.of(self._live.epoch_ns + round(at * NS))

    def _in_output_frame(self, positions: FloatArray) -> FloatArray:
        in_world = self.configuration.arm.output_frame == 'world'
        return rotate(self._live.plant.base, positions) if in_world else positions

    def _report(self) -> list[Part]:
        n = self.refused.total()
        level, text = OK, 'obeys' if self._live.obeys else 'moves by itself: nobody publishes commands'
        if n > self._last_refused:
            reasons = '; '.join(self.refused)
            level, text = WARN, f'{text}; {n - self._last_refused} commands refused: {reasons}'
        if self._n_commanders > 1:
            level, text = WARN, f'{text}; {self._n_commanders} nodes publish commands, expected one'
        self._last_refused = n
        return [('arm', level, text, {'commands': self.n_commands, 'refused': n, 'boards': len(self.boards)})]


def main() -> int:
    """`ros2 run sesa2 plant`."""
    return run_alone(PlantNode)


if __name__ == '__main__':
    raise SystemExit(main())
