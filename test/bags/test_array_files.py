"""What other programs read, read back by other programs' readers."""

import csv
import io
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import Reader

from sesa2.bags.array_files import write_arrays
from sesa2.bags.definitions import typestore
from sesa2.bags.estimate_arrays import read_estimate
from sesa2.bags.replay import replay
from sesa2.cli import main
from sesa2.errors import Sesa2Error
from sesa2.evaluation.bag_evaluation import evaluate_bag


@pytest.fixture
def bag_of_estimates(bag, configuration, tmp_path):
    replay(bag, configuration, tmp_path / 'est')
    return tmp_path / 'est'


@pytest.fixture
def estimate(bag_of_estimates):
    whole = read_estimate(bag_of_estimates)
    whole.models['pcc'].markers[3, 1] = np.nan  # one that was not there
    whole.models['pcc'].marker_orientations[3, 1] = np.nan
    return whole


def test_csv_as_pythons_reader_has_it(estimate, tmp_path):
    write_arrays(estimate, tmp_path / 'a.csv')
    with (tmp_path / 'a.csv').open(newline='', encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(estimate.stamps_ns)
    assert [int(row['time_s'].replace('.', '')) for row in rows] == estimate.stamps_ns.tolist()

    def column(name):
        return np.array([float(row[name] or 'nan') for row in rows])

    for name, m in estimate.models.items():
        for k, joint in enumerate(m.joint_names):
            np.testing.assert_array_equal(column(f'{name}/joint_states:{joint} [rad]'), m.joints[:, k])
            speed = column(f'{name}/joint_states:{joint}_velocity [rad/s]')
            np.testing.assert_array_equal(speed, m.joint_velocities[:, k])
        for a, axis in enumerate('xyz'):
            for k, marker in enumerate(('M1', 'M2')):
                np.testing.assert_array_equal(
                    column(f'{name}/markers:{marker}_{axis} [m]'), m.markers[:, k, a]
                )
            np.testing.assert_array_equal(column(f'{name}/tip:pose_{axis} [m]'), m.tip[:, a])
            np.testing.assert_array_equal(column(f'{name}/shape:000_{axis} [m]'), 0.0)
            np.testing.assert_array_equal(column(f'{name}/shape:002_{axis} [m]'), m.backbone[:, 2, a])
        for a, axis in enumerate('xyzw'):
            np.testing.assert_array_equal(
                column(f'{name}/markers:M2_q{axis}'), m.marker_orientations[:, 1, a]
            )
            np.testing.assert_array_equal(column(f'{name}/tip:pose_q{axis}'), m.tip_orientation[:, a])
    assert rows[3]['pcc/markers:M2_x [m]'] == ''


def test_npz_as_numpy_has_it(estimate, tmp_path):
    write_arrays(estimate, tmp_path / 'a.npz')
    with np.load(tmp_path / 'a.npz', allow_pickle=False) as got:
        np.testing.assert_array_equal(got['stamps_ns'], estimate.stamps_ns)
        np.testing.assert_array_equal(got['time_s'], estimate.times_s)
        assert got['marker_names'].tolist() == ['M1', 'M2']
        assert got['frame'] == 'base_link'
        for name, m in estimate.models.items():
            assert tuple(got[f'{name}/joint_names']) == m.joint_names
            for key, value in fields_of(m).items():
                np.testing.assert_array_equal(got[f'{name}/{key}'], value)


def test_coordinates_go_from_the_replay_into_every_kind_of_array(bag, configuration, tmp_path):
    c = replace(configuration, models=('pcc', 'pcc_delta'))
    replay(bag, c, tmp_path / 'with')
    estimate = read_estimate(tmp_path / 'with')
    assert estimate.problems == ()
    m = estimate.models['pcc_delta']
    assert m.coordinates.shape == (len(estimate.stamps_ns), 12)
    np.testing.assert_allclose(m.coordinates[:, 5], 0.1)
    with Reader(tmp_path / 'with') as reader:
        said = [
            typestore().deserialize_cdr(data, connection.msgtype)
            for connection, _, data in reader.messages()
            if connection.topic == '/pcc_delta/coordinates'
        ]
    np.testing.assert_array_equal([message.position for message in said], m.coordinates)
    assert np.ptp(m.coordinates[:, 0]) > 0.01
    assert estimate.models['pcc'].coordinates.shape == (len(estimate.stamps_ns), 0)
    for kind in ('csv', 'npz', 'mat'):
        write_arrays(estimate, tmp_path / f'a.{kind}')
    with (tmp_path / 'a.csv').open(newline='', encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    for k, name in enumerate(m.coordinate_names):
        unit = 'm' if name.endswith('_length') else 'rad'
        got = [float(row[f'pcc_delta/coordinates:{name} [{unit}]']) for row in rows]
        np.testing.assert_array_equal(got, m.coordinates[:, k])
    with np.load(tmp_path / 'a.npz', allow_pickle=False) as got:
        np.testing.assert_array_equal(got['pcc_delta/coordinates_rad_m'], m.coordinates)
        assert tuple(got['pcc_delta/coordinate_names']) == m.coordinate_names
        assert 'pcc/coordinate_names' not in got
    scipy = pytest.importorskip('scipy.io')
    got = scipy.loadmat(tmp_path / 'a.mat', simplify_cells=True)['pcc_delta']
    np.testing.assert_array_equal(got['coordinates_rad_m'], m.coordinates)
    assert tuple(got['coordinate_names']) == m.coordinate_names


def fields_of(m):
    return {
        'joints_rad': m.joints,
        'joint_velocities_rad_per_s': m.joint_velocities,
        'markers_m': m.markers,
        'marker_orientations_xyzw': m.marker_orientations,
        'tip_m': m.tip,
        'tip_orientation_xyzw': m.tip_orientation,
        'backbone_m': m.backbone,
        'backbone_orientations_xyzw': m.backbone_orientations,
        'backbone_arc_lengths_m': m.backbone_positions,
    }


def test_mat_as_scipy_has_it(estimate, tmp_path):
    loadmat = pytest.importorskip('scipy.io', reason="needs SciPy, extra 'mat'").loadmat
    write_arrays(estimate, tmp_path / 'a.mat')
    got = loadmat(tmp_path / 'a.mat', simplify_cells=True)
    np.testing.assert_array_equal(got['stamps_ns'], estimate.stamps_ns)
    assert got['marker_names'].tolist() == ['M1', 'M2']
    assert got['frame'] == 'base_link'
    for name, m in estimate.models.items():
        assert tuple(got[name]['joint_names']) == m.joint_names
        for key, value in fields_of(m).items():
            np.testing.assert_array_equal(got[name][key], value)


def test_without_scipy_the_message_names_the_extra(estimate, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'scipy.io', None)
    with pytest.raises(Sesa2Error, match=r"pip install 'sesa2\[mat\]'"):
        write_arrays(estimate, tmp_path / 'a.mat')
    assert not list(tmp_path.glob('*a.mat*'))


def test_tum_trajectories(estimate, tmp_path):
    written = write_arrays(estimate, tmp_path / 'a.tum')
    names = ['a.tum', 'a_rigid_M1.tum', 'a_rigid_M2.tum', 'a_pcc.tum', 'a_pcc_M1.tum', 'a_pcc_M2.tum']
    assert [path.name for path in written] == names
    for name, positions, orientations in (
        ('a.tum', estimate.models['rigid'].tip, estimate.models['rigid'].tip_orientation),
        ('a_pcc.tum', estimate.models['pcc'].tip, estimate.models['pcc'].tip_orientation),
        (
            'a_pcc_M2.tum',
            estimate.models['pcc'].markers[:, 1],
            estimate.models['pcc'].marker_orientations[:, 1],
        ),
    ):
        text = (tmp_path / name).read_text()
        assert text.startswith('# time tx ty tz qx qy qz qw\n')
        table = np.loadtxt(io.StringIO(text), delimiter=' ')
        there = ~np.isnan(positions[:, 0])
        assert there.all() == (name != 'a_pcc_M2.tum')
        np.testing.assert_allclose(table[:, 0], estimate.stamps_ns[there] / 1e9, rtol=1e-15)
        np.testing.assert_array_equal(table[:, 1:4], positions[there])
        np.testing.assert_array_equal(table[:, 4:], orientations[there])


def test_evo_reads_them(estimate, tmp_path):
    file_interface = pytest.importorskip('evo.tools.file_interface', reason='evo is not installed')
    write_arrays(estimate, tmp_path / 'a.tum')
    trajectory = file_interface.read_tum_trajectory_file(tmp_path / 'a.tum')
    assert trajectory.check()[0]
    np.testing.assert_array_equal(trajectory.positions_xyz, estimate.models['rigid'].tip)
    np.testing.assert_array_equal(
        trajectory.orientations_quat_wxyz, estimate.models['rigid'].tip_orientation[:, [3, 0, 1, 2]]
    )


def test_stamps_keep_every_nanosecond(estimate, tmp_path):
    stamps = np.array([-1_500_000_001, -1, 0, 1, 999_999_999, 1_700_000_000_123_456_789])
    n = len(stamps)
    models = {
        name: m._replace(**{k: v[:n] for k, v in m._asdict().items() if len(v) == len(estimate.stamps_ns)})
        for name, m in estimate.models.items()
    }
    write_arrays(estimate._replace(stamps_ns=stamps, models=models), tmp_path / 'a.csv')
    lines = (tmp_path / 'a.csv').read_text().splitlines()[1:]
    assert [line.split(',')[0] for line in lines] == [
        '-1.500000001', '-0.000000001', '0.000000000', '0.000000001', '0.999999999', '1700000000.123456789',
    ]  # fmt: skip


@pytest.mark.parametrize('models', [['rigid'], ['pcc']])
def test_evaluate_reads_the_markers_again(bag_of_estimates, models, tmp_path):
    """What is exported of one model is the truth to itself, and as far from the other as the bags are."""
    write_arrays(read_estimate(bag_of_estimates, models), tmp_path / 'a.csv')
    found = evaluate_bag(bag_of_estimates, tmp_path / 'a.csv', time_offset=0.0)
    other = next(name for name in found.models if name not in models)
    whole = read_estimate(bag_of_estimates)
    apart = np.linalg.norm(whole.models['rigid'].markers - whole.models['pcc'].markers, axis=-1)
    for k, marker in enumerate(('M1', 'M2')):
        assert found.models[models[0]][marker].rmse_mm < 1e-4  # stamps as floats
        assert found.models[other][marker].median_mm == pytest.approx(1e3 * np.median(apart[:, k]), rel=1e-6)
        assert found.models[other][marker].n == len(apart)


def test_a_marker_called_tip_is_not_mixed_up_with_the_tip(bag, configuration, tmp_path):
    named = replace(configuration, markers=replace(configuration.markers, names=('M1', 'tip')))
    replay(bag, named, tmp_path / 'est')
    write_arrays(read_estimate(tmp_path / 'est', ['pcc']), tmp_path / 'a.csv')
    found = evaluate_bag(tmp_path / 'est', tmp_path / 'a.csv', time_offset=0.0)
    assert found.models['pcc']['tip'].rmse_mm < 1e-4


def test_with_several_models_evaluate_asks_which(bag_of_estimates, tmp_path):
    write_arrays(read_estimate(bag_of_estimates), tmp_path / 'a.csv')
    with pytest.raises(Sesa2Error, match='--marker M1=rigid/markers:M1'):
        evaluate_bag(bag_of_estimates, tmp_path / 'a.csv', time_offset=0.0)


def test_a_file_that_exists_is_left_alone(estimate, tmp_path):
    for name in ('a.csv', 'a.npz', 'a.mat', 'a_pcc_M1.tum'):
        (tmp_path / name).write_text('precious')
        with pytest.raises(Sesa2Error, match=f'{name}: exists already'):
            write_arrays(estimate, tmp_path / name.replace('_pcc_M1', ''))
        assert (tmp_path / name).read_text() == 'precious'
    assert not (tmp_path / 'a.tum').exists()
    with pytest.raises(Sesa2Error, match=r"ends in '\.txt', expected \.csv, \.npz, \.mat, \.tum"):
        write_arrays(estimate, tmp_path / 'a.txt')
    with pytest.raises(Sesa2Error, match='cannot be written: No such file'):
        write_arrays(estimate, tmp_path / 'none' / 'a.csv')


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='needs /dev/full')
@pytest.mark.parametrize('kind', ['csv', 'npz', 'mat', 'tum'])
def test_a_full_disk_leaves_nothing(estimate, tmp_path, monkeypatch, kind):
    folder = tmp_path / 'out'
    folder.mkdir()
    opened = Path.open

    def full(path, mode='r', *args, **options):
        return opened(Path('/dev/full') if 'w' in mode else path, mode, *args, **options)

    monkeypatch.setattr(Path, 'open', full)
    with pytest.raises(Sesa2Error, match='cannot be written: No space left'):
        write_arrays(estimate, folder / f'a.{kind}')
    assert not list(folder.iterdir())


def test_the_command(bag_of_estimates, tmp_path, capsys):
    out = str(tmp_path / 'a.csv')
    assert main(['export', str(bag_of_estimates), '--out', out, '--models', 'pcc']) == 0
    assert capsys.readouterr().out.startswith(f'{out}: ')
    header = (tmp_path / 'a.csv').read_text().splitlines()[0]
    assert 'pcc/tip:pose_x [m]' in header
    assert 'rigid' not in header
    assert main(['export', str(bag_of_estimates), '--out', out]) == 1
    assert 'exists already' in capsys.readouterr().err
    assert main(['export', str(bag_of_estimates), '--out', str(tmp_path / 'a.npz'), '--models', 'x']) == 1
    assert 'no model x; there are rigid, pcc' in capsys.readouterr().err
    assert not (tmp_path / 'a.npz').exists()
