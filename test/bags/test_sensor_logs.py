"""Logs of one file a sensor as a recording: whose they are, their clocks, and what replay and align make of them."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.bags.reading import ImuRecording, read_poses
from sesa2.bags.recording import open_recording
from sesa2.bags.sensor_logs import assign_logs
from sesa2.cli import main
from sesa2.configuration import files, validate
from sesa2.errors import Sesa2Error

CASE = '16-imu-logs-one-per-sensor'
NS = 10**9
needs_vqf = pytest.mark.skipif(find_spec('vqf') is None, reason='vqf is not installed (extra raw)')


def configured(path, fusion='none', n=2):
    c = validate(
        {
            'arm': {'length': 0.1 * n},
            'imus': {
                'ids': list(range(1, n + 1)),
                'positions': [0.1 * k for k in range(1, n + 1)],
                'fusion': fusion,
            },
            'markers': {'names': ['A'], 'positions': [0.1 * n]},
            'models': ['pcc'],
        }
    )
    path.write_text(files.dump(c))
    return str(path)


def dot(path, q, start_us=1_000_000, period_us=16_667):
    rows = [
        f'{k},{start_us + k * period_us},{w:.6f},{x:.6f},{y:.6f},{z:.6f}' for k, (x, y, z, w) in enumerate(q)
    ]
    path.write_text('\n'.join(['PacketCounter,SampleTimeFine,Quat_W,Quat_X,Quat_Y,Quat_Z', *rows, '']))
    return path


def swing(n, part):
    t = np.arange(n) / 60.0
    return Rotation.from_rotvec(np.outer(np.sin(2.0 * t), [0.0, 0.6 * part, 0.0])).as_quat()


def test_logs_in_the_order_of_the_ids_or_by_id(tmp_path):
    a, b = dot(tmp_path / 'a.csv', swing(60, 1)), dot(tmp_path / 'b.csv', swing(60, 2))
    assert assign_logs([str(a), str(b)], [4, 7]) == {4: a, 7: b}
    assert assign_logs([f'7={a}', f'4={b}'], [4, 7]) == {7: a, 4: b}
    assert assign_logs([f'7={a}'], [4, 7]) == {7: a}
    assert assign_logs([str(tmp_path)], [4, 7]) == tmp_path
    assert assign_logs([str(a)], [4]) == {4: a}
    for arguments, expected in [
        ([str(a)], r'a.csv is the log of one sensor \(Xsens DOT\); the configuration has 2 IMUs'),
        ([str(a), str(b), str(b)], 'are 3 logs of one sensor each'),
        ([str(a), f'4={b}'], 'of which IMU'),
        ([f'5={a}'], 'no IMU 5, expected one of 4, 7'),
        ([f'4={a}', f'4={b}'], 'IMU 4 has a log already'),
        ([str(a), str(a)], 'given for several IMUs'),
    ]:
        with pytest.raises(Sesa2Error, match=expected):
            assign_logs(arguments, [4, 7])


def test_replay_of_logs_gives_the_arm(tmp_path, capsys):
    config = configured(tmp_path / 'arm.yaml')
    logs = [str(dot(tmp_path / f'{k}.csv', swing(120, k))) for k in (1, 2)]
    assert main(['replay', *logs, '--config', config, '--out', str(tmp_path / 'out')]) == 0
    assert 'warning' not in capsys.readouterr().err
    markers = read_poses(tmp_path / 'out', 'pcc/markers')
    assert len(markers.times_s) == 120
    # An arc that bends by twice the angle of its middle: x = L (1 - cos θ)/θ, about y.
    angle = 1.2 * np.sin(2.0 * np.arange(120) / 60.0)
    with np.errstate(invalid='ignore'):
        x = np.where(angle == 0.0, 0.0, 0.2 * (1 - np.cos(angle)) / angle)
    np.testing.assert_allclose(markers.positions[:, 0, 0], x, atol=1e-3)


def test_align_takes_logs_too(tmp_path, capsys):
    config = configured(tmp_path / 'arm.yaml')
    tilted = np.tile(Rotation.from_rotvec([0.05, 0.0, 0.0]).as_quat(), (300, 1))
    logs = [str(dot(tmp_path / f'{k}.csv', tilted)) for k in (1, 2)]
    assert main(['align', *logs, '--config', config, '--out', str(tmp_path / 'aligned.yaml')]) == 0
    assert '-2.86' in capsys.readouterr().out or (tmp_path / 'aligned.yaml').exists()


def read_all(logs):
    with open_recording(logs) as recording:
        return list(ImuRecording(recording).samples()), recording.problems


def test_clocks_of_one_set_are_kept_and_others_are_laid_together(tmp_path):
    q = swing(120, 1)
    a = dot(tmp_path / 'a.csv', q)
    later = dot(tmp_path / 'later.csv', q, start_us=1_500_000)
    samples, problems = read_all({1: a, 2: later})
    first = {i: min(s.stamp_ns for s in samples if s.id == i) for i in (1, 2)}
    assert (first[2] - first[1], problems) == (NS // 2, [])
    elsewhere = dot(tmp_path / 'elsewhere.csv', q, start_us=900_000_000)
    samples, [problem] = read_all({1: a, 2: elsewhere})
    first = {i: min(s.stamp_ns for s in samples if s.id == i) for i in (1, 2)}
    assert first[1] == first[2] == NS
    assert 'are not one (they begin at IMU 1 1.000 s, IMU 2 900.000 s)' in problem
    assert 'begin at the same moment' in problem


def test_phones_of_different_days_are_refused(tmp_path):
    logs = {}
    for imu, begin in ((1, 1_700_000_000), (2, 1_700_090_000)):
        rows = [f'{begin * NS + k * 10**7},{k / 100},0,0,0,1,0,0,0' for k in range(50)]
        logs[imu] = tmp_path / f'{imu}.csv'
        logs[imu].write_text('\n'.join(['time,seconds_elapsed,qz,qy,qx,qw,roll,pitch,yaw', *rows]))
    with pytest.raises(Sesa2Error, match='not made at the same time'):
        read_all(logs)


@pytest.mark.parametrize(
    ('name', 'period'), [('dot_1.csv', 0.016667), ('mtw_1.txt', 0.02), ('Orientation.csv', 0.01)]
)
def test_the_case_in_place(cases, tmp_path, capsys, name, period):
    """The three hold the same motion; alone each is told what to do."""
    path = cases / CASE / name
    config = configured(tmp_path / 'arm.yaml')
    out = str(tmp_path / 'out')
    assert main(['replay', str(path), '--config', config, '--out', out]) == 1
    assert 'is the log of one sensor' in capsys.readouterr().err
    assert main(['replay', f'1={path}', '--config', config, '--out', out]) == 0
    samples, _ = read_all({1: path})
    assert len(samples) == 60
    np.testing.assert_allclose(np.diff([s.stamp_ns for s in samples]) / NS, period, atol=1e-6)
    np.testing.assert_allclose(samples[0][2:6], [-0.264778, -0.095645, -0.018433, 0.959377], atol=1e-6)
    np.testing.assert_allclose(samples[-1][2:6], [-0.190853, -0.072875, -0.014465, 0.978803], atol=1e-6)


def test_the_case_without_orientations(cases, tmp_path, capsys):
    path = cases / CASE / 'raw.csv'
    config = configured(tmp_path / 'arm.yaml')
    out = str(tmp_path / 'out')
    assert main(['replay', str(path), '--config', config, '--out', out]) == 1
    assert 'without orientations, which imus.fusion: 6d makes of it' in capsys.readouterr().err
    assert main(['replay', f'1={path}', '--config', config, '--out', out]) == 1
    error = capsys.readouterr().err
    assert '60 samples not used' in error
    assert 'imus.fusion: 6d' in error
    assert not (tmp_path / 'out').exists()


@needs_vqf
def test_the_case_without_orientations_is_fused(cases, tmp_path):
    path = cases / CASE / 'raw.csv'
    config = configured(tmp_path / 'arm.yaml', '6d')
    assert main(['replay', f'1={path}', '--config', config, '--out', str(tmp_path / 'out')]) == 0
    # It lies still, its z up but for 0.02 g: so does the arm.
    tip = read_poses(tmp_path / 'out', 'pcc/markers').positions[-1, 0]
    np.testing.assert_allclose(tip, [0.0, 0.0, 0.2], atol=0.01)


def inertial_csv(path, *, drop=''):
    t = np.arange(600) / 100.0
    head = 'time_s,' + ','.join(f'imu_{i}_{c}' for i in (1, 2) for c in ('gx', 'gy', 'gz', 'ax', 'ay', 'az'))
    angle, rate = 0.5 * np.sin(t), 0.5 * np.cos(t)
    one = np.stack([0 * t, rate, 0 * t, -9.81 * np.sin(angle), 0 * t, 9.81 * np.cos(angle)], axis=-1)
    rows = np.column_stack([t, one, one])
    text = '\n'.join([head, *(','.join(f'{v:.6f}' for v in row) for row in rows), ''])
    path.write_text(text.replace(drop, 'other') if drop else text)
    return path


@needs_vqf
def test_a_csv_of_all_imus_is_fused(tmp_path):
    path = inertial_csv(tmp_path / 'raw.csv')
    config = configured(tmp_path / 'arm.yaml', '6d')
    assert main(['replay', str(path), '--config', config, '--out', str(tmp_path / 'out')]) == 0
    markers = read_poses(tmp_path / 'out', 'pcc/markers')
    assert len(markers.times_s) == 600
    # Both links lean by the same angle about y, the first one bends from upright.
    angle = 0.5 * np.sin(np.arange(600) / 100.0)
    x = 0.1 * np.where(angle == 0, 0, (1 - np.cos(angle)) / np.where(angle == 0, 1, angle)) + 0.1 * np.sin(
        angle
    )
    np.testing.assert_allclose(markers.positions[:, 0, 0], x, atol=2e-3)


def test_a_csv_of_all_imus_without_fusion_or_whole_columns_is_told(tmp_path, capsys):
    config = configured(tmp_path / 'arm.yaml')
    out = ['--config', config, '--out', str(tmp_path / 'out')]
    assert main(['replay', str(inertial_csv(tmp_path / 'raw.csv')), *out]) == 1
    assert '1200 samples not used: the driver says' in capsys.readouterr().err
    assert main(['replay', str(inertial_csv(tmp_path / 'b.csv', drop='imu_2_az')), *out]) == 1
    assert 'has a column imu_2_ax, but none imu_2_az' in capsys.readouterr().err


def with_units(text):
    """The same numbers in °/s and g, a comment above, and a column of words that nobody asked for."""
    header, *rows = text.strip().split('\n')
    units = {'g': ('[deg/s]', np.pi / 180.0), 'a': ('[g]', 9.80665)}
    names = header.split(',')
    cells = [[name, *(row.split(',')[k] for row in rows)] for k, name in enumerate(names)]
    for column in cells[1:]:
        unit, scale = units[column[0].split('_')[2][0]]
        column[:] = [f'{column[0]} {unit}', *(f'{float(v) / scale:.9f}' for v in column[1:])]
    cells.append(['note', *['words'] * len(rows)])
    return '# by hand\n' + '\n'.join(map(','.join, zip(*cells, strict=True))) + '\n'


@needs_vqf
def test_a_csv_of_all_imus_in_other_units(tmp_path, capsys):
    config = configured(tmp_path / 'arm.yaml', '6d')
    path = inertial_csv(tmp_path / 'raw.csv')
    other = tmp_path / 'other.csv'
    other.write_text(with_units(path.read_text()))
    for source in (path, other):
        assert main(['replay', str(source), '--config', config, '--out', str(tmp_path / source.stem)]) == 0
    assert 'warning: other.csv: columns not used: note' in capsys.readouterr().err
    one, two = (read_poses(tmp_path / name, 'pcc/markers').positions for name in ('raw', 'other'))
    np.testing.assert_allclose(one, two, atol=1e-5)
    other.write_text(other.read_text().replace('[g]', '[stone]'))
    assert main(['replay', str(other), '--config', config, '--out', str(tmp_path / 'x')]) == 1
    assert "imu_1_ax in 'stone', expected one of g, mg, m/s^2" in capsys.readouterr().err


def test_trajectories_of_one_body_a_file(tmp_path):
    """And a file that says whose it is stands in its place: a shell sorts imu_10 before imu_2."""
    q = Rotation.from_rotvec(np.outer(np.linspace(0.0, 1.0, 50), [0.0, 1.0, 0.0])).as_quat()
    for imu in (1, 2):
        rows = [f'{5 + k / 100:.2f} 0 0 0 ' + ' '.join(f'{v:.9f}' for v in one) for k, one in enumerate(q)]
        (tmp_path / f'imu_{imu}.tum').write_text('\n'.join(rows) + '\n')
    given = [str(tmp_path / f'imu_{imu}.tum') for imu in (1, 2)]
    samples, _ = read_all(assign_logs(given, (1, 2)))
    assert [s.id for s in samples] == [1, 2] * 50
    np.testing.assert_allclose([s[2:6] for s in samples[::2]], q, atol=1e-8)
    with pytest.raises(
        Sesa2Error, match=r'imu_2.tum comes in the place of IMU 1 in the order 1, 2: give all as ID='
    ):
        assign_logs(given[::-1], (1, 2))
    assert assign_logs([f'1={given[1]}', f'2={given[0]}'], (1, 2)) == {1: Path(given[1]), 2: Path(given[0])}


def test_a_folder_is_no_log(tmp_path):
    for name in ('a', 'b'):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'Inertial.csv').write_text('x')
    with pytest.raises(
        Sesa2Error, match=r'a is a folder, expected the log of one sensor; in it are: Inertial.csv'
    ):
        read_all(assign_logs([str(tmp_path / 'a'), str(tmp_path / 'b')], (1, 2)))
    with pytest.raises(Sesa2Error, match=r'a/Inertial.csv, b/Inertial.csv are 2 logs'):
        assign_logs([str(tmp_path / name / 'Inertial.csv') for name in ('a', 'b')], (1, 2, 3))
