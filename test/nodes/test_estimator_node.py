"""The estimator node on a real graph: what goes in as messages comes out as the arm's shape."""

import itertools
import time
from collections import Counter

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray, PoseStamped
from nav_msgs.msg import Path
from rclpy.parameter import Parameter
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from sesa2.configuration import ConfigurationError, files
from sesa2.messages.imu_messages import ImuMessages
from sesa2.nodes.estimator import EstimatorNode
from sesa2.ros.qos import LATCHED, STREAM
from sesa2.shape.measured import Measured
from sesa2.shape.rotations import conjugate, from_rotation_vector, multiply, normalize

VALUES = {
    'arm': {'length': 0.3},
    'imus': {'ids': [2, 5], 'positions': [0.1, 0.3], 'mount_orientations': [0.6, 0.0, 0.0, 0.8]},
    'markers': {'names': ['A', 'B'], 'positions': [0.1, 0.2]},
    'models': ['pcc', 'pcc_exact'],
    'links': 6,
    # On a busy machine the second sample of a sweep may be long in coming; the clock is not to close it meanwhile.
    'sweep_timeout': 30.0,
}
T0 = 1_700_000_000_000_000_000
MS = 1_000_000


class Sensors:
    """Publishers of the IMUs' topics."""

    def __init__(self, graph, ids):
        self.n_said = Counter()
        self.publishers = {i: graph.probe.create_publisher(Imu, f'imu_{i}/data', STREAM) for i in ids}
        graph.matched(*(f'imu_{i}/data' for i in ids))

    def say(self, imu, stamp_ns, q):
        self.n_said[imu] += 1
        self.publishers[imu].publish(ImuMessages(f'imu_{imu}').make(stamp_ns, q))


def stamp(header):
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def xyz(p):
    return [p.x, p.y, p.z]


@pytest.fixture
def node(graph, configured):
    return graph.add(EstimatorNode(parameter_overrides=configured(VALUES)))


def test_one_result_per_sweep_and_model_with_the_measurements_stamp(graph, node):
    c = node.configuration
    got = {
        (model, kind): graph.listen(cls, f'{model}/{kind}', STREAM)
        for model in ('pcc', 'pcc_exact')
        for kind, cls in (
            ('joint_states', JointState),
            ('markers', PoseArray),
            ('tip', PoseStamped),
            ('shape', Path),
        )
    }
    sensors = Sensors(graph, (2, 5))
    rng = np.random.default_rng(0)
    measured = normalize(rng.normal(size=(3, 2, 4)))
    for k, q in enumerate(measured):
        sensors.say(2, T0 + 1000 * k * MS, q[0])
        sensors.say(5, T0 + 1000 * k * MS + 2 * MS, q[1])
        # One sweep after the other: just after matching, DDS does not keep the order between topics.
        graph.until(lambda n=k + 1: all(len(m) == n for m in got.values()), 'a result of each')
    links = multiply(measured, conjugate([0.6, 0.0, 0.0, 0.8]))
    for name in ('pcc', 'pcc_exact'):
        model = c.create_model(name)
        backbone = model.fit(Measured(links))
        for k in range(3):
            newest = T0 + 1000 * k * MS + 2 * MS
            assert {
                stamp(got[name, kind][k].header) for kind in ('joint_states', 'markers', 'tip', 'shape')
            } == {newest}
            markers = got[name, 'markers'][k]
            np.testing.assert_allclose(
                [xyz(p.position) for p in markers.poses], backbone.positions([0.1, 0.2])[k], atol=1e-12
            )
            np.testing.assert_allclose(
                xyz(got[name, 'tip'][k].pose.position), backbone.positions([0.3])[k, 0], atol=1e-12
            )
            shape = [xyz(p.pose.position) for p in got[name, 'shape'][k].poses]
            np.testing.assert_allclose(shape, backbone.positions(model.link_ends)[k], atol=1e-12)
            assert markers.header.frame_id == 'base_link'
            joints = got[name, 'joint_states'][k]
            assert len(joints.position) == 3 * model.n_links
            if not k:
                assert not len(joints.velocity)
                continue
            turn = np.subtract(joints.position, got[name, 'joint_states'][k - 1].position)  # in 1 s
            np.testing.assert_allclose(joints.velocity, np.arctan2(np.sin(turn), np.cos(turn)), atol=1e-12)


