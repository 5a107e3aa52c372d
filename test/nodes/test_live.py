"""Bridge and estimator on a virtual board: what the estimator says is where the virtual arm is.

The virtual arm is made of arcs between its IMUs, so `pcc_exact` on the true orientations is the arm itself.
"""

import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Path
from sensor_msgs.msg import JointState
from virtual_arms import arm_of, halted, plausible

from sesa2.configuration import validate
from sesa2.link.virtual.virtual_arm import VirtualArm
from sesa2.messages.header_bytes import read_stamp
from sesa2.nodes.estimator import EstimatorNode
from sesa2.nodes.serial_bridge import SerialBridge
from sesa2.ros.hand_over import HandOver
from sesa2.ros.qos import STREAM
from sesa2.shape import rotations
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model

LENGTH = 0.66
SECTION = 0.08
# The wire rounds each of four components by 2⁻¹⁵ at most, a quaternion by 2⁻¹⁴, a rotation by twice that. Interpolation
# between two such rotations magnifies it by 1/cos(θ/4), θ < π/2 between neighbours: 1.1. No tangent is further off.
RESOLUTION_RAD = 1.1 * 2**-13
RESOLUTION_M = RESOLUTION_RAD * LENGTH


def values(port='', **imus):
    base = {'base_orientation': imus.pop('base_orientation')} if 'base_orientation' in imus else {}
    frame = {'output_frame': imus.pop('output_frame')} if 'output_frame' in imus else {}
    return {
        'arm': {'length': LENGTH, **base, **frame},
        'imus': {
            'ids': [1, 2, 3, 4, 5, 6, 7, 8],
            'positions': [round(SECTION * k, 2) for k in range(1, 9)],
            **imus,
        },
        'markers': {'names': ['A', 'B', 'C'], 'positions': [0.05, 0.36, 0.60]},
        'models': ['pcc_exact'],
        'links': 33,
        'serial': {'port': port},
        # On a busy machine the clock may find a sweep overdue that has but to be taken from the queue.
        'sweep_timeout': 0.5,
    }


def arm_of_bends(bends, base=(0.0, 0.0, 0.0, 1.0)):
    """q_WL of IMUs at the ends of sections with these rotation vectors, each in the frame of its section's start."""
    q = [np.array(base)]
    for bend in bends:
        q.append(rotations.multiply(q[-1], rotations.from_rotation_vector(np.array(bend))))
    return np.array(q[1:])


def bends_of(orientations, base=(0.0, 0.0, 0.0, 1.0)):
    """Rotation vector of each section, the inverse of `arm_of_bends`."""
    stations = np.vstack([base, orientations])
    return rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(stations[:-1]), stations[1:]))


def positions_of(message):
    poses = [p.pose for p in message.poses] if isinstance(message, Path) else message.poses
    return np.array([[p.position.x, p.position.y, p.position.z] for p in poses])


class Live:
    """A board, the bridge and the estimator, and what the latter says."""

    def __init__(self, graph, configured, board, **imus):
        self.graph = graph
        overrides = configured(values(board.path, **imus))
        self.estimator = graph.add(EstimatorNode(parameter_overrides=overrides))
        self.shapes = graph.listen(Path, 'pcc_exact/shape', STREAM)
        self.markers = graph.listen(PoseArray, 'pcc_exact/markers', STREAM)
        self.joints = graph.listen(JointState, 'pcc_exact/joint_states', STREAM)
        self.bridge = graph.add(SerialBridge(parameter_overrides=overrides))
        self.model = self.estimator._estimator.models['pcc_exact']
        self.configuration = self.estimator.configuration

    def settled(self, n=20):
        """Wait until results come that are of now, and not of what still stood in queues."""
        lists, now_ns = (self.shapes, self.markers, self.joints), time.time_ns()
        before = [len(messages) for messages in lists]

        def of_now():
            return all(
                len(m) >= b + n and m[-1].header.stamp.sec * 10**9 + m[-1].header.stamp.nanosec > now_ns
                for m, b in zip(lists, before, strict=True)
            )

        self.graph.until(of_now, 'results')
        return self

    def truth(self, board):
        """True positions of the ends of the links and of the markers, in the output frame."""
        c = self.configuration
        backbone = create_model('pcc_exact', c.layout).fit(Measured(board.truth(0.0), c.base))
        ends, markers = (backbone.positions(s) for s in (self.model.link_ends, c.markers.positions))
        if c.frame_id == 'world':
            return ends, markers
        to_base = rotations.conjugate(c.base)
        return rotations.rotate(to_base, ends), rotations.rotate(to_base, markers)

    def off(self, board):
        """How far the newest positions are from the truth, m."""
        ends, markers = self.truth(board)
        return max(
            np.linalg.norm(positions_of(self.shapes[-1]) - ends, axis=-1).max(),
            np.linalg.norm(positions_of(self.markers[-1]) - markers, axis=-1).max(),
        )


