"""What the scene is told to draw, against rotation matrices of scipy's. Drawing itself is the browser's."""

import time
from dataclasses import replace

import numpy as np
import pytest
from magnetic_bag import configuration
from scipy.spatial.transform import Rotation

pytest.importorskip('viser', reason='viser is not installed: pip install sesa2[viewer]')

from sesa2.configuration import validate
from sesa2.viewer.live import Diagnostic, Live
from sesa2.viewer.magnet_poses import DOUBTFUL, UNUSED, WELL, WRONG
from sesa2.viewer.scene import Scene
from sesa2.viewer.server import open_server

BASE = Rotation.from_rotvec([0.6, -1.0, 0.5])
LINKS = [BASE * Rotation.from_rotvec(v) for v in ([0.2, 0.3, 0.0], [0.5, -0.1, 0.1], [0.4, 0.7, -0.2])]
MOUNTINGS = Rotation.random(3, random_state=2)
ON_BASE = Rotation.from_rotvec([0.9, 0.2, -1.4])  # q_BS
HEADINGS = [0.7, -1.2, 0.4]
ENDS = np.linspace(0.0, 0.3, 5)
PLACES = np.array(
    [[0.0, 0.0, 0.0], [0.01, 0.0, 0.07], [0.03, 0.01, 0.14], [0.06, 0.02, 0.2], [0.1, 0.02, 0.25]]
)


@pytest.fixture(scope='module')
def server():
    one = open_server(port=0)
    yield one
    one.stop()


def configured(frame, base_imu):
    on_base = {'base_id': 8, 'base_mount_orientation': (1.008 * ON_BASE.as_quat()).tolist()}
    arm = {'length': 0.3, 'output_frame': frame}
    if not base_imu:
        arm['base_orientation'] = BASE.as_quat().tolist()
    return validate(
        {
            'arm': arm,
            'imus': {
                'ids': [1, 2, 4],
                'positions': [0.1, 0.15, 0.3],
                'mount_orientations': MOUNTINGS.as_quat().ravel().tolist(),
                'headings': HEADINGS,
                **(on_base if base_imu else {}),
            },
            'markers': {'names': ['tip'], 'positions': [0.3]},
            'models': ['pcc_exact'],
            'links': 4,
        }
    )


def known(frame, base_imu):
    """Links at four ends, and what the IMUs measure; that of IMU 2 is silent."""
    in_frame = [link if frame == 'world' else BASE.inv() * link for link in LINKS]
    turns = [in_frame[0], in_frame[0], in_frame[1], in_frame[1], in_frame[2]]
    backbone = np.hstack([PLACES, [turn.as_quat() for turn in turns]])
    sensors = {
        imu: (Rotation.from_rotvec([0.0, 0.0, heading]) * link * mounting).as_quat()
        for imu, heading, link, mounting in zip((1, 2, 4), HEADINGS, LINKS, MOUNTINGS, strict=True)
        if imu != 2
    }
    if base_imu:
        sensors[8] = (BASE * ON_BASE).as_quat()
    return Live(backbones={'pcc_exact': backbone}, sensors=sensors), in_frame


def matrices(wxyz):
    np.testing.assert_allclose(np.linalg.norm(wxyz, axis=-1), 1.0, atol=1e-6)
    return Rotation.from_quat(np.asarray(wxyz, dtype=float)[..., [1, 2, 3, 0]]).as_matrix()


@pytest.mark.parametrize('base_imu', [False, True], ids=['fixed base', 'measured base'])
@pytest.mark.parametrize('frame', ['base', 'world'])
def test_the_axes_of_each_sensor_are_where_it_sits(server, frame, base_imu):
    live, in_frame = known(frame, base_imu)
    scene = Scene(server)
    scene.configure(configured(frame, base_imu))
    scene.draw(live)
    # A sensor's own axes: its link's, turned by its mounting; the heading error is no turn of the sensor.
    expected = [(link * mounting).as_matrix() for link, mounting in zip(in_frame, MOUNTINGS, strict=True)]
    expected[1] = in_frame[1].as_matrix()  # that of a silent one is not known: grey, and as its link
    for axes in (scene._imus, scene._missing):
        np.testing.assert_allclose(matrices(axes.batched_wxyzs), expected, atol=1e-5)
        # At 0.1 m, a third of the way from the end at 0.075 m to the next.
        positions = [(2.0 * PLACES[1] + PLACES[2]) / 3.0, PLACES[2], PLACES[4]]
        np.testing.assert_allclose(axes.batched_positions, positions, atol=1e-6)
    np.testing.assert_array_equal(scene._imus.batched_scales.astype(bool), [True, False, True])
    np.testing.assert_array_equal(scene._missing.batched_scales.astype(bool), [False, True, False])