def test_an_arm_whose_lengths_nobody_says_has_no_shape_and_says_so(graph, configured):
    lengths = {'segments': {'lengths': [0.1, 0.2]}, 'lengths': {'names': ['a', 'b'], 'segments': [1, 2]}}
    graph.add(EstimatorNode(parameter_overrides=configured({**VALUES, **lengths})))
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    diagnosis = graph.diagnosis()
    graph.matched('/diagnostics')
    sensors = Sensors(graph, (2, 5))
    for k in range(2):
        sensors.say(2, T0 + 500 * k * MS, [0.6, 0.0, 0.0, 0.8])
        sensors.say(5, T0 + 500 * k * MS + MS, [0.6, 0.0, 0.0, 0.8])
    [(level, text, counts), *_] = graph.until(lambda: diagnosis.of('estimator: segments'), 'an error')
    assert level == DiagnosticStatus.ERROR
    assert 'without a result: the length of a segment was not known' in text
    assert int(counts['without_lengths']) in (1, 2)
    assert not tips


def test_the_configuration_is_latched_and_valid(graph, node):
    messages = graph.listen(String, 'configuration', LATCHED)
    [message] = graph.until(lambda: messages)
    assert files.parse(message.data, 'topic') == node.configuration


def test_an_imu_that_falls_silent_is_interpolated_and_shown(graph, configured):
    graph.add(EstimatorNode(parameter_overrides=configured({**VALUES, 'sweep_timeout': 0.2})))
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    diagnostics = graph.listen(DiagnosticArray, '/diagnostics', 10)
    sensors = Sensors(graph, (2, 5))
    straight = [0.6, 0.0, 0.0, 0.8]
    sensors.say(2, T0, straight)
    # By the stamps IMU 5 is silent; that it is not merely late, the node's own clock has to show, while IMU 2 goes on.
    later = itertools.count(400)
    graph.until(lambda: sensors.say(2, T0 + next(later) * MS, straight) or tips, 'a result without IMU 5')
    np.testing.assert_allclose(xyz(tips[0].pose.position), [0.0, 0.0, 0.3], atol=1e-12)

    def level(part):
        return [s.level for m in diagnostics for s in m.status if s.name == f'estimator: {part}']

    graph.until(lambda: DiagnosticStatus.WARN in level('imu_5'), 'a warning about IMU 5')


def test_rates_are_of_the_last_second(graph, node):
    """What was heard before is not counted again: soon after the last sample the rates are zero."""
    diagnosis = graph.diagnosis()
    sensors = Sensors(graph, (2, 5))

    def rates():
        parts = [diagnosis.latest(f'estimator: {part}') for part in ('imu_2', 'imu_5')]
        return all(parts) and [float(values['rate_hz']) for _, _, values in parts]

    for begin in (0, 300):
        for k in range(begin, begin + 300):
            sensors.say(2, T0 + 10 * k * MS, [0.0, 0.0, 0.0, 1.0])
            sensors.say(5, T0 + 10 * k * MS + MS, [0.0, 0.0, 0.0, 1.0])
            graph.until(lambda n=k + 1: min(node.received[2], node.received[5]) == n, 'both samples')
        graph.until(lambda: (r := rates()) and min(r) > 0.0, 'a rate')
        told = len(diagnosis.of('estimator: sweeps'))
        graph.until(lambda n=told + 2: len(diagnosis.of('estimator: sweeps')) >= n, 'two reports more')
        assert rates() == [0.0, 0.0]
    level, text, counts = diagnosis.latest('estimator: sweeps')
    assert (level, text) == (DiagnosticStatus.ERROR, 'no IMU is alive')
    assert counts['sweeps'] == str(node.n_sweeps)


