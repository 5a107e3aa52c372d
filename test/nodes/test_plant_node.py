"""The plant on a real graph: commands in, encoders and truth out, its IMUs over the board's own protocol."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseArray, PoseStamped
from nav_msgs.msg import Path
from processes import failed_clearly, node
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from scipy.spatial.transform import Rotation, Slerp
from sensor_msgs.msg import Imu, JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from sesa2.configuration import ConfigurationError, files, validate
from sesa2.nodes.plant import PlantNode
from sesa2.nodes.serial_bridge import SerialBridge
from sesa2.ros.qos import STREAM
from sesa2.shape.kinematics import create_kinematics

NAMES = ['b1', 'b2', 'b3']
# Lengths for bend_x 0.6, bend_y −0.3 and 180 mm: l = L − d (bend_x cos φ + bend_y sin φ).
Q = np.array([0.6, -0.3, 0.18])
ANGLES = np.array([0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0])
WANTED = Q[2] - 0.03 * (Q[0] * np.cos(ANGLES) + Q[1] * np.sin(ANGLES))
GEOMETRY = {
    'slip': 0.0,
    'affine': 0.0,
    'affine_spread': 0.0,
    'hollow': 0.0,
    'sag': 0.0,
    'encoder_step': 0.0,
    'imu_errors': 0.0,
}
TILTED = Rotation.from_rotvec([0.4, -0.9, 0.2])


def values(plant=GEOMETRY, **sections):
    return {
        'arm': {'length': 0.16, 'base_orientation': TILTED.as_quat().tolist()},
        'segments': {'lengths': [0.16], 'stretch': [0.75, 1.5]},
        'lengths': {'names': NAMES, 'angles': ANGLES.tolist(), 'radii': [0.03]},
        'imus': {'ids': [2], 'positions': [0.16], 'base_id': 1},
        'markers': {'names': ['M1', 'tip'], 'positions': [0.08, 0.16]},
        'models': ['pcc_exact'],
        'links': 8,
        'plant': {'home': [0.12], 'travel': [0.05, 0.34], **plant},
        **sections,
    }


@pytest.fixture
def plant(graph, configured):
    return lambda **given: graph.add(PlantNode(parameter_overrides=configured(values(**given))))


def trajectory(names=NAMES, *points):
    return JointTrajectory(
        joint_names=list(names),
        points=[JointTrajectoryPoint(positions=[float(v) for v in p]) for p in points],
    )


def seconds(message):
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def position(pose):
    return np.array([pose.position.x, pose.position.y, pose.position.z])


def turn(q):
    return [q.x, q.y, q.z, q.w]


def test_it_goes_where_it_is_told_and_says_so(graph, plant):
    commands = graph.probe.create_publisher(JointTrajectory, 'command', STREAM)
    plant()
    lengths = graph.listen(JointState, 'backbone_lengths', STREAM)
    heard = {
        topic: graph.listen(kind, f'truth/{topic}', STREAM)
        for topic, kind in (
            ('tip', PoseStamped),
            ('markers', PoseArray),
            ('shape', Path),
            ('coordinates', JointState),
        )
    }
    graph.matched('command')
    graph.until(lambda: lengths, 'the lengths at home')
    order = [2, 0, 1]
    commands.publish(trajectory([NAMES[k] for k in order], WANTED[order]))
    graph.until(
        lambda: lengths and np.allclose(lengths[-1].position, WANTED, atol=1e-6),
        'the lengths that were commanded',
    )
    assert lengths[0].name == NAMES
    np.testing.assert_allclose(lengths[0].position, 0.12, atol=1e-9)
    stamps = np.array([seconds(m) for m in lengths])
    assert (np.diff(stamps) >= 0.0).all()
    del heard['tip'][:-1], heard['markers'][:-1], heard['shape'][:-1], heard['coordinates'][:-1]
    graph.until(lambda: all(len(messages) > 10 for messages in heard.values()), 'the truth at rest')
    arc = create_kinematics('pcc', [0.16]).backbone(Q)
    tip, markers, shape, coordinates = (messages[-1] for messages in heard.values())
    np.testing.assert_allclose(position(tip.pose), arc.positions([0.16])[0], atol=1e-5)
    assert tip.header.frame_id == 'base_link'
    ends = np.linspace(0.0, 0.16, 9)
    np.testing.assert_allclose([position(p) for p in markers.poses], arc.positions([0.08, 0.16]), atol=1e-5)
    np.testing.assert_allclose([position(p.pose) for p in shape.poses], arc.positions(ends), atol=1e-5)
    expected = Rotation.from_quat(arc.orientations([0.16])[0])
    assert (Rotation.from_quat(turn(tip.pose.orientation)).inv() * expected).magnitude() < 1e-4
    assert coordinates.name == ['segment_1_bend_x', 'segment_1_bend_y', 'segment_1_length']
    np.testing.assert_allclose(coordinates.position, Q, atol=1e-4)


def test_in_the_world_its_truth_is_turned_as_its_base(graph, plant):
    graph.probe.create_publisher(JointTrajectory, 'command', STREAM)
    arm = values()['arm'] | {'output_frame': 'world'}
    p = plant(arm=arm)
    tips = graph.listen(PoseStamped, 'truth/tip', STREAM)
    graph.until(lambda: tips, 'the tip')
    assert tips[-1].header.frame_id == 'world'
    np.testing.assert_allclose(position(tips[-1].pose), TILTED.apply([0.0, 0.0, 0.12]), atol=1e-9)
    np.testing.assert_allclose(p.tip_at(int(1e9 * seconds(tips[-1]))), position(tips[-1].pose), atol=1e-9)


def test_its_imus_are_read_over_the_serial_line(graph, plant, configured):
    """The orientation at the tip is the truth of 20 ms before, the base's stands still."""
    commands = graph.probe.create_publisher(JointTrajectory, 'command', STREAM)
    p = plant()
    port = {'port': p.boards[0].path}
    graph.add(SerialBridge(parameter_overrides=configured(values(serial=port))))
    tip, base = (graph.listen(Imu, f'imu_{i}/data', STREAM) for i in (2, 1))
    truth = graph.listen(PoseStamped, 'truth/tip', STREAM)
    graph.until(lambda: len(tip) > 10 and len(truth) > 10, 'IMUs and truth')
    commands.publish(trajectory(NAMES, WANTED))
    graph.until(lambda: len(tip) > 250 and len(truth) > 120, 'the whole motion')
    at = np.array([seconds(m) for m in truth])
    true = Slerp(at, TILTED * Rotation.from_quat([turn(m.pose.orientation) for m in truth]))
    assert (true(at[-1]) * true(at[0]).inv()).magnitude() == pytest.approx(np.hypot(0.6, 0.3), abs=1e-2)
    asked = np.array([seconds(m) for m in tip]) - 0.02
    inside = (asked > at[0]) & (asked < at[-1])
    got = Rotation.from_quat([turn(m.orientation) for m in tip])[inside]
    off = (true(asked[inside]).inv() * got).magnitude()
    assert np.median(off) < 2e-3
    # Where the stamps of both clocks differ by milliseconds, the arm has gone on by so much.
    assert np.max(off) < 0.05
    of_base = Rotation.from_quat([turn(m.orientation) for m in base])
    assert (TILTED.inv() * of_base).magnitude().max() < 1e-3


