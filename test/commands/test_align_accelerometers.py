"""`sesa2 align --accelerometers` on bags of IMUs that were held with each side up."""

import numpy as np
import pytest
import yaml
from held_poses import recording

from sesa2.bags.writing import new_bag
from sesa2.cli import main
from sesa2.messages.imu_messages import TYPE, ImuMessages
from sesa2.sensing.imu.bno055.offsets import Offsets, load_accelerometers, load_offsets, save_offsets

T = {1: np.array([[1.02, 0.01, 0.0], [0.0, 0.98, 0.02], [-0.01, 0.0, 1.01]]), 2: np.diag([0.99, 1.0, 1.03])}
BIAS = {1: np.array([0.2, -0.3, 0.1]), 2: np.array([-0.4, 0.0, 0.25])}
OFFSETS = Offsets((1, 2, 3), (4, 5, 6), (7, 8, 9), 1000, 480)
GRAVITY = 9.80665 / 9.81  # the poses are of 9.81 m/s²


@pytest.fixture
def configuration(tmp_path):
    path = tmp_path / 'c.yaml'
    nested = {
        'arm': {'length': 0.2},
        'imus': {'ids': [1, 2], 'positions': [0.1, 0.2], 'fusion': '6d'},
        'models': ['pcc'],
        'calibration': {'file': str(tmp_path / 'offsets.yaml')},
    }
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': nested}}))
    return path


def bag_of(path, held):
    with new_bag(path) as bag:
        for imu, seconds in held.items():
            topic = bag.add_topic(f'/imu_{imu}/data', TYPE)
            t, a, w, _ = recording(np.random.default_rng(imu), seconds)
            stamps = 1_700_000_000_000_000_000 + np.round(t * 1e9).astype(np.int64)
            for stamp, row in zip(
                stamps, ImuMessages(f'imu_{imu}').make_raw(stamps, w, a @ T[imu].T + BIAS[imu]), strict=True
            ):
                bag.write(topic, int(stamp), row.tobytes())
    return path


def test_each_is_kept_beside_its_offsets(configuration, tmp_path, capsys):
    file = tmp_path / 'offsets.yaml'
    save_offsets(file, 2, OFFSETS)
    bag = bag_of(tmp_path / 'bag', {1: [2, 3, 2, 9, 2, 2.5], 2: [2.0] * 6})
    arguments = ['align', str(bag), '--config', str(configuration), '--accelerometers', '--gravity', '9.81']
    assert main(arguments) == 0
    kept = load_accelerometers(file, (1, 2))
    for imu in (1, 2):
        np.testing.assert_allclose(kept[imu].bias, BIAS[imu], atol=0.02)
        np.testing.assert_allclose(kept[imu].matrix, np.linalg.inv(T[imu]), atol=0.003)
    assert load_offsets(file, (2,)).offsets == {2: OFFSETS}
    assert 'known' in capsys.readouterr().out


def test_an_imu_that_was_not_held_every_way_is_named_and_the_others_are_kept(configuration, tmp_path, capsys):
    bag = bag_of(tmp_path / 'bag', {1: [2.0] * 6, 2: [2, 2, 2, 2, 0.5, 2]})
    assert main(['align', str(bag), '--config', str(configuration), '--accelerometers']) == 0
    assert 'IMU 2: of the six poses there is none with +z up; got 5 still poses' in capsys.readouterr().err
    assert set(load_accelerometers(tmp_path / 'offsets.yaml', (1, 2))) == {1}


def test_nothing_to_calibrate_by_ends_with_1_and_no_file(configuration, tmp_path, capsys):
    bag = bag_of(tmp_path / 'bag', {1: [0.5] * 6})
    assert main(['align', str(bag), '--config', str(configuration), '--accelerometers']) == 1
    told = capsys.readouterr().err
    assert 'IMU 2: no sample with angular velocity and acceleration' in told
    assert 'error: no accelerometer was calibrated: hold every IMU still for 2 s' in told
    assert not (tmp_path / 'offsets.yaml').exists()