def test_twists_near_the_singularity_are_warned_of_while_they_last(graph, configured):
    graph.add(EstimatorNode(parameter_overrides=configured({**VALUES, 'models': ['rigid']})))
    diagnosis = graph.diagnosis()
    graph.matched('/diagnostics')
    sensors = Sensors(graph, (2, 5))
    twisted = multiply(from_rotation_vector([0.0, 0.0, np.deg2rad(85.0)]), [0.6, 0.0, 0.0, 0.8])
    sensors.say(2, T0, [0.6, 0.0, 0.0, 0.8])
    sensors.say(5, T0 + MS, twisted)
    warned = graph.until(lambda: diagnosis.of('estimator: rigid'), 'a warning')
    assert warned == [
        (
            DiagnosticStatus.WARN,
            '1 sweeps with a joint beyond 80° about z: joint angles are near their singularity',
            {'near_singular': '1'},
        )
    ]
    told = len(diagnosis.of('estimator: sweeps'))
    graph.until(lambda: len(diagnosis.of('estimator: sweeps')) >= told + 2, 'two reports more')
    assert diagnosis.of('estimator: rigid') == warned


def test_sweeps_that_a_model_could_not_solve_are_warned_of(graph, configured):
    values = {**VALUES, 'imus': {'ids': [2, 5], 'positions': [0.1, 0.3]}, 'models': ['smooth_rod']}
    graph.add(EstimatorNode(parameter_overrides=configured(values)))
    diagnosis = graph.diagnosis()
    graph.matched('/diagnostics')
    sensors = Sensors(graph, (2, 5))
    first = from_rotation_vector([3.1, 0.0, 0.0])
    sensors.say(2, T0, first)
    sensors.say(5, T0 + MS, multiply(first, from_rotation_vector([0.0, 3.1, 0.0])))
    level, text, counts = graph.until(lambda: diagnosis.of('estimator: smooth_rod'), 'a warning')[-1]
    assert level == DiagnosticStatus.WARN
    assert '1 sweeps could not be solved and are arcs' in text
    assert counts == {'fallen_back': '1'}


def test_coordinates_are_published_and_much_twist_is_warned_of(graph, configured):
    node = graph.add(
        EstimatorNode(
            parameter_overrides=configured(
                {**VALUES, 'imus': {'ids': [2, 5], 'positions': [0.1, 0.3]}, 'models': ['pcc_delta']}
            )
        )
    )
    got = graph.listen(JointState, 'pcc_delta/coordinates', STREAM)
    diagnosis = graph.diagnosis()
    graph.matched('/diagnostics')
    sensors = Sensors(graph, (2, 5))
    sensors.say(2, T0, from_rotation_vector([0.0, 0.4, 0.0]))
    sensors.say(5, T0 + MS, from_rotation_vector([0.0, 0.4, 0.2]))
    (message,) = graph.until(lambda: got, 'coordinates')
    assert tuple(message.name) == node.configuration.create_model('pcc_delta').coordinate_names
    np.testing.assert_allclose(message.position[:3], [0.4, 0.0, 0.1], atol=1e-12)
    level, text, values = graph.until(lambda: diagnosis.of('estimator: pcc_delta twist'), 'a warning')[-1]
    assert level == DiagnosticStatus.WARN
    assert text.endswith('pcc_delta.twist is shared, the other forms are tip, base, heading: whose is it?')
    assert set(values) == {'segment_1_deg', 'segment_2_deg'}
    assert 10.0 < float(values['segment_2_deg']) < 12.0


def test_two_publishers_on_one_topic_are_an_error(graph, node):
    diagnostics = graph.listen(DiagnosticArray, '/diagnostics', 10)
    sensors = [Sensors(graph, (2,)), Sensors(graph, (2,))]
    assert len(sensors) == 2
    graph.until(
        lambda: [s for m in diagnostics for s in m.status if '2 publishers on one topic' in s.message],
        'an error about two publishers',
    )


def test_bad_samples_are_counted(graph, node):
    diagnostics = graph.listen(DiagnosticArray, '/diagnostics', 10)
    sensors = Sensors(graph, (2, 5))
    for k, q in enumerate(([0.0] * 4, [np.nan, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.5])):
        sensors.say(2, T0 + k * MS, q)

    def counts():
        keys = [
            v.key for m in diagnostics for s in m.status if s.name == 'estimator: sweeps' for v in s.values
        ]
        return {'dropped: all zero, not measured', 'dropped: not a number', 'dropped: norm is not 1'} <= set(
            keys
        )

    graph.until(counts, 'counts of the bad samples')