def random_rotations(n, seed):
    return rotations.normalize(np.random.default_rng(seed).normal(size=(n, 4)))


SETTINGS = {
    'plain': {},
    'in world axes': {'output_frame': 'world'},
    'mountings': {'mount_orientations': random_rotations(8, 1).ravel().tolist()},
    'headings': {'headings': np.random.default_rng(2).uniform(-3, 3, 8).tolist()},
    'base': {'base_orientation': [0.6, 0.0, 0.48, 0.64]},
    'all at once': {
        'mount_orientations': random_rotations(8, 3).ravel().tolist(),
        'headings': np.random.default_rng(4).uniform(-3, 3, 8).tolist(),
        'base_orientation': [0.48, 0.6, 0.0, 0.64],
        'output_frame': 'world',
    },
}


@pytest.mark.parametrize('setting', SETTINGS)
@pytest.mark.parametrize('t', [9.1, 31.7], ids=['oscillating', 'circling'])
def test_positions_are_the_truth_to_the_resolution(graph, configured, boards, setting, t):
    c = validate(values(**SETTINGS[setting]))
    board = boards(arm_of(c, halted(plausible(c, t)), random_signs=True))
    live = Live(graph, configured, board, **SETTINGS[setting]).settled()
    assert np.ptp(live.truth(board)[0], axis=0).max() > 0.1
    assert np.abs(bends_of(plausible(c, t), c.base)).max() > 0.1, 'a straight arm would prove little'
    assert live.off(board) < RESOLUTION_M
    assert len(live.joints[-1].position) == 3 * 33


def test_the_base_can_be_measured(graph, configured, boards):
    base, mount = random_rotations(2, 5)
    c = validate(values(base_orientation=base.tolist()))
    q = plausible(c, 15.0)
    seven = {
        'ids': [1, 2, 3, 4, 5, 6, 7],
        'positions': list(c.imus.positions[:7]),
        'base_id': 8,
        'base_mount_orientation': mount.tolist(),
    }
    rows = np.vstack([q[:7], base])
    arm = VirtualArm(range(1, 9), halted(rows), mount_orientations=np.vstack([[[0, 0, 0, 1]] * 7, [mount]]))
    board = boards(arm)
    live = Live(graph, configured, board, **seven).settled()
    true = create_model('pcc_exact', live.configuration.layout).fit(Measured(q[:7], base))
    ends = rotations.rotate(rotations.conjugate(base), true.positions(live.model.link_ends))
    np.testing.assert_allclose(positions_of(live.shapes[-1]), ends, rtol=0, atol=2 * RESOLUTION_M)


# Without an IMU. Its sections' bends are a and b, equally long.

ALIKE = [[0.3, 0.1, 0.0], [-0.2, 0.2, 0.0], [0.1, -0.4, 0.0], [0.1, -0.4, 0.0]] + 4 * [[0.2, 0.25, 0.0]]
DIFFERENT = [[0.3, 0.1, 0.0], [-0.2, 0.2, 0.0], [0.1, -0.4, 0.0], [0.3, 0.1, 0.0]] + 4 * [[0.2, 0.25, 0.0]]


def without(fault, graph, configured, boards, bends, imu):
    """Results without an IMU, and the board."""
    c = validate(values())
    board = boards(arm_of(c, halted(arm_of_bends(bends)), random_signs=True))
    enabled = {'enabled': [fault != 'disabled' or i != imu for i in range(1, 9)]}
    live = Live(graph, configured, board, **enabled).settled()
    if fault == 'unplugged':
        assert live.off(board) < RESOLUTION_M
        board.unplug(imu)
        graph.until(lambda: not live.estimator.assembler.alive[imu - 1], f'IMU {imu} is missed')
        live.settled()
    return live, board


@pytest.mark.parametrize('fault', ['disabled', 'unplugged'])
@pytest.mark.parametrize('imu', [3, 5, 7])
def test_an_imu_is_not_missed_where_the_arm_bends_alike_beside_it(graph, configured, boards, fault, imu):
    live, board = without(fault, graph, configured, boards, ALIKE, imu)
    # The half of a slerp between its neighbours is as exact as these.
    assert live.off(board) < RESOLUTION_M


