"""The field source: a simulated arm with magnets that moves, as the fields of its magnetometers and as the truth."""

from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray, PoseStamped
from nav_msgs.msg import Path
from sensor_msgs.msg import JointState, MagneticField

from sesa2.estimation.estimator import Estimate, Estimator, ModelResult
from sesa2.messages.field_messages import FieldMessages
from sesa2.messages.results import ResultMessages
from sesa2.messages.topic_names import magnetometer_field, magnetometer_name
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.diagnostics import OK, Diagnostics, Part
from sesa2.ros.parameters import declare_configuration
from sesa2.ros.qos import STREAM
from sesa2.ros.spinning import run_alone
from sesa2.shape.rotations import FloatArray, multiply, rotate
from sesa2.time import NS
from sesa2.twin.magnetic_arm import MagneticArm

_TRUTH = {'tip': PoseStamped, 'markers': PoseArray, 'shape': Path, 'coordinates': JointState}


class FieldSource(ConfinedNode):
    """Publishes `magnetometer_<id>/field`, and the arm that made it on `truth/…`, both with the time of now.

    Attributes
    ----------
    arm
        the simulated one.
    n_sweeps
        number of sweeps published.
    """

    def __init__(self, **options: Any):
        super().__init__('field_source', automatically_declare_parameters_from_overrides=True, **options)
        self.configuration = c = declare_configuration(self)
        source = c.field_source
        self.arm = MagneticArm(c, source.build_errors, source.seed)
        self.n_sweeps = 0
        self._ids = [i for i in c.magnetometers.ids if i not in c.magnetometers.masked]
        self._places = [c.magnetometers.ids.index(i) for i in self._ids]
        self._makers = [FieldMessages(c.frame(magnetometer_name(i))) for i in self._ids]
        self._field_publishers = [
            self.create_publisher(MagneticField, magnetometer_field(i), STREAM) for i in self._ids
        ]
        name = self.arm.model.name
        # The truth has the form of what is estimated.
        self._messages = ResultMessages(c, Estimator(c, 'fields'))
        self._truth_publishers = [
            (topic, self.create_publisher(_TRUTH[kind], f'truth/{kind}', STREAM))
            for topic in self._messages.topics
            if topic.name.startswith(f'{name}/') and (kind := topic.name.rpartition('/')[2]) in _TRUTH
        ]
        self._began_ns = self.get_clock().now().nanoseconds
        self._timer = self.create_timer(1.0 / source.rate, self._sweep)
        self._diagnostics = Diagnostics(self, 'arm', self._report)

    def tip_at(self, stamp_ns: int) -> FloatArray:
        """Where the tip truly was at a stamp, ns, in the frame of the results, (3,), m."""
        return self._result(self._coordinates(stamp_ns)).ends[0, -1]

    def _coordinates(self, stamp_ns: int) -> FloatArray:
        return self.arm.coordinates(np.array([(stamp_ns - self._began_ns) / NS]))

    def _sweep(self) -> None:
        now_ns = self.get_clock().now().nanoseconds
        q, stamps = self._coordinates(now_ns), np.array([now_ns])
        fields = self.arm.fields(q[0])[self._places]
        for publisher, maker, field in zip(self._field_publishers, self._makers, fields, strict=True):
            publisher.publish(maker.make_fields(stamps, field[None])[0].tobytes())
        truth = Estimate(stamps, self.configuration.base[None], {self.arm.model.name: self._result(q)})
        for topic, truth_publisher in self._truth_publishers:
            truth_publisher.publish(self._messages.make(topic, truth)[0])
        self.n_sweeps += 1

    def _result(self, q: FloatArray) -> ModelResult:
        c, model = self.configuration, self.arm.model
        n = model.n_links + 1
        s = np.concatenate([model.link_ends, c.markers.positions])
        backbone = model.kinematics.backbone(q)
        positions, there = backbone.positions(s), backbone.orientations(s)
        if c.arm.output_frame == 'world':
            positions, there = rotate(c.base, positions), multiply(c.base, there)
        none = np.zeros((1, model.n_links, 4))
        return ModelResult(
            none, none, positions[:, :n], there[:, :n], positions[:, n:], there[:, n:], 0, 0, coordinates=q
        )

    def _report(self) -> list[Part]:
        return [('fields', OK, f'{self.n_sweeps} sweeps of a simulated arm', {'sweeps': self.n_sweeps})]


def main() -> int:
    """`ros2 run sesa2 field_source`."""
    return run_alone(FieldSource)


if __name__ == '__main__':
    raise SystemExit(main())
