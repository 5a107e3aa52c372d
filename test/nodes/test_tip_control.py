"""The loop on a real graph: plant, serial bridge, estimator and controller, on nothing but their topics."""

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import PointStamped, PoseStamped
from processes import REPOSITORY
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from sesa2.configuration import ConfigurationError, validate
from sesa2.nodes.estimator import EstimatorNode
from sesa2.nodes.plant import PlantNode
from sesa2.nodes.serial_bridge import SerialBridge
from sesa2.nodes.tip_controller import TipControllerNode
from sesa2.ros.diagnostics import ERROR, OK, WARN
from sesa2.ros.qos import STREAM

NAMES = ['b1', 'b2', 'b3']
TARGET = (0.05, 0.03, 0.15)
EXACT = {'slip': 0.0, 'affine': 0.0, 'affine_spread': 0.0, 'hollow': 0.0, 'sag': 0.0, 'imu_errors': 0.0}


def values(**sections):
    shipped = yaml.safe_load((REPOSITORY / 'config/tri_backbone.yaml').read_text())['/**']['ros__parameters']
    shipped['controller']['feedback_timeout'] = 3.0  # a loaded machine stands still for more than 0.2 s
    return shipped | sections


class Loop:
    """All nodes of a run, and what the test says and hears."""

    def __init__(self, graph, configured, **sections):
        self.graph, self._configured = graph, configured
        self.values = given = values(**sections)
        self.controller = graph.add(TipControllerNode(parameter_overrides=configured(given)))
        self.estimate()
        self.plant = graph.add(PlantNode(parameter_overrides=configured(given)))
        served = given | {'serial': {**given['serial'], 'port': self.plant.boards[0].path}}
        self.bridge = graph.add(SerialBridge(parameter_overrides=configured(served)))
        self.targets = graph.probe.create_publisher(PointStamped, 'target', STREAM)
        self.diagnosis = graph.diagnosis()
        self.commands = graph.listen(JointTrajectory, 'command', STREAM)
        self.lengths = graph.listen(JointState, 'backbone_lengths', STREAM)
        self.truth = graph.listen(PoseStamped, 'truth/tip', STREAM)
        graph.matched('target')
        graph.until(lambda: self.estimator.n_sweeps > 20, 'shapes')

    def estimate(self):
        self.estimator = self.graph.add(EstimatorNode(parameter_overrides=self._configured(self.values)))

    def aim(self, x, y, z, frame='base_link'):
        message = PointStamped()
        message.header.frame_id = frame
        message.point.x, message.point.y, message.point.z = float(x), float(y), float(z)
        self.targets.publish(message)

    def ask(self, what):
        answer = self.graph.call(Trigger, f'tip_controller/{what}', Trigger.Request())
        assert answer.success
        return answer.message

    @property
    def state(self):
        return self.controller.controller.state.name

    @property
    def true_tip(self):
        p = self.truth[-1].pose.position
        return np.array([p.x, p.y, p.z])

    def told(self, level):
        """What diagnostics say from now on at this level."""
        part = 'tip_controller: tip'
        n = len(self.diagnosis.of(part))
        return self.graph.until(
            lambda: next((s for s in self.diagnosis.of(part)[n:] if s[0] == level), None), 'its word'
        )

    def held(self, why):
        """Wait until it holds; the last command are lengths that were measured, and then there is none."""
        self.graph.until(lambda: self.state == 'HOLD', 'a hold')
        assert why in self.controller.controller.reason
        _, text, _ = self.told(ERROR)
        assert why in text
        n = len(self.commands)
        self.told(ERROR)
        assert len(self.commands) == n
        said = np.array([m.position for m in self.lengths])
        last = np.array(self.commands[-1].points[0].positions)
        assert np.abs(said - last).max(axis=1).min() < 1e-9


@pytest.fixture
def loop(graph, configured):
    return lambda **sections: Loop(graph, configured, **sections)


def test_the_tip_goes_where_it_is_told(loop, graph):
    run = loop(plant=EXACT | {'home': [0.12], 'travel': [0.05, 0.34]})
    assert run.told(OK)[1] == 'stopped'
    assert not run.commands
    assert 'holds the tip' in run.ask('start')
    run.aim(*TARGET)
    graph.until(lambda: np.linalg.norm(run.true_tip - TARGET) < 0.006, 'the tip at its target')
    assert run.state == 'RUNNING'
    message = run.commands[-1]
    assert message.joint_names == NAMES
    assert len(message.points) == 1
    rates = np.diff([m.points[0].positions for m in run.commands], axis=0)
    assert np.abs(rates).max() < 0.06 * 0.1 + 1e-9
    assert run.ask('stop') == 'stopped'
    assert run.told(OK)[1] == 'stopped'