@pytest.mark.parametrize('fault', ['disabled', 'unplugged'])
def test_a_missing_imu_costs_no_more_than_its_sections_differ(graph, configured, boards, fault):
    """Where the sections beside it bend by a and b, the IMU's orientation is guessed as the middle of its neighbours'.

    In the flat space of small rotations that is off by |a − b|/2, half the diagonal of a parallelogram; rotations of
    less than 1 rad are flat but for a factor tan(1/4)/(1/4) < 1.03. From the one neighbour, where it is 0, the error
    grows at most linearly to the missing IMU, and falls to 0 at the other. Integrated over both sections, 2 l long,
    that moves what comes after by |a − b| l/2 at most.
    """
    live, board = without(fault, graph, configured, boards, DIFFERENT, 3)
    a, b = np.array(DIFFERENT[2]), np.array(DIFFERENT[3])
    bound = 1.03 * np.linalg.norm(a - b) * SECTION / 2
    off = live.off(board)
    assert off < bound + RESOLUTION_M
    assert off > bound / 10, 'it is interpolated, so it is off'
    # Up to the neighbour before, nothing changed.
    n = np.searchsorted(live.model.link_ends, 2 * SECTION + 1e-9)
    ends, _ = live.truth(board)
    np.testing.assert_allclose(positions_of(live.shapes[-1])[:n], ends[:n], rtol=0, atol=RESOLUTION_M)


def test_an_imu_that_comes_back_is_used_again(graph, configured, boards):
    live, board = without('unplugged', graph, configured, boards, DIFFERENT, 3)
    diagnosis = graph.diagnosis()
    graph.until(
        lambda: (d := diagnosis.latest('estimator: imu_3')) and d[0] == DiagnosticStatus.WARN, 'a warning'
    )
    board.plug(3)
    graph.until(lambda: live.estimator.assembler.alive[2], 'IMU 3 is back')
    live.settled()
    assert live.off(board) < RESOLUTION_M


def test_every_sweep_gives_a_result_or_is_counted_as_lost(graph, configured, boards):
    c = validate(values())
    live = Live(graph, configured, boards(arm_of(c))).settled(200)
    graph.remove(live.bridge)
    stamps = np.array([s.header.stamp.sec * 10**9 + s.header.stamp.nanosec for s in live.shapes])
    assert (np.diff(stamps) > 0).all()
    # Just after discovery the first messages of one topic may be missing.
    missing = (np.rint(np.diff(stamps[20:]) / 10e6) - 1).sum()
    assert missing <= live.bridge.links[0].session.counters().lost_sweeps
    assert live.estimator.assembler.resets == 0


def test_handed_over_the_samples_give_the_results_that_their_topics_give(graph, configured, boards):
    """Two estimators of one bridge, one past the middleware: bit by bit the same."""
    wanted = {**values(), 'models': ['rigid', 'pcc']}
    c = validate(wanted)
    board = boards(arm_of(c))
    way = HandOver()
    handed = graph.add(EstimatorNode(way, parameter_overrides=configured(wanted)))
    topics = [f'/imu_{i}/data' for i in c.imus.ids]
    heard = graph.add(
        EstimatorNode(
            parameter_overrides=configured({**wanted, 'imus': {**wanted['imus'], 'topics': topics}}),
            namespace='other',
        )
    )
    results = {
        (space, model, kind): graph.listen(cls, f'{space}/{model}/{kind}', STREAM, raw=True)
        for space in ('', '/other')
        for model in ('rigid', 'pcc')
        for kind, cls in (('joint_states', JointState), ('markers', PoseArray), ('shape', Path))
    }
    overrides = configured({**wanted, 'serial': {'port': board.path}})
    graph.add(SerialBridge(way, parameter_overrides=overrides))
    graph.until(lambda: all(len(r) >= 150 for r in results.values()), '150 results of each')
    for (space, model, kind), ours in results.items():
        if not space:
            by_stamp = {read_stamp(data): bytes(data) for data in results['/other', model, kind]}
            stamps = [read_stamp(data) for data in ours]
            assert len(set(stamps) & by_stamp.keys()) >= 100
            assert all(by_stamp.get(read_stamp(data), data) == bytes(data) for data in ours)
    assert handed.received.keys() == heard.received.keys()
    assert way.lost == 0