def test_marker_arrays_only_for_whoever_listens(graph, node):
    sensors = Sensors(graph, (2, 5))
    arrays = graph.listen(MarkerArray, 'pcc/marker_array', STREAM)

    sweeps = itertools.count()

    def one_sweep_more():
        now = T0 + 1000 * next(sweeps) * MS
        for imu in (2, 5):
            sensors.say(imu, now, [0.0, 0.0, 0.0, 1.0])
        return arrays

    graph.until(one_sweep_more, 'a marker array')
    line, spheres = arrays[0].markers
    assert len(line.points) == 5
    assert len(spheres.points) == 2


def test_unknown_parameters_are_refused(graph, configured):
    wrong = [*configured(VALUES), Parameter('arm.lenght', value=1.0)]
    with pytest.raises(ConfigurationError, match=r'arm\.lenght: is not known; did you mean arm\.length'):
        EstimatorNode(parameter_overrides=wrong)


def test_parameters_are_described_ranged_and_read_only(graph, node):
    descriptor = node.describe_parameter('arm.length')
    assert 'm' in descriptor.description
    assert descriptor.read_only
    assert node.get_parameter('imus.enabled').value == [True, True]
    [result] = node.set_parameters([Parameter('arm.length', rclpy.Parameter.Type.DOUBLE, 0.4)])
    assert not result.successful
    assert 'read-only' in result.reason


def test_align_takes_the_mountings_from_the_straight_arm(graph, node):
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    configurations = graph.listen(String, 'configuration', LATCHED)
    graph.until(lambda: configurations, 'the configuration')  # a later one would take its place
    answer = graph.call(Trigger, 'estimator/align', Trigger.Request())
    assert not answer.success
    assert 'no sweep' in answer.message
    sensors = Sensors(graph, (2, 5))
    tilted = multiply(from_rotation_vector([0.0, np.deg2rad(2.0), 0.0]), [0.6, 0.0, 0.0, 0.8])
    for k in range(40):
        sensors.say(2, T0 + 10 * k * MS, [0.6, 0.0, 0.0, 0.8])
        sensors.say(5, T0 + 10 * k * MS + MS, tilted)
        graph.until(lambda n=k + 1: len(tips) == n, 'a result')
    assert abs(tips[-1].pose.position.x) > 0.002
    answer = graph.call(Trigger, 'estimator/align', Trigger.Request())
    assert answer.success, answer.message
    assert '2.0° (IMU 5)' in answer.message
    sensors.say(2, T0 + 1000 * MS, [0.6, 0.0, 0.0, 0.8])
    sensors.say(5, T0 + 1001 * MS, tilted)
    graph.until(lambda: len(tips) == 41, 'a result after aligning')
    np.testing.assert_allclose(xyz(tips[-1].pose.position), [0.0, 0.0, 0.3], atol=1e-6)
    graph.until(lambda: len(configurations) == 2, 'the new configuration')
    written = files.parse(configurations[-1].data, 'topic')
    np.testing.assert_allclose(written.mountings, node.configuration.mountings, atol=1e-8)


def test_align_takes_the_base_as_it_is_measured(graph, configured):
    """The clamp leans by a right angle, as its IMU says; what is configured says that it stands."""
    imus = {**VALUES['imus'], 'base_id': 1, 'base_mount_orientation': [0.0, 0.6, 0.0, 0.8]}
    node = graph.add(EstimatorNode(parameter_overrides=configured({**VALUES, 'imus': imus})))
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    sensors = Sensors(graph, (1, 2, 5))
    base = from_rotation_vector([np.pi / 2.0, 0.0, 0.0])
    askew = multiply(base, from_rotation_vector([0.0, np.deg2rad(2.0), 0.0]))
    said = {1: multiply(base, imus['base_mount_orientation'])}
    said |= {i: multiply(q, [0.6, 0.0, 0.0, 0.8]) for i, q in ((2, base), (5, askew))}

    def sweep(k, so_far):
        for i, q in said.items():
            sensors.say(i, T0 + 10 * k * MS + i, q)
        graph.until(lambda: len(tips) == so_far + 1, 'a result')

    for k in range(40):
        sweep(k, k)
    assert abs(tips[-1].pose.position.x) > 0.002
    answer = graph.call(Trigger, 'estimator/align', Trigger.Request())
    assert answer.success, answer.message
    assert '0.0° (IMU 2), 2.0° (IMU 5)' in answer.message
    sweep(100, 40)
    np.testing.assert_allclose(xyz(tips[-1].pose.position), [0.0, 0.0, 0.3], atol=1e-6)
    assert node.latest is not None
    np.testing.assert_allclose(np.abs((node.latest.base * base).sum(-1)), 1.0, atol=1e-12)
    # Held in the air the clamp moves, though the links do not: no pose to learn from.
    for k in range(40):
        said[1] = multiply(from_rotation_vector([0.005, 0.0, 0.0]), said[1])
        sweep(1000 + k, 41 + k)
    answer = graph.call(Trigger, 'estimator/align', Trigger.Request())
    assert not answer.success
    assert 'the arm moved: the base by' in answer.message