@pytest.mark.parametrize(
    ('message', 'reason'),
    [
        (trajectory(NAMES), 'not of one point'),
        (trajectory(NAMES, WANTED, WANTED), 'not of one point'),
        (trajectory(NAMES[:2], WANTED[:2]), 'not for b1, b2, b3'),
        (trajectory(['b1', 'b2', 'b4'], WANTED), 'not for b1, b2, b3'),
        (trajectory(['b1', 'b2', 'b2'], WANTED), 'not for b1, b2, b3'),
        (trajectory(NAMES, WANTED[:2]), 'with another number of positions than names'),
        (trajectory(NAMES, [0.2, float('nan'), 0.2]), 'with a length that is no positive number'),
        (trajectory(NAMES, [0.2, float('inf'), 0.2]), 'with a length that is no positive number'),
        (trajectory(NAMES, [0.2, -0.1, 0.2]), 'with a length that is no positive number'),
    ],
)
def test_a_bad_command_is_refused_counted_and_told(graph, plant, message, reason):
    commands = graph.probe.create_publisher(JointTrajectory, 'command', STREAM)
    diagnosis, logs = graph.diagnosis(), graph.listen_to_logs()
    p = plant()
    graph.matched('command')
    commands.publish(message)
    commands.publish(message)
    graph.until(lambda: p.refused.total() == 2, 'both refused')
    assert dict(p.refused) == {reason: 2}
    assert p.n_commands == 0
    [told] = [line.msg for line in logs if 'refused' in line.msg]
    assert told.startswith(f'command {reason}, refused: ')
    graph.until(
        lambda: any(s[0] == b'\x01' and reason in s[1] for s in diagnosis.of('plant: arm')), 'a warning'
    )
    lengths = graph.listen(JointState, 'backbone_lengths', STREAM)
    graph.until(lambda: len(lengths) > 20, 'lengths')
    np.testing.assert_allclose(lengths[-1].position, 0.12, atol=1e-9)


