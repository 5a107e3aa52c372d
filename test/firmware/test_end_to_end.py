"""`sesa2 run` on the firmware's ELF, in real time: from what the chips are fed to joint states."""

import signal
import time

import numpy as np
import pytest
import yaml
from graph_fixtures import ros_graph
from processes import command
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from simulated_board import SimulatedBoard

from sesa2.ros.qos import STREAM

LENGTH = 0.66
POSITIONS = np.arange(1, 9) * 0.08
STATIONS = np.array([0.0, *POSITIONS])
LINKS = 64
SEGMENTS = 2
BASE = Rotation.from_euler('ZYX', [0.4, -1.2, 0.3])
MOUNTINGS = Rotation.from_euler(
    'ZYX', np.column_stack([np.linspace(-2.0, 2.0, 8), np.full(8, 0.5), np.full(8, -0.4)])
)
HEADINGS = np.linspace(-0.7, 0.9, 8)
BENDING = np.column_stack([np.linspace(0.5, -0.3, 8), np.linspace(-0.4, 0.4, 8), np.full(8, 0.1)])
"""How each section turns from its beginning to its end, rotation vectors in its own axes, rad."""

# Each component is rounded by 2⁻¹⁵ at most, a quaternion thus by √4 · 2⁻¹⁵ = 2⁻¹⁴. From the centre of the unit sphere
# that is an angle of asin 2⁻¹⁴ at most, and the rotation is off by twice as much. Between two quaternions at an
# angle θ, slerp is off by (sin((1 − t)θ) + sin(tθ)) / sin θ times as much at most: 1 / cos(θ/2), at t = ½. And θ is
# half the angle by which a section turns.
ANGLE = 2.0 * np.arcsin(2.0**-14)
BETWEEN = ANGLE / np.cos(0.25 * np.linalg.norm(BENDING, axis=1).max())


def true_orientations(s):
    """q_BL of an arm that bends and twists evenly from station to station, and not past the last IMU."""
    at_stations = [Rotation.identity()]
    for turn in BENDING:
        at_stations.append(at_stations[-1] * Rotation.from_rotvec(turn))
    section = np.minimum(np.searchsorted(STATIONS, s, side='left').clip(1) - 1, 7)
    fraction = np.minimum((s - STATIONS[section]) / 0.08, 1.0)
    return Rotation.concatenate([at_stations[k] for k in section]) * Rotation.from_rotvec(
        fraction[:, None] * BENDING[section]
    )


def fed_quaternions():
    """What the chips show for that arm, raw, w x y z: heading error, clamp and mounting are in it."""
    turned = Rotation.from_rotvec(HEADINGS[:, None] * [0.0, 0.0, 1.0])
    q_ws = turned * BASE * true_orientations(POSITIONS) * MOUNTINGS
    x, y, z, w = np.rint(16384 * q_ws.as_quat()).astype(int).T
    return np.column_stack([w, x, y, z]).tolist()


def links_of(model):
    """Ends of a model's links, m, and the arc lengths at which they have the arm's own orientation."""
    if model == 'pcc_exact':
        ends = np.linspace(0.0, LENGTH, LINKS + 1)
        return ends, 0.5 * (ends[:-1] + ends[1:])
    if model == 'pcc':
        ends = np.array([*np.linspace(0.0, POSITIONS[-1], 8 * SEGMENTS + 1), LENGTH])
        return ends, 0.5 * (ends[:-1] + ends[1:])
    return np.array([0.0, *POSITIONS[:-1], LENGTH]), POSITIONS  # rigid, with boundaries at the IMUs


@pytest.fixture
def config(tmp_path):
    path = tmp_path / 'arm.yaml'
    values = {
        'arm': {'length': LENGTH, 'base_orientation': BASE.as_quat().tolist()},
        'imus': {
            'ids': list(range(1, 9)),
            'positions': POSITIONS.tolist(),
            'mount_orientations': MOUNTINGS.as_quat().ravel().tolist(),
            'headings': HEADINGS.tolist(),
        },
        'models': ['rigid', 'pcc', 'pcc_exact'],
        'links': LINKS,
        'rigid': {'boundaries': 'endpoint'},
        'pcc': {'segments': [SEGMENTS] * 8},
    }
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': values}}))
    return path


@pytest.fixture
def simulated(built):
    with SimulatedBoard(real_time=True) as board:
        for channel, wxyz in enumerate(fed_quaternions()):
            board.set_quaternion(channel, wxyz)
        yield board


@pytest.fixture
def graph():
    with ros_graph() as one:
        yield one


@pytest.fixture
def program(config, simulated, tmp_path):
    """`sesa2 run` on the simulated board."""
    with command(
        tmp_path, 'run', '--source', 'serial', '--port', simulated.port_path, '--config', config
    ) as running:
        yield running


def assert_shape_fed(message, model):
    """The joint states lead from the clamp to the shape that the chips were fed."""
    ends, at = links_of(model)
    lengths = np.diff(ends)
    angles = np.array(message.position).reshape(-1, 3)
    assert message.name == [f'{model}_{k:03d}_{axis}' for k in range(1, len(at) + 1) for axis in 'xzy']
    assert len(angles) == len(at)
    orientation, found = Rotation.identity(), []
    for x, z, y in angles:
        orientation = orientation * Rotation.from_euler('XZY', [x, z, y])
        found.append(orientation)
    found, expected = Rotation.concatenate(found), true_orientations(at)
    bound = ANGLE if model == 'rigid' else BETWEEN
    assert (found * expected.inv()).magnitude().max() <= bound
    tips = [np.cumsum(lengths[:, None] * q.apply([0.0, 0.0, 1.0]), axis=0) for q in (found, expected)]
    # A link's direction is off by its angle at most, and what is before a point adds up.
    assert (np.linalg.norm(tips[0] - tips[1], axis=1) <= bound * ends[1:]).all()


MODELS = ('rigid', 'pcc', 'pcc_exact')


def heard_whole(graph, program, messages):
    """Joint states of every model, once all chips measure."""
    for model in MODELS:
        messages[model].clear()
    enough = 100  # of which the first may be from before a fault, or without a chip that has yet to start
    graph.until(
        lambda: not program.running or all(len(messages[model]) >= enough for model in MODELS), 'joint states'
    )
    assert program.running, program.errors
    return {model: messages[model][-1] for model in MODELS}


def test_joint_states_have_the_shape_that_the_chips_are_fed(graph, simulated, program):
    messages = {model: graph.listen(JointState, f'{model}/joint_states', STREAM) for model in MODELS}
    for model, message in heard_whole(graph, program, messages).items():
        assert_shape_fed(message, model)

    # Off and on again, as a cable is: the shape comes back by itself.
    simulated.command('cable', 0)
    simulated.command('reset')
    simulated.command('cable', 1)
    for model, message in heard_whole(graph, program, messages).items():
        assert_shape_fed(message, model)

    program.signal(signal.SIGINT)
    assert program.ended() == 0, program.errors
    assert 'Traceback' not in program.errors
    # The board was told to be silent; what was on the line then has long been sent.
    ended_us, sent = later(simulated, 0)
    assert later(simulated, ended_us + 100_000)[1] == later(simulated, ended_us + 300_000)[1] <= sent + 95


def later(simulated, time_us):
    """Simulated time, and the bytes that the board has sent by then, once a time is over."""
    while True:
        now_us, sent = map(int, simulated.command('time').split())
        if now_us >= time_us:
            return now_us, sent
        time.sleep(0.01)