def test_bare_numbers(graph, configured):
    """Another arm, which takes another type, and whose shape somebody else estimates."""
    given = values(controller=values()['controller'] | {'output': 'float64_array'})
    given['run'] = given['run'] | {'source': 'external'}
    graph.add(TipControllerNode(parameter_overrides=configured(given)))
    commands = graph.listen(Float64MultiArray, 'command', STREAM)
    tips = graph.probe.create_publisher(PoseStamped, 'pcc_delta/tip', STREAM)
    coordinates = graph.probe.create_publisher(JointState, 'pcc_delta/coordinates', STREAM)
    lengths = graph.probe.create_publisher(JointState, 'backbone_lengths', STREAM)
    graph.matched('pcc_delta/tip', 'pcc_delta/coordinates', 'backbone_lengths')
    assert graph.call(Trigger, 'tip_controller/start', Trigger.Request()).success

    def commanded():
        now = graph.probe.get_clock().now().to_msg()
        tip = PoseStamped()
        tip.header.stamp, tip.pose.position.z = now, 0.15
        tips.publish(tip)
        for publisher, numbers in ((coordinates, [0.0, 0.0, 0.15]), (lengths, [0.15] * 3)):
            message = JointState(name=NAMES, position=numbers)
            message.header.stamp = now
            publisher.publish(message)
        return commands

    graph.until(commanded, 'a command')
    np.testing.assert_allclose(commands[0].data, 0.15, atol=1e-9)


def test_targets_that_are_none_are_told_and_counted(loop, graph):
    run = loop()
    run.ask('start')
    run.aim(*TARGET)
    graph.until(lambda: run.controller.controller.target is not None, 'the target')
    for wrong in ((np.nan, 0, 0.1), (0, 0, 0), (0.05, 0, -0.05)):
        run.aim(*wrong)
    run.aim(*TARGET, frame='world')
    graph.until(lambda: run.controller._refused['target'] == 4, 'four refusals')
    np.testing.assert_array_equal(run.controller.controller.target, TARGET)
    run.aim(0.0, 0.6, 0.2)
    graph.until(lambda: run.state == 'LIMITED', 'a limit')
    _, text, parts = run.told(WARN)
    assert 'out of reach' in text
    assert float(parts['left_mm']) > 200.0


def test_without_the_estimator_it_holds_and_starts_again(loop, graph):
    run = loop()
    run.ask('start')
    run.aim(*TARGET)
    graph.until(lambda: len(run.commands) > 20, 'commands')
    graph.remove(run.estimator)
    run.held('the estimate of the tip: nothing new')
    run.estimate()
    graph.until(lambda: run.estimator.n_sweeps > 20, 'shapes again')
    n = len(run.commands)
    where = np.array(run.lengths[-1].position)
    run.ask('start')
    graph.until(lambda: len(run.commands) > n, 'commands again')
    assert np.abs(np.array(run.commands[n].points[0].positions) - where).max() < 0.002


def test_a_second_commander_is_told(loop, graph):
    run = loop()
    graph.probe.create_publisher(JointTrajectory, 'command', STREAM)
    graph.until(lambda: '2 nodes publish command' in run.told(WARN)[1], 'a warning')


def test_a_frozen_imu(loop, graph, monkeypatch):
    run = loop()
    run.ask('start')
    run.aim(*TARGET)
    graph.until(lambda: np.linalg.norm(run.true_tip - TARGET) < 0.04, 'the tip about there')
    # What the chip says stands still; everything behind it goes on.
    plant = run.plant._live.plant
    still = plant.imu_orientations_at(plant.time)
    monkeypatch.setattr(
        plant, 'imu_orientations_at', lambda t: np.broadcast_to(still, (*np.shape(t), *still.shape))
    )
    run.aim(-0.06, -0.02, 0.14)
    run.held('IMU 2 is frozen')


def test_leaving_it_holds_the_arm(loop, graph):
    run = loop()
    run.ask('start')
    run.aim(*TARGET)
    graph.until(lambda: len(run.commands) > 20, 'commands')
    n = len(run.commands)
    graph.remove(run.controller)
    graph.until(lambda: len(run.commands) > n, 'a last command')
    last = np.array(run.commands[-1].points[0].positions)
    said = np.array([m.position for m in run.lengths])
    assert np.abs(said - last).max(axis=1).min() < 1e-9


@pytest.mark.parametrize(
    ('controller', 'place'),
    [
        ({'names': ['b1', 'b2', 'x']}, 'controller.names[2]'),
        ({'names': ['b1', 'b2']}, 'controller'),
        ({'names': []}, 'controller.names'),
        ({'names': NAMES, 'model': 'pcc_exact'}, 'controller.model'),
        ({'names': NAMES, 'model': 'pcc'}, 'controller.model'),
        ({'names': NAMES, 'length_limits': [0.3, 0.1]}, 'controller.length_limits'),
        ({'names': NAMES, 'length_limits': [0.3, 0.4]}, 'controller'),
        ({'names': NAMES, 'law': 'magic'}, 'controller.law'),
        ({'names': NAMES, 'output': 'float64_array'}, 'controller.output'),
    ],
)
def test_sections_that_are_wrong(controller, place):
    with pytest.raises(ConfigurationError) as raised:
        validate(values(controller={'gain': 2.0, **controller}))
    assert place in [mistake.place for mistake in raised.value.mistakes]
