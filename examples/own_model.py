"""A shape model of one's own, in one file: here an arm that bends in one arc from the clamp to its last IMU.

In `sesa2/shape/models/` this file would be found by itself. Anywhere else it has to be imported before a configuration
is read, as here; from then on `one_arc` is a model like any other: in `models:`, in `sesa2 check`, on the ROS graph.

    python examples/own_model.py
"""

from dataclasses import dataclass

import numpy as np

import sesa2
from sesa2.shape.models.pcc_exact import arc
from sesa2.shape.rotations import conjugate, multiply, slerp, tangent, to_rotation_vector


@dataclass(frozen=True)
class OneArcOptions(sesa2.ModelOptions):
    """A section `one_arc:` of the configuration; each field says its meaning and range, and is checked."""

    pieces: int = sesa2.parameter(16, 'links that stand for the arc on the ROS graph', low=1, high=200)


class OneArc(sesa2.Model[np.ndarray]):
    """Constant curvature over the whole arm; IMUs before the last are not looked at."""

    name = 'one_arc'
    Options = OneArcOptions

    def __init__(self, layout, options):
        super().__init__(layout, options)
        self._set_link_ends(np.linspace(0.0, layout.arm.length, options.pieces + 1))

    def _fit(self, measured):
        return Arc(self, measured.stations)

    def _precompute(self, s):
        """Once for each set of arc lengths: the part of the arc that lies before each; past the last IMU it goes on."""
        return s / self.layout.imu_positions[-1]


class Arc(sesa2.Backbone):
    """The arc of one instant, or of a batch."""

    def __init__(self, model, stations):
        self._model = model
        self._first, self._last = stations[..., :1, :], stations[..., -1:, :]
        self._turn = to_rotation_vector(multiply(self._last, conjugate(self._first)))
        self._length = model.layout.imu_positions[-1]

    def positions(self, s):
        """See Backbone."""
        part = self._model.at(s)[:, None]
        return self._length * part * arc(part * self._turn, tangent(self._first))

    def orientations(self, s):
        """See Backbone."""
        return slerp(self._first, self._last, self._model.at(s))


def main():
    """Fit an arm whose last IMU is turned by 90° about x."""
    c = sesa2.load_configuration('prototype3_8')
    model = c.create_model('one_arc')
    half = np.sqrt(0.5)
    orientations = np.tile([0.0, 0.0, 0.0, 1.0], (8, 1))
    orientations[-1] = [half, 0.0, 0.0, half]
    [end] = model.fit(sesa2.Measured(orientations)).positions([c.imus.positions[-1]])
    print('the last IMU is at', *(f'{v:+.4f}' for v in end), 'm')


if __name__ == '__main__':
    main()
