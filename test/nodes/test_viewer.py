"""The viewer as a person uses it: its own process, a running system on the graph, and a real browser."""

import os
import re
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import rclpy
from browsing import browser, tab  # noqa: F401  fixtures
from geometry_msgs.msg import Point, Pose, PoseArray, PoseStamped
from nav_msgs.msg import Path as PathMessage
from sensor_msgs.msg import Imu

from sesa2.configuration import files, validate
from sesa2.configuration.chosen_files import ChosenFiles
from sesa2.messages.imu_messages import ImuMessages
from sesa2.nodes.estimator import EstimatorNode
from sesa2.ros.qos import STREAM
from sesa2.ros.spinning import Spinner
from sesa2.sensing.imu.bno055.offsets import load_offsets
from sesa2.shape.rotations import from_rotation_vector, multiply
from sesa2.system.remote_control import RemoteControl
from sesa2.system.wiring import System

pytest.importorskip('viser', reason='viser is not installed: pip install sesa2[viewer]')

PATIENCE_S = 60.0
VALUES = {
    'run': {'source': 'external'},
    'arm': {'length': 0.3, 'radius': 0.012},
    'imus': {'ids': [1, 2], 'positions': [0.15, 0.3]},
    'markers': {'names': ['M1'], 'positions': [0.1]},
    'models': ['pcc'],
}


class SteeredSystem:
    """`sesa2 run --viewer` within the test, which has a viewer of its own.

    With the source `external` it plays IMUs whose arm bends as the test says; with `sim`, the virtual board does.
    """

    def __init__(self):
        self.bend = np.zeros(3)  # rotation vector from one IMU to the next, rad
        self.mounting = np.array([0.0, 0.0, 0.0, 1.0])  # q_LS
        self.truth = []  # poses along the true arm
        self.alive = {1, 2}
        self.spinner = Spinner()
        self.system = System(self.spinner)
        self.node = RemoteControl(self.system, validate(VALUES), ChosenFiles('/'))
        self.true_shape = self.node.create_publisher(PathMessage, 'truth/shape', STREAM)
        self.true_markers = self.node.create_publisher(PoseArray, 'truth/markers', STREAM)
        self.node.create_timer(1.0 / 30.0, self._play)
        self.spinner.add(self.node)
        self.imu_messages = {i: ImuMessages(f'imu_{i}') for i in (1, 2)}
        self.imus = {i: self.node.create_publisher(Imu, f'imu_{i}/data', STREAM) for i in (1, 2)}
        self.node.try_to_start()
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._spin)
        self.thread.start()

    @property
    def configuration(self):
        return files.parse(self.node.get_parameter('configuration').value, 'system')

    @property
    def estimator(self):
        return next(n for n in self.system.nodes if isinstance(n, EstimatorNode))

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
        if self.system.boards or not self.system.nodes:
            return
        now_ns = time.time_ns()
        if self.truth:
            self.true_shape.publish(PathMessage(poses=self.truth))
            self.true_markers.publish(PoseArray(poses=[self.truth[-1].pose]))
        for k, i in enumerate((1, 2), start=1):
            if i in self.alive:
                q = multiply(from_rotation_vector(k * self.bend), self.mounting)
                self.imus[i].publish(self.imu_messages[i].make(now_ns, q))


class ViewerProcess:
    def __init__(self, port=0):
        command = [
            sys.executable,
            '-m',
            'sesa2.nodes.viewer',
            '--ros-args',
            '-p',
            f'port:={port}',
            '-p',
            'files:=/',
        ]
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {'PYTHONUNBUFFERED': '1'},
        )

    def address(self):
        line = self.process.stdout.readline()
        match = re.search(r'http://\S+', line)
        assert match, f'no address in {line!r}: {self.process.stderr.read() if not line else ""}'
        return match[0]

    def end(self, how=signal.SIGTERM):
        self.process.send_signal(how)
        return self.process.communicate(timeout=PATIENCE_S)


@pytest.fixture(scope='module')
def ros():
    rclpy.init(args=[])
    yield
    rclpy.try_shutdown()


@pytest.fixture
def system(ros):
    one = SteeredSystem()
    yield one
    one.close()


@pytest.fixture
def viewer(ros):
    one = ViewerProcess()
    yield one
    if one.process.poll() is None:
        _, errors = one.end()
        assert 'Traceback' not in errors
        assert one.process.returncode == 0


@pytest.fixture
def shown(system, viewer, tab):  # noqa: F811
    tab.open(viewer.address())
    tab.page.get_by_text('streaming').wait_for()
    return tab


def orange(r, g, b):
    """The tube of `pcc`."""
    return (r > 150) & (r - b > 70) & (r - g > 25) & (g - b > 10)


def green(r, g, b):
    """The markers."""
    return (g - r > 60) & (g - b > 30) & (r < 160)


def red(r, g, b):
    """The north half of a magnet."""
    return (r > 110) & (r - g > 70) & (r - b > 60)


def blue(r, g, b):
    """Its south half."""
    return (b > 90) & (b - r > 60) & (b - g > 50)


