"""Logs of one sensor as their makers write them: golden files written by hand, and the numbers that they hold."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.errors import Sesa2Error
from sesa2.imu_logs.log_formats import read_sensor_log

Q = [-0.264778, -0.095645, -0.018433, 0.959377]  # x y z w, of the cases' first row

DOT = """sep=,
DeviceTag:,arm-1
FirmwareVersion:,2.0.0
OutputRate:,60Hz
SyncStatus:,Synced

PacketCounter,SampleTimeFine,Quat_W,Quat_X,Quat_Y,Quat_Z,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z,Mag_X,Mag_Y,Mag_Z
1,4294950629,0.959377,-0.264778,-0.095645,-0.018433,0.1,0.2,9.8,90.0,-45.0,1.0,0.5,0.1,-0.8
2,0,0.960315,-0.261777,-0.094970,-0.015747,0.1,0.2,9.7,90.0,-45.0,1.0,0.5,0.1,-0.8
"""
DOT_EULER = """DeviceTag:,arm-1
OutputRate:,60Hz
PacketCounter,SampleTimeFine,Euler_X,Euler_Y,Euler_Z,FreeAcc_X,FreeAcc_Y,FreeAcc_Z,Status
1,16667,-96.604095,-14.144427,43.073235,-0.022103,-0.080439,0.119097,0
2,33334,-96.0,-14.0,43.0,-0.022103,-0.080439,0.119097,0
"""
MTW = """// Start Time: Unknown
// Update Rate: 40.0Hz
// Filter Profile: human (46.1)
// Firmware Version: 4.6.0
PacketCounter\tSampleTimeFine\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\tMag_X\tMag_Y\tMag_Z\tQuat_q0\tQuat_q1\tQuat_q2\tQuat_q3
65535\t\t9.4\t-1.7\t-1.8\t0.5\t-0.25\t0.1\t-0.79\t0.24\t-0.28\t0.959377\t-0.264778\t-0.095645\t-0.018433
0\t\t9.4\t-1.7\t-1.8\t0.5\t-0.25\t0.1\t-0.79\t0.24\t-0.28\t0.960315\t-0.261777\t-0.094970\t-0.015747
2\t\t9.4\t-1.7\t-1.8\t0.5\t-0.25\t0.1\t-0.79\t0.24\t-0.28\t0.960315\t-0.261777\t-0.094970\t-0.015747
"""
MTI_MATRIX = """// Firmware Version: 4.0.2
PacketCounter;SampleTimeFine;Mat[1][1];Mat[2][1];Mat[3][1];Mat[1][2];Mat[2][2];Mat[3][2];Mat[1][3];Mat[2][3];Mat[3][3]
10;1000;0,0;1,0;0,0;-1,0;0,0;0,0;0,0;0,0;1,0
11;1100;1,0;0,0;0,0;0,0;1,0;0,0;0,0;0,0;1,0
"""
INERTIAL = ','.join(
    [f'Gyroscope {axis} (deg/s)' for axis in 'XYZ'] + [f'Accelerometer {axis} (g)' for axis in 'XYZ']
)
FIELD = ','.join(f'Magnetometer {axis} (uT)' for axis in 'XYZ')
XIMU3 = f"""Timestamp (us),{INERTIAL}
1000000,180.0,-90.0,9.0,0.0,0.5,1.0
1002500,180.0,-90.0,9.0,0.0,0.5,1.0
"""
NGIMU = f"""Time (s),{INERTIAL},{FIELD},Barometer (hPa)
1.00,180.0,-90.0,9.0,0.0,0.5,1.0,20.0,0.0,-44.0,1013.0
1.02,180.0,-90.0,9.0,0.0,0.5,1.0,20.0,0.0,-44.0,1013.0
"""
XIO_QUATERNION = """Time (s),W,X,Y,Z
1.00,0.959377,-0.264778,-0.095645,-0.018433
1.01,0.960315,-0.261777,-0.094970,-0.015747
"""
PHONE = """time,seconds_elapsed,qz,qy,qx,qw,roll,pitch,yaw
1700000006100000000,6.100000,-0.018433,-0.095645,-0.264778,0.959377,0,0,0
1700000006110000000,6.110000,-0.015747,-0.094970,-0.261777,0.960315,0,0,0
"""


def read(tmp_path: Path, text: str, name='log.csv'):
    (tmp_path / name).write_text(text)
    return read_sensor_log(tmp_path / name)


def test_xsens_dot(tmp_path):
    log = read(tmp_path, DOT)
    assert log.kind == 'Xsens DOT'
    # Its clock began again at 0, one period after.
    np.testing.assert_allclose(np.diff(log.times), 0.016667, atol=1e-9)
    np.testing.assert_allclose(log.orientations[0], Q)
    np.testing.assert_allclose(log.angular_velocities[0], np.deg2rad([90.0, -45.0, 1.0]))
    np.testing.assert_allclose(log.accelerations[1], [0.1, 0.2, 9.7])
    np.testing.assert_allclose(log.fields[0], np.array([0.5, 0.1, -0.8]) * 5e-5)


def test_xsens_dot_with_angles_is_what_scipy_makes_of_them(tmp_path):
    log = read(tmp_path, DOT_EULER)
    assert log.accelerations is None  # free of gravity, which is no use here
    expected = Rotation.from_euler('ZYX', [43.073235, -14.144427, -96.604095], degrees=True)
    assert (Rotation.from_quat(log.orientations[0]).inv() * expected).magnitude() < 1e-9


def test_mt_manager_counts_by_its_rate(tmp_path):
    log = read(tmp_path, MTW, 'MT_00B4D7CE.txt')
    assert log.kind == 'Xsens MT Manager'
    np.testing.assert_allclose(np.diff(log.times), [0.025, 0.05])
    np.testing.assert_allclose(log.orientations[0], Q)
    np.testing.assert_allclose(log.angular_velocities[0], [0.5, -0.25, 0.1])
    np.testing.assert_allclose(log.accelerations[0], [9.4, -1.7, -1.8])


def test_mt_manager_with_matrices_and_decimal_commas(tmp_path):
    log = read(tmp_path, MTI_MATRIX, 'log.txt')
    np.testing.assert_allclose(log.times, [0.1, 0.11])
    turned = Rotation.from_quat(log.orientations[0]).apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(turned, [0.0, 1.0, 0.0], atol=1e-12)


def test_xio_says_its_units(tmp_path):
    log, short = read(tmp_path, NGIMU), read(tmp_path, XIMU3, 'Inertial.csv')
    np.testing.assert_allclose(np.diff(log.times), 0.02)
    np.testing.assert_allclose(np.diff(short.times), 0.0025)
    for one in (log, short):
        assert one.orientations is None
        np.testing.assert_allclose(one.angular_velocities[0], [np.pi, -np.pi / 2, np.pi / 20])
        np.testing.assert_allclose(one.accelerations[0], [0.0, 0.5 * 9.80665, 9.80665])
    np.testing.assert_allclose(log.fields[0], [20e-6, 0.0, -44e-6])


@pytest.mark.parametrize('prefix', ['', 'Quaternion '])
def test_xio_quaternions(tmp_path, prefix):
    text = XIO_QUATERNION.replace('W,X,Y,Z', ','.join(prefix + axis for axis in 'WXYZ'))
    np.testing.assert_allclose(read(tmp_path, text).orientations[0], Q)


def test_sensor_logger_by_the_time_of_day(tmp_path):
    log = read(tmp_path, PHONE, 'Orientation.csv')
    np.testing.assert_allclose(log.times - 1_700_000_000.0, [6.1, 6.11], atol=1e-6)
    np.testing.assert_allclose(log.orientations[0], Q)


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        (DOT.replace('Quat_Z', 'Other'), 'has a column quat_x, but none quat_z'),
        (XIMU3.replace('(g)', '(lbf)'), "accelerometer in 'lbf', expected one of g,"),
        (XIMU3.replace('Gyroscope', 'Spin'), 'no quaternion, and not both gyroscope and accelerometer'),
        (MTW.replace('// Update Rate: 40.0Hz\n', ''), 'no time: expected a line "// Update Rate'),
        (PHONE.replace('qw', 'w'), 'has a column qx, but none qw'),
        ('time,seconds_elapsed,z,y,x\n1,0.1,0,0,0\n', 'Orientation.csv has'),
        ('a,b\n1,2\n', 'no log of one sensor that is known'),
        (DOT.replace('0.960315', 'abc'), "line 9: quat_w is 'abc'"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, expected):
    with pytest.raises(Sesa2Error, match=expected.replace('(', r'\(')):
        read(tmp_path, text)


@pytest.mark.parametrize(
    'header', ['X (a.u.),Y (a.u.),Z (a.u.)', 'X Axis (a.u.),Y Axis (a.u.),Z Axis (a.u.)']
)
def test_an_ximu3_has_its_field_in_a_file_beside(tmp_path, header):
    """At a lower rate, and of a time of its own: taken with the nearest sample, and with none in a gap."""
    times = [*range(1_000_000, 1_100_000, 2500), *range(1_500_000, 1_600_000, 2500)]
    inertial = f'Timestamp (us),{INERTIAL}\n' + ''.join(f'{t},180.0,-90.0,9.0,0.0,0.5,1.0\n' for t in times)
    fields = f'Timestamp (us),{header}\n1050900,0.2,-0.4,1.0\n1300000,9,9,9\n1551300,0.4,0.0,-0.8\n'
    (tmp_path / 'Magnetometer.csv').write_text(fields)
    log = read(tmp_path, inertial, 'Inertial.csv')
    at = [times.index(1_050_000), times.index(1_552_500)]
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(log.fields[:, 0])), at)
    np.testing.assert_allclose(log.fields[at], [[1e-5, -2e-5, 5e-5], [2e-5, 0.0, -4e-5]])
    (note,) = log.notes
    assert note.endswith('Magnetometer.csv: 1 of 3 magnetic fields are of a time without samples')
    (tmp_path / 'Magnetometer.csv').unlink()
    assert read(tmp_path, inertial, 'Inertial.csv').fields is None


@pytest.mark.parametrize(
    'header',
    ['X (a.u.),Y (a.u.),Z (a.u.)', 'X (g),Y (g),Z (g)', 'XX,XY,XZ', 'Roll (deg),Pitch (deg),Yaw (deg)'],
)
def test_other_files_of_an_ximu3_are_no_log(tmp_path, header):
    with pytest.raises(
        Sesa2Error, match=r'no quaternion, and not both gyroscope and acc|no log of one sensor'
    ):
        read(tmp_path, f'Timestamp (us),{header}\n1000000,0.1,0.2,0.3\n')
