"""The field source: a simulated arm with magnets that moves, as the fields of its magnetometers and as the truth."""

from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray, PoseStamped
from nav_msgs.msg import Path
from sensor_msgs.msg import JointState, MagneticField

from sesa2.messages.field_messages import FieldMessages
from sesa2.messages.topic_names import (
    TRUTH_COORDINATES,
    TRUTH_MARKERS,
    TRUTH_SHAPE,
    TRUTH_TIP,
    magnetometer_field,
    magnetometer_name,
)
from sesa2.messages.truth_messages import TruthMessages
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.diagnostics import OK, Diagnostics, Part
from sesa2.ros.parameters import declare_configuration
from sesa2.ros.qos import STREAM
from sesa2.ros.spinning import run_alone
from sesa2.shape.rotations import FloatArray, multiply, rotate
from sesa2.time import NS
from sesa2.twin.magnetic_arm import MagneticArm


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
        source, ids = c.field_source, c.magnetometers.ids
        self.arm = MagneticArm(c, source.build_errors, source.seed)
        self.n_sweeps = 0
        self._played = [
            (
                ids.index(i),
                FieldMessages(c.frame(magnetometer_name(i))),
                self.create_publisher(MagneticField, magnetometer_field(i), STREAM),
            )
            for i in ids
            if i not in c.magnetometers.masked
        ]
        model = self.arm.model
        self._truth_messages = TruthMessages(c, model.n_links + 1, model.coordinate_names)
        self._truth_publishers = {
            topic: self.create_publisher(kind, topic, STREAM)
            for topic, kind in (
                (TRUTH_TIP, PoseStamped),
                (TRUTH_MARKERS, PoseArray),
                (TRUTH_SHAPE, Path),
                (TRUTH_COORDINATES, JointState),
            )
        }
        self._began_ns = self.get_clock().now().nanoseconds
        self._timer = self.create_timer(1.0 / source.rate, self._sweep)
        self._diagnostics = Diagnostics(self, 'arm', self._report)

    def tip_at(self, stamp_ns: int) -> FloatArray:
        """Where the tip truly was at a stamp, ns, in the frame of the results, (3,), m."""
        return self._poses(self._coordinates(stamp_ns), [self.configuration.arm.length])[0, :3]

    def _coordinates(self, stamp_ns: int) -> FloatArray:
        return self.arm.coordinates(np.array([(stamp_ns - self._began_ns) / NS]))[0]

    def _sweep(self) -> None:
        now_ns = self.get_clock().now().nanoseconds
        q, stamps = self._coordinates(now_ns), np.array([now_ns])
        fields = self.arm.fields(q)
        for place, maker, publisher in self._played:
            publisher.publish(maker.make_fields(stamps, fields[place][None])[0].tobytes())
        shape = self._poses(q, self.arm.model.link_ends)
        truth = {
            TRUTH_TIP: shape[-1],
            TRUTH_MARKERS: self._poses(q, self.configuration.markers.positions),
            TRUTH_SHAPE: shape,
            TRUTH_COORDINATES: q,
        }
        for topic, values in truth.items():
            message = self._truth_messages.make_truth(topic, stamps, values[None])[0]
            self._truth_publishers[topic].publish(message)
        self.n_sweeps += 1

    def _poses(self, q: FloatArray, places: Any) -> FloatArray:
        """Poses in the frame of the results, (n, 7): position, m, and orientation, x y z w."""
        backbone, s = self.arm.model.kinematics.backbone(q), np.asarray(places, dtype=float)
        positions, there = backbone.positions(s), backbone.orientations(s)
        if self.configuration.arm.output_frame == 'world':
            base = self.configuration.base
            positions, there = rotate(base, positions), multiply(base, there)
        return np.concatenate([positions, there], axis=-1)

    def _report(self) -> list[Part]:
        return [('fields', OK, f'{self.n_sweeps} sweeps of a simulated arm', {'sweeps': self.n_sweeps})]


def main() -> int:
    """`ros2 run sesa2 field_source`."""
    return run_alone(FieldSource)


if __name__ == '__main__':
    raise SystemExit(main())