def test_the_arm_is_drawn_and_moves_and_nothing_leaves_the_machine(system, shown):
    straight = shown.until(lambda: (w := shown.where(orange))[2] > 300 and w, 'the straight arm')
    system.bend = np.array([0.0, 0.7, 0.0])
    shown.until(lambda: abs(shown.where(orange)[0] - straight[0]) > 15.0, 'the bent arm')
    assert shown.asked
    foreign = [url for url in shown.asked if not re.match(r'(blob:)?(http|ws)://127\.0\.0\.1:|data:', url)]
    assert not foreign


def test_a_missing_imu_is_named(system, shown):
    shown.page.get_by_text('measures').nth(1).wait_for()
    system.alive = {1}
    shown.page.get_by_text('missing', exact=True).wait_for()


def test_a_marker_moved_in_the_form_moves_on_the_screen(system, shown):
    low = shown.until(lambda: (w := shown.where(green))[2] > 60 and w, 'the marker')
    shown.go_to('Arm')
    at = shown.field('at [m]')
    at.fill('0.25')
    shown.press('Start')
    shown.page.get_by_text('started').wait_for()
    shown.until(lambda: (w := shown.where(green))[2] > 60 and low[1] - w[1] > 60.0, 'the marker further up')
    assert system.configuration.markers.positions == (0.25,)


def test_a_bad_value_is_refused_beside_its_field(system, shown):
    shown.go_to('Arm')
    length = shown.field('length [m]')
    before = system.configuration
    for typed, told in (
        ('-0.3', 'got -0.3, expected more than 0'),
        ('long', "got 'long', expected a number"),
    ):
        length.fill(typed)
        shown.page.get_by_text(told, exact=True).wait_for()
        beside = shown.page.get_by_text(told, exact=True).bounding_box()
        assert abs(beside['y'] - length.bounding_box()['y']) < 60.0
    shown.press('Start')
    shown.page.get_by_text('not done, since the form has mistakes').wait_for()
    assert system.configuration == before
    length.fill('0.3')
    shown.page.get_by_text("got 'long', expected a number", exact=True).wait_for(state='hidden')


def test_a_start_that_fails_says_why(system, shown):
    shown.go_to('Run')
    shown.choose('source', 'serial')
    shown.field('port').fill('/dev/there_is_no_such_port')
    shown.press('Start')
    shown.page.locator('.sesa2-mistake').get_by_text('/dev/there_is_no_such_port').wait_for()
    shown.page.get_by_text('stopped').first.wait_for()


def test_record_makes_a_bag(system, shown, tmp_path):
    from sesa2.bags.reading import ImuRecording
    from sesa2.bags.recording import open_recording

    shown.go_to('Run')
    shown.field('into bag').fill(str(tmp_path / 'trial'))
    shown.press('Record')
    shown.page.get_by_text('recording into').first.wait_for()
    shown.until(lambda: system.system.recorder.n_messages > 100, 'messages in the bag')
    shown.press('End')
    shown.page.get_by_text('recorded').wait_for()
    with open_recording(tmp_path / 'trial') as recording:
        assert min(ImuRecording(recording).counts.values()) > 5


def test_calibration_bars_follow_the_virtual_board(system, shown):
    shown.go_to('Run')
    shown.choose('source', 'sim')
    shown.press('Start')
    shown.go_to('Calibration')
    seen = set()

    def scores():
        cells = shown.page.locator('[data-score^="imu_1 "]')
        seen.add(tuple(cell.get_attribute('data-score') for cell in cells.all()))
        return any(all(s.endswith('3') for s in row) and len(row) == 4 for row in seen)

    shown.until(scores, 'the calibrated board', tries=600)
    assert len(seen) > 1
    shown.page.get_by_text('calibrated', exact=True).first.wait_for()


def test_align_is_kept_for_the_next_start_and_in_the_form(system, shown):
    tilt = np.array([0.0, np.deg2rad(6.0), 0.0])
    system.mounting = from_rotation_vector(tilt)
    shown.until(
        lambda: np.abs(system.estimator.latest.models['pcc'].ends[0, -1, 0]) > 0.01, 'the tilted IMUs'
    )
    shown.page.wait_for_timeout(3500)  # the arm has been straight for so long, as the button says
    shown.go_to('Calibration')
    shown.press('Align: the arm is straight now')
    shown.page.get_by_text('mountings corrected by 6.0° (IMU 1), 6.0° (IMU 2)').wait_for()
    shown.until(
        lambda: np.abs(system.estimator.latest.models['pcc'].ends[0, -1, 0]) < 1e-6, 'the straight arm'
    )
    expected = validate(VALUES).with_alignment(np.tile(system.mounting, (2, 1)), np.zeros(2)).imus
    shown.until(lambda: len(system.configuration.imus.mount_orientations) == 8, 'it is kept')
    np.testing.assert_allclose(
        system.configuration.imus.mount_orientations, expected.mount_orientations, atol=1e-6
    )
    shown.go_to('IMUs')
    shown.page.get_by_text('IMU 1 at 0.15 m').click()
    field = shown.field('mounting xyzw')
    y = expected.mount_orientations[1]
    shown.until(lambda: abs(float(field.input_value().split()[1]) - y) < 1e-6, 'the form')