def test_it_moves_by_itself_until_somebody_may_command_it(graph, plant):
    diagnosis = graph.diagnosis()
    plant()
    lengths = graph.listen(JointState, 'backbone_lengths', STREAM)
    graph.until(lambda: lengths and np.ptp(lengths[-1].position) > 0.004, 'it bends by itself')
    graph.until(lambda: 'moves by itself' in (diagnosis.latest('plant: arm') or ' ' * 9)[1], 'what it says')
    graph.probe.create_publisher(JointTrajectory, 'command', STREAM)
    graph.until(lambda: diagnosis.latest('plant: arm')[1] == 'obeys', 'that it obeys')
    del lengths[:-1]
    graph.until(lambda: len(lengths) > 100, 'a second')  # the lag of its motors is over
    still = np.array([m.position for m in lengths[-30:]])
    np.testing.assert_allclose(still, np.broadcast_to(still[0], still.shape), atol=1e-4)
    assert np.ptp(still[0]) > 0.002


def test_two_that_command_are_warned_of(graph, plant):
    diagnosis = graph.diagnosis()
    for _ in range(2):
        graph.probe.create_publisher(JointTrajectory, 'command', STREAM)
    plant()
    graph.until(
        lambda: '2 nodes publish commands' in (diagnosis.latest('plant: arm') or ' ' * 9)[1],
        'a warning of two',
    )


def test_somebody_pushes_it(graph, plant):
    graph.probe.create_publisher(JointTrajectory, 'command', STREAM)
    plant()
    coordinates = graph.listen(JointState, 'truth/coordinates', STREAM)

    def push(value):
        parameter = ParameterMessage(name='plant.push', value=value)
        request = SetParameters.Request(parameters=[parameter])
        return graph.call(SetParameters, 'plant/set_parameters', request).results[0]

    def doubles(*numbers):
        return ParameterValue(type=ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=list(numbers))

    assert push(doubles(0.0, 0.35)).successful
    graph.until(lambda: coordinates and abs(coordinates[-1].position[1] - 0.35) < 1e-3, 'it is pushed')
    assert 'expected two numbers' in push(doubles(0.1)).reason
    assert 'expected two numbers' in push(doubles(0.1, float('nan'))).reason
    assert 'expected two numbers' in push(ParameterValue(type=ParameterType.PARAMETER_STRING)).reason
    assert push(doubles(0.0, 0.0)).successful
    graph.until(lambda: abs(coordinates[-1].position[1]) < 1e-3, 'it is let go')


def test_an_arm_without_lengths_or_that_cannot_be_is_refused(graph, configured, tmp_path):
    without = {k: v for k, v in values().items() if k not in ('segments', 'lengths', 'plant')}
    with pytest.raises(ConfigurationError, match='is missing, and a plant needs it'):
        PlantNode(parameter_overrides=configured(without))
    with pytest.raises(ConfigurationError, match='home: backbone 0 begins at'):
        validate(values({'home': [0.4]}))
    file = tmp_path / 'arm.yaml'
    file.write_text(files.dump(validate(values())).replace('slip: 0.0', 'slip: 1.5'))
    with node('plant', tmp_path, '--ros-args', '--params-file', file) as program:
        assert failed_clearly(program, 'plant.slip', 'expected 0 to 0.9')


def test_alone_it_names_the_port_of_its_imus(graph, tmp_path):
    file = tmp_path / 'arm.yaml'
    file.write_text(files.dump(validate(values())))
    with node('plant', tmp_path, '--ros-args', '--params-file', file) as program:
        program.until(lambda: 'IMUs on /dev/pts/' in program.errors, 'the port')
        program.signal(2)
        assert program.ended() == 0
        assert 'Traceback' not in program.errors


def test_commands_are_in_the_units_of_what_is_said(graph, plant):
    """A driver whose counts are 2 % short is told, and says, its own lengths."""
    commands = graph.probe.create_publisher(JointTrajectory, 'command', STREAM)
    p = plant(lengths=values()['lengths'] | {'scales': [1.02], 'offsets': [0.005]})
    lengths = graph.listen(JointState, 'backbone_lengths', STREAM)
    graph.matched('command')
    commands.publish(trajectory(NAMES, WANTED))
    graph.until(
        lambda: lengths and np.allclose(lengths[-1].position, WANTED, atol=1e-6),
        'the lengths that were commanded',
    )
    np.testing.assert_allclose(p._live.plant.encoders, 1.02 * WANTED + 0.005, rtol=0, atol=1e-4)