def test_align_headings_takes_a_turn_about_the_straight_arm_as_heading(graph, node):
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    sensors = Sensors(graph, (2, 5))
    turned = multiply(from_rotation_vector([0.0, 0.0, np.deg2rad(30.0)]), [0.6, 0.0, 0.0, 0.8])
    for k in range(40):
        sensors.say(2, T0 + 10 * k * MS, [0.6, 0.0, 0.0, 0.8])
        sensors.say(5, T0 + 10 * k * MS + MS, turned)
        graph.until(lambda n=k + 1: len(tips) == n, 'a result')
    answer = graph.call(Trigger, 'estimator/align', Trigger.Request())
    assert answer.success, answer.message
    assert 'IMU 5 is turned by +30° about the arm' in answer.message
    np.testing.assert_allclose(node.configuration.headings, 0.0)
    answer = graph.call(Trigger, 'estimator/align_headings', Trigger.Request())
    assert answer.success, answer.message
    assert '+30.0° (IMU 5)' in answer.message
    np.testing.assert_allclose(np.rad2deg(node.configuration.headings), [0.0, 30.0], atol=1e-6)


def burst(sensors, ids, instants, q=(0.6, 0.0, 0.0, 0.8)):
    """Instants, in 10 ms, topic by topic, as a network delivers them that repeats what it lost."""
    for n, imu in enumerate(ids):
        for k in instants:
            sensors.say(imu, T0 + 10 * k * MS + n * MS, q)


def say_on(node, sensors, ids, instants):
    """Say an instant, when all that IMU 2 said before has been taken."""
    if node.received[2] == sensors.n_said[2]:
        burst(sensors, ids, [next(instants)])


def test_instants_that_arrive_topic_by_topic_give_as_many_results(graph, configured):
    node = graph.add(EstimatorNode(parameter_overrides=configured({**VALUES, 'sweep_timeout': 0.05})))
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    sensors = Sensors(graph, (2, 5))
    burst(sensors, (2, 5), range(100))
    graph.until(lambda: len(tips) == 100, '100 results')
    assert [stamp(t.header) for t in tips] == [T0 + (10 * k + 1) * MS for k in range(100)]
    assert node.assembler.alive == [True, True]
    assert not node.assembler.dropped
    # And further on, the other topic first.
    burst(sensors, (5, 2), range(101, 180))
    graph.until(lambda: len(tips) == 179, '79 results more')
    assert not node.assembler.dropped


def test_an_imu_that_dies_costs_no_sweep_and_comes_back(graph, configured):
    node = graph.add(EstimatorNode(parameter_overrides=configured({**VALUES, 'sweep_timeout': 0.05})))
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    sensors = Sensors(graph, (2, 5))
    burst(sensors, (2, 5), range(20))
    instants = itertools.count(20)

    def gone_on():
        say_on(node, sensors, (2,), instants)
        return not node.assembler.alive[1]

    graph.until(gone_on, 'IMU 5 to be given up')
    n = next(instants)
    graph.until(lambda: node.n_sweeps == n, 'results without IMU 5')
    burst(sensors, (2, 5), range(n, n + 10))
    graph.until(lambda: node.n_sweeps >= n + 10 and all(node.assembler.alive), 'results with it')
    stamps = [stamp(t.header) for t in tips]
    assert stamps == sorted(set(stamps))
    assert node.assembler.alive == [True, True]