def test_offsets_are_read_and_saved(system, shown, tmp_path):
    file = tmp_path / 'offsets.yaml'
    shown.go_to('Run')
    shown.choose('source', 'sim')
    shown.choose('mode', 'calibrate')
    shown.field('offsets file').fill(str(file))
    shown.press('Start')
    shown.page.get_by_text('started').wait_for()
    shown.go_to('Calibration')
    shown.press('Read the offsets of all chips')
    shown.page.get_by_text('read the offsets of 2 IMUs').wait_for()
    shown.press('Save the offsets')
    shown.page.get_by_text(f'saved IMUs 1, 2 in {file}').wait_for()
    assert set(load_offsets(file, (1, 2)).offsets) == {1, 2}


def test_a_configuration_is_saved_and_loaded(system, shown, tmp_path):
    shown.go_to('Arm')
    shown.field('radius [m]').fill('0.02')
    shown.page.get_by_text('changed in the form').wait_for()
    shown.go_to('File')
    for name, told in (
        ('prototype3_8', 'expected a file name that ends in .yaml'),
        (tmp_path / 'mine.yaml', f'saved in {tmp_path / "mine.yaml"}'),
        (tmp_path / 'mine.yaml', 'tick overwrite'),
    ):
        shown.field('file').fill(str(name))
        shown.press('Save')
        shown.page.get_by_text(told).wait_for()
    assert files.load(tmp_path / 'mine.yaml').arm.radius == 0.02
    shown.field('file').fill('prototype3_4')
    shown.press('Load')
    shown.page.get_by_text('prototype3_4 is in the form').wait_for()
    shown.go_to('Arm')
    shown.until(lambda: shown.field('length [m]').input_value() == '0.66', 'the loaded length')


def test_an_arm_with_magnets_shows_what_is_in_it(system, shown):
    shown.go_to('File')
    shown.field('file').fill('magnetic_1')
    shown.press('Load')
    shown.page.get_by_text('magnetic_1 is in the form').wait_for()
    shown.go_to('Run')
    shown.choose('source', 'sim')
    shown.press('Start')
    shown.page.get_by_text('started').wait_for()
    shown.go_to('View')
    shown.page.get_by_text('magnetometer', exact=True).wait_for()
    shown.page.get_by_text('measures', exact=True).nth(2).wait_for()

    def seen(is_colour):
        halfway = shown.picture()[260:500].astype(
            int
        )  # above the axes of the base, which are red and blue, too
        return np.count_nonzero(is_colour(*np.moveaxis(halfway, -1, 0))) > 20

    for pole in (red, blue):
        shown.until(lambda pole=pole: seen(pole), 'a pole of the magnet')


def test_a_truth_is_a_ghost_as_long_as_it_is_told(system, shown):
    shown.until(lambda: shown.where(orange)[2] > 300, 'the arm')
    shown.page.wait_for_timeout(1000)
    without = shown.picture().astype(int)

    def changed():
        return np.count_nonzero(np.abs(shown.picture().astype(int) - without).max(axis=-1) > 15)

    aside = np.linspace([0.06, 0.06, 0.0], [0.06, 0.06, 0.3], 20)
    system.truth = [PoseStamped(pose=Pose(position=Point(x=x, y=y, z=z))) for x, y, z in aside]
    shown.until(lambda: changed() > 1000, 'the ghost')
    system.truth = []
    shown.until(lambda: changed() < 300, 'that the ghost goes')


def test_a_killed_viewer_harms_nobody_and_another_takes_over(system, viewer, tab):  # noqa: F811
    tab.open(viewer.address())
    tab.page.get_by_text('streaming').wait_for()
    estimator = system.estimator
    before = estimator.n_sweeps
    viewer.end(signal.SIGKILL)
    another = ViewerProcess()
    try:
        tab.open(another.address())
        tab.page.get_by_text('streaming').wait_for()
        assert estimator.n_sweeps > before
        assert not estimator.assembler.dropped
    finally:
        another.end()
    assert another.process.returncode == 0


def test_without_a_system_it_is_for_viewing_only(ros, viewer, tab):  # noqa: F811
    tab.open(viewer.address())
    tab.page.get_by_text('nothing runs').wait_for()
    tab.page.get_by_text('View only').wait_for()
    assert not tab.page.get_by_role('button', name='Start', exact=True).is_visible()


def test_a_busy_port_is_a_clear_failure(ros, viewer):
    port = int(viewer.address().rpartition(':')[2])
    second = ViewerProcess(port)
    output, errors = second.process.communicate(timeout=PATIENCE_S)
    assert second.process.returncode == 1
    assert f'port {port}' in errors
    assert 'in use' in errors
    assert 'Traceback' not in errors
    assert 'http' not in output
