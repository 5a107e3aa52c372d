"""The tip's target as a person gives it: a ball dragged in a real browser, and a real controller behind the page."""

import re
import threading
import time

import numpy as np
import pytest
import rclpy
import yaml
from browsing import browser, tab  # noqa: F401  fixtures
from geometry_msgs.msg import PointStamped, PoseStamped
from processes import REPOSITORY, node
from sensor_msgs.msg import Imu, JointState

from sesa2.configuration import validate
from sesa2.configuration.chosen_files import ChosenFiles
from sesa2.messages.imu_messages import ImuMessages
from sesa2.nodes.tip_controller import TipControllerNode
from sesa2.ros.qos import STREAM
from sesa2.ros.spinning import Spinner
from sesa2.system.remote_control import RemoteControl
from sesa2.system.wiring import System

pytest.importorskip('viser', reason='viser is not installed: pip install sesa2[viewer]')

STRAIGHT = np.array([0.0, 0.0, 0.16])
TRUE_TIP = np.array([0.01, 0.0, 0.15])
PERIOD_S = 0.05  # between two targets at least


def values():
    given = yaml.safe_load((REPOSITORY / 'config/tri_backbone.yaml').read_text())['/**']['ros__parameters']
    given['run'] = {'source': 'external'}
    given['models'] = ['pcc_delta']
    given['controller']['feedback_timeout'] = 20.0  # a browser on a loaded machine holds up everything else
    given['lengths']['timeout'] = 20.0
    return given


class StillArm:
    """`sesa2 run --viewer` within the test, on a straight arm that measures, and heeds no command."""

    def __init__(self):
        self.spinner = Spinner()
        self.system = System(self.spinner)
        self.node = RemoteControl(self.system, validate(values()), ChosenFiles('/'))
        self.targets = []
        self.node.create_subscription(PointStamped, 'target', self.targets.append, STREAM)
        self.imus = {i: self.node.create_publisher(Imu, f'imu_{i}/data', STREAM) for i in (1, 2)}
        self.makes = {i: ImuMessages(f'imu_{i}') for i in (1, 2)}
        self.lengths = self.node.create_publisher(JointState, 'backbone_lengths', STREAM)
        self.truth = self.node.create_publisher(PoseStamped, 'truth/tip', STREAM)
        self.node.create_timer(1.0 / 30.0, self._play)
        self.spinner.add(self.node)
        self.node.try_to_start()
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._spin)
        self.thread.start()

    @property
    def controller(self):
        return next(n for n in self.system.nodes if isinstance(n, TipControllerNode)).controller

    def close(self):
        self.ended.set()
        self.thread.join()
        self.system.end()
        self.spinner.__exit__()

    def _spin(self):
        while not self.ended.is_set():
            self.spinner.spin_once()
            self.node.look_after()

    def _play(self):
        now_ns = time.time_ns()
        for i, publisher in self.imus.items():
            # As alive as a chip is: one that says the same for ever is frozen.
            jitter = 1e-4 * np.sin(now_ns * 1e-8 + i)
            publisher.publish(self.makes[i].make(now_ns, np.array([jitter, 0.0, 0.0, 1.0])))
        message = JointState(name=['b1', 'b2', 'b3'], position=[0.16] * 3)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now_ns, 10**9)
        self.lengths.publish(message)
        pose = PoseStamped(header=message.header)
        pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = TRUE_TIP.tolist()
        self.truth.publish(pose)


@pytest.fixture(scope='module')
def ros():
    rclpy.init(args=[])
    yield
    rclpy.try_shutdown()


@pytest.fixture
def arm(ros):
    one = StillArm()
    yield one
    one.close()


@pytest.fixture
def shown(arm, tab, tmp_path):  # noqa: F811
    ros_arguments = ('--ros-args', '-p', 'port:=0', '-p', 'files:=/')
    with node('viewer', tmp_path, *ros_arguments) as viewer:
        viewer.until(lambda: 'http' in viewer.output, 'its address')
        tab.open(re.search(r'http://\S+', viewer.output)[0])
        tab.page.get_by_text('streaming').wait_for()
        yield tab
        assert 'Traceback' not in viewer.errors


def upward(r, g, b):
    """The arrow that drags along z."""
    return (abs(r - 32) < 25) & (abs(g - 128) < 25) & (b > 225)


def magenta(r, g, b):
    """The ball that is in reach, or the point that is reached in its place."""
    return (r - g > 60) & (b - g > 40) & (r - b > 5) & (r - b < 90)  # the red arrow has less blue


def test_the_ball_is_dragged_and_the_controller_takes_it(arm, shown):
    shown.page.get_by_text('it has no target yet: drag the ball').wait_for()
    shown.press('Start the tip')
    shown.page.get_by_text('● running').wait_for()
    assert arm.controller.target is None
    mouse = shown.page.mouse

    def dragged():
        """The panel may still change its width, and what is seen moves with it."""
        x, y, _ = shown.until(lambda: (w := shown.where(upward))[2] > 30 and w, 'the arrow')
        mouse.move(x, y)
        shown.page.wait_for_timeout(500)  # the arrow knows of the mouse only with a frame
        mouse.down()
        for k in range(1, 21):
            mouse.move(x, y - 2.0 * k)
            shown.page.wait_for_timeout(30)
        mouse.up()
        shown.page.wait_for_timeout(500)
        return arm.controller.target is not None

    shown.until(dragged, 'the target', tries=5)
    before = -1

    def rests():
        nonlocal before
        n, before = before, len(arm.targets)
        shown.page.wait_for_timeout(500)
        return n == len(arm.targets)

    shown.until(rests, 'the last of them')
    target = arm.controller.target
    assert target[2] > STRAIGHT[2] + 0.005
    np.testing.assert_allclose(target[:2], 0.0, atol=1e-3)
    assert {m.header.frame_id for m in arm.targets} == {'base_link'}
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in arm.targets]
    assert (len(stamps) - 1) * PERIOD_S <= stamps[-1] - stamps[0] + PERIOD_S
    off = 1e3 * np.linalg.norm(TRUE_TIP - target)
    shown.page.get_by_text(f'true tip {off:.1f} mm off').wait_for()
    shown.press('Stop the tip')
    shown.page.get_by_text('tip controller: stopped').wait_for()
    shown.page.get_by_text('● stopped').wait_for()
    assert arm.controller.state.name == 'STOPPED'


def test_a_target_of_somebody_else_moves_the_ball_which_is_grey_out_of_reach(arm, shown):
    publisher = arm.node.create_publisher(PointStamped, 'target', STREAM)

    def aim(*place):
        message = PointStamped()
        message.header.frame_id = 'base_link'
        message.point.x, message.point.y, message.point.z = place
        publisher.publish(message)

    shown.press('Start the tip')
    shown.page.get_by_text('● running').wait_for()
    aim(0.0, 0.0, 0.235)
    shown.page.get_by_text('target +0.000 +0.000 +0.235 m').wait_for()
    whole = shown.until(lambda: (w := shown.where(magenta))[2] > 200 and w, 'the ball')
    # Straight up the arm comes to 0.24 m.
    aim(0.0, 0.0, 0.30)
    shown.page.get_by_text('limited: the target is out of reach, 60 mm are left').wait_for()
    point = shown.until(
        lambda: 20 < (w := shown.where(magenta))[2] < 0.7 * whole[2] and w, 'the point that is reached'
    )
    assert abs(point[0] - whole[0]) < 15.0
    assert abs(point[1] - whole[1]) < 30.0
    assert arm.controller.state.name == 'LIMITED'