def test_a_node_that_was_held_up_takes_no_imu_for_dead(graph, configured):
    """What arrives while it does not listen waits in its queues; the clock must not run meanwhile."""
    node = graph.add(EstimatorNode(parameter_overrides=configured({**VALUES, 'sweep_timeout': 0.05})))
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    sensors = Sensors(graph, (2, 5))
    burst(sensors, (2, 5), range(10))
    burst(sensors, (2,), range(10, 40))
    graph.until(lambda: len(tips) == 10 and node.received[2] == 40, 'results')
    # As if the last message had come a minute ago.
    node.assembler._arrived_ns -= 60 * 10**9
    burst(sensors, (2,), range(40, 60))
    graph.until(lambda: node.received[2] == 60, 'the rest of IMU 2')
    burst(sensors, (5,), range(10, 60))
    graph.until(lambda: len(tips) == 60, 'results after it')
    assert node.latest.stamps_ns[-1] == T0 + 590 * MS
    assert not node.assembler.dropped


def test_after_a_step_back_of_the_stamps_nothing_old_is_kept_and_align_works(graph, configured):
    node = graph.add(EstimatorNode(parameter_overrides=configured({**VALUES, 'sweep_timeout': 0.05})))
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    sensors = Sensors(graph, (2, 5))
    tilted = multiply(from_rotation_vector([0.0, np.deg2rad(10.0), 0.0]), [0.6, 0.0, 0.0, 0.8])
    for _ in range(3):  # a bag that loops
        n = len(tips)
        burst(sensors, (2, 5), range(250, 290), tilted)
        graph.until(lambda n=n: len(tips) == n + 40, 'results')
        burst(sensors, (2, 5), range(40))
        graph.until(lambda n=n: len(tips) == n + 80, 'results after the step')
        assert len(node._recent) <= 301
    assert [sweep.stamp_ns for sweep in node._recent] == [T0 + (10 * k + 1) * MS for k in range(40)]
    answer = graph.call(Trigger, 'estimator/align', Trigger.Request())
    assert answer.success, answer.message
    assert '0.0° (IMU 2), 0.0° (IMU 5)' in answer.message


def test_a_silent_imu_on_the_base_is_an_error_and_no_frozen_base(graph, configured):
    values = {**VALUES, 'sweep_timeout': 0.05, 'imus': {**VALUES['imus'], 'base_id': 1}}
    node = graph.add(EstimatorNode(parameter_overrides=configured(values)))
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    diagnosis = graph.diagnosis()
    sensors = Sensors(graph, (1, 2, 5))
    burst(sensors, (1, 2, 5), range(20))
    instants = itertools.count(20)

    def gone_on():
        say_on(node, sensors, (2, 5), instants)
        return (
            diagnosis.latest('estimator: imu_1') and 'on the base' in diagnosis.latest('estimator: imu_1')[1]
        )

    graph.until(gone_on, 'IMU 1 to be given up')
    # Within the timeout the base's last orientation holds.
    graph.until(
        lambda: (diagnosis.latest('estimator: imu_1') or (b'',))[0] == DiagnosticStatus.ERROR,
        'an error about it',
    )
    assert 'on the base' in diagnosis.latest('estimator: imu_1')[1]
    graph.until(
        lambda: 'IMU 1 on the base is silent' in diagnosis.latest('estimator: sweeps')[1],
        'an error about the shape',
    )
    assert diagnosis.latest('estimator: sweeps')[0] == DiagnosticStatus.ERROR
    graph.until(
        lambda: (
            'dropped: of a sweep without the orientation of the base'
            in diagnosis.latest('estimator: sweeps')[2]
        ),
        'their number',
    )
    assert 20 <= len(tips) <= 25
    n = len(tips)

    def come_back():
        say_on(node, sensors, (1, 2, 5), instants)
        return len(tips) >= n + 20

    graph.until(come_back, 'results with the base again')