@pytest.mark.parametrize('base_imu', [False, True], ids=['fixed base', 'measured base'])
@pytest.mark.parametrize('frame', ['base', 'world'])
def test_clamp_and_arm_stand_in_the_world(server, frame, base_imu):
    live, _ = known(frame, base_imu)
    scene = Scene(server)
    scene.configure(configured(frame, base_imu))
    scene.draw(live)
    np.testing.assert_allclose(matrices(scene._base_axes.wxyz), BASE.as_matrix(), atol=1e-9)
    # What is in the base's frame is turned into the world's by the node that it hangs on.
    turn = BASE.as_matrix() if frame == 'base' else np.eye(3)
    np.testing.assert_allclose(matrices(scene._arm.wxyz), turn, atol=1e-9)


def test_magnets_move_with_the_arm_and_magnetometers_show_their_faults(server):
    c = configuration()
    rings = replace(c.magnets, inner_diameters=(0.006, 0.0, 0.006))  # the second is a disc
    c = replace(c, magnets=rings, magnetometers=replace(c.magnetometers, axes=('z',) * 4 + ('xyz',) * 8))
    model = c.create_model('magnetic')
    scene = Scene(server)
    scene.configure(c)
    straight = np.zeros((model.n_links + 1, 7))
    straight[:, 2], straight[:, 6] = model.link_ends, 1.0
    values = {'rate_hz': '40.0'}
    parts = {
        i: Diagnostic(0, '', values, time.monotonic()) for i in range(1, 12)
    }  # of the last nothing is heard
    parts[2] = Diagnostic(1, '', values | {'sweeps jumping': '4'}, time.monotonic())
    parts[7] = Diagnostic(1, '', values | {'sweeps saturated': '4'}, time.monotonic())
    live = Live(
        backbones={'magnetic': straight},
        diagnostics={f'estimator: magnetometer_{i}': d for i, d in parts.items()},
    )
    scene.draw(live)
    magnets, magnetometers = scene._magnets._magnets, scene._magnets._magnetometers
    assert [places.tolist() for places, _ in magnets] == [
        [0, 2],
        [0, 2],
        [1],
        [1],
    ]  # both halves of each kind
    for places, node in magnets:
        assert node.visible
        np.testing.assert_allclose(node.batched_positions[:, 2], 0.055 + 0.11 * places, atol=1e-6)
        np.testing.assert_allclose(matrices(node.batched_wxyzs), np.tile(np.eye(3), (len(places), 1, 1)))
    # North is towards the tip.
    assert magnets[0][1].vertices[:, 2].min() >= 0.0
    assert magnets[1][1].vertices[:, 2].max() <= 0.0
    assert [places.tolist() for places, _ in magnetometers] == [[0, 1, 2, 3], list(range(4, 12))]
    colours = np.concatenate([node.batched_colors for _, node in magnetometers])
    expected = [WELL] * 12
    expected[1], expected[6], expected[11] = DOUBTFUL, WRONG, UNUSED
    np.testing.assert_array_equal(colours, expected)
    for _, node in magnetometers:  # z looks towards the base
        np.testing.assert_allclose(matrices(node.batched_wxyzs)[:, 2, 2], -1.0, atol=1e-6)
    # What is in the arm is to be seen: its tube is a cage.
    assert len(scene._tubes['magnetic'].faces) == 4 * 2 * model.n_links


def test_an_arm_without_magnets_has_none(server):
    scene = Scene(server)
    scene.configure(configured('base', False))
    assert not scene._magnets.drawn
    scene.draw(known('base', False)[0])