def test_an_imu_with_a_clock_of_its_own_is_named_with_its_lag(graph, configured):
    graph.add(EstimatorNode(parameter_overrides=configured({**VALUES, 'sweep_timeout': 0.05})))
    diagnosis = graph.diagnosis()
    sensors = Sensors(graph, (2, 5))
    began = time.monotonic_ns()

    def lag():
        """At its own pace: lags show against the clock."""
        now = T0 + time.monotonic_ns() - began
        sensors.say(2, now, [0.6, 0.0, 0.0, 0.8])
        sensors.say(5, now - 200 * MS, [0.6, 0.0, 0.0, 0.8])
        return [m for _, m, _ in diagnosis.of('estimator: imu_5') if 'behind' in m]

    said = graph.until(lag, 'a warning about its lag')
    assert 'its stamps are 0.20 s behind those of the others' in said[0]
    assert DiagnosticStatus.WARN in [
        level for level, m, _ in diagnosis.of('estimator: imu_5') if 'behind' in m
    ]
    assert not [m for _, m, _ in diagnosis.of('estimator: imu_2') if 'behind' in m or 'ahead' in m]


def test_messages_without_a_stamp_are_of_the_time_of_their_arrival(graph, node):
    logs, diagnosis = graph.listen_to_logs(), graph.diagnosis()
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    sensors = Sensors(graph, (2, 5))
    before = time.time_ns()

    def told():
        for imu in (2, 5):
            sensors.say(imu, 0, (0.0, 0.0, 0.0, 1.0))
        return len(tips) >= 3

    graph.until(told, 'results')
    stamps = [stamp(tip.header) for tip in tips]
    assert before <= stamps[0] < stamps[1] < stamps[2] <= time.time_ns()
    assert node.unstamped == node.received
    text = 'its messages have no stamp (0); the time of their arrival stands in'
    graph.until(
        lambda: {m.msg for m in logs} >= {f'IMU 2: {text}', f'IMU 5: {text}'}, 'a warning for each, once'
    )
    assert sum(text in m.msg for m in logs) == 2
    graph.until(
        lambda: (
            (d := diagnosis.latest('estimator: imu_2')) and d[0] == DiagnosticStatus.WARN and text in d[1]
        ),
        'a status',
    )


def test_the_time_of_arrival_is_taken_for_all_where_it_is_asked_for(graph, configured):
    values = {**VALUES, 'imus': {**VALUES['imus'], 'stamps': 'arrival'}}
    node = graph.add(EstimatorNode(parameter_overrides=configured(values)))
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    sensors = Sensors(graph, (2, 5))
    before = time.time_ns()

    def told():
        for imu in (2, 5):
            sensors.say(imu, 77, (0.0, 0.0, 0.0, 1.0))
        return len(tips) >= 3

    graph.until(told, 'results')
    assert before <= stamp(tips[0].header) < stamp(tips[1].header)
    assert not node.unstamped


def test_an_earth_frame_that_points_down_is_named(graph, node):
    logs, diagnosis = graph.listen_to_logs(), graph.diagnosis()
    tips = graph.listen(PoseStamped, 'pcc/tip', STREAM)
    sensors = Sensors(graph, (2, 5))
    # Components of north, east, down of an upright arm with this mounting.
    down = multiply((0.5**0.5, 0.5**0.5, 0.0, 0.0), (0.6, 0.0, 0.0, 0.8))
    for k in range(3):
        for imu in (2, 5):
            sensors.say(imu, T0 + 10 * k * MS, down)
    graph.until(lambda: len(tips) == 2, 'results')
    graph.until(
        lambda: [d for d in diagnosis.of('estimator: sweeps') if 'point against the base' in d[1]],
        'a status of the sweeps',
    )
    assert diagnosis.of('estimator: sweeps')[-1][0] >= DiagnosticStatus.WARN
    assert graph.until(lambda: [m for m in logs if 'north-east-down' in m.msg], 'a line in the log')


def test_an_imu_that_says_the_same_while_others_turn_is_stuck(graph, node):
    diagnostics = graph.listen(DiagnosticArray, '/diagnostics', 10)
    sensors = Sensors(graph, (2, 5))
    for k in range(60):  # 3 s
        half = 0.3 * np.sin(0.1 * k)
        sensors.say(2, T0 + 50 * k * MS, [0.0, 0.0, 0.0, 1.0])
        sensors.say(5, T0 + 50 * k * MS, [np.sin(half), 0.0, 0.0, np.cos(half)])

    def told(part):
        return [s.message for m in diagnostics for s in m.status if s.name == f'estimator: {part}']

    graph.until(lambda: any('stuck: the same quaternion for' in t for t in told('imu_2')), 'a stuck IMU 2')
    assert not any('stuck' in t for t in told('imu_5'))
