import numpy as np
import pytest

from sesa2.mocap.capture import MocapError
from sesa2.mocap.formats import read_motion_capture

HEADER = 'time_s,M1_x,M1_y,M1_z,M2_x,M2_y,M2_z\n'


def test_metres_and_seconds(export):
    capture = read_motion_capture(export('t.csv', HEADER + '100.0,1,2,3,4,5,6\n100.01,1.5,2,3,4,5,-6e-1\n'))
    assert list(capture.bodies) == ['M1', 'M2']
    np.testing.assert_array_equal(capture.bodies['M1'].times, [100.0, 100.01])
    np.testing.assert_array_equal(capture.bodies['M2'].positions, [[4, 5, 6], [4, 5, -0.6]])
    assert capture.bodies['M1'].orientations is None
    assert capture.notes == ()


@pytest.mark.parametrize(
    'header',
    [
        'note, M1_z ,M1_x,M1_y,time_s\n',
        'note;M1_z;M1_x;M1_y;time_s\n',
        'note,M1.z,M1.x,M1.y,Time\n',
        'note,M1 Z,M1 X,M1 Y,Time (s)\n',
        'note,M1 Z,M1 X,M1 Y,Zeit [s]\n',
        'note,M1 Z,M1 X,M1 Y,temps (s)\n',
        'note,M1 Z,M1 X,M1 Y,Time (Seconds)\n',
        'note,M1-Z [m],M1-X [m],M1-Y [m],timestamp\n',
        '"note","M1_z","M1_x","M1_y","time_s"\n',
    ],
)
def test_columns_by_name_whatever_their_order_and_spelling(export, header):
    line = 'first,3,1,2,0.5\r\n\r\n'
    path = export('t.csv', header + (line.replace(',', ';') if ';' in header else line), encoding='utf-8-sig')
    body = read_motion_capture(path).bodies['M1']
    np.testing.assert_array_equal(body.times, [0.5])
    np.testing.assert_array_equal(body.positions, [[1, 2, 3]])


@pytest.mark.parametrize(
    'unit', ['M1_x [mm],M1_y [mm],M1_z [mm]', 'M1_x_mm,M1_y_mm,M1_z_mm', 'M1 x (mm),M1 y (mm),M1 z (mm)']
)
def test_a_unit_behind_the_axis(export, unit):
    body = read_motion_capture(export('t.csv', f'time_s,{unit}\n0,10,20,300\n')).bodies['M1']
    np.testing.assert_allclose(body.positions, [[0.01, 0.02, 0.3]])


@pytest.mark.parametrize(
    ('column', 'second'), [('time_ms', 1e3), ('time_us', 1e6), ('time_ns', 1e9), ('Time [ms]', 1e3)]
)
def test_a_unit_of_time_in_the_name(export, column, second):
    path = export('t.csv', f'{column},A_x,A_y,A_z\n{int(2 * second)},1,2,3\n{int(7 * second)},1,2,3\n')
    np.testing.assert_allclose(read_motion_capture(path).bodies['A'].times, [2.0, 7.0])


def test_frames_with_their_rate(export):
    path = export('t.csv', 'Frame,A_x,A_y,A_z\n10,1,2,3\n11,1,2,3\n')
    np.testing.assert_allclose(read_motion_capture(path, rate=50.0).bodies['A'].times, [0.2, 0.22])
    with pytest.raises(MocapError, match='give the rate of the frames'):
        read_motion_capture(path)


def test_orientations(export):
    header = 'time_s,A_x,A_y,A_z,A_qw,A_qx,A_qy,A_qz,imu_2_w,imu_2_x,imu_2_y,imu_2_z\n'
    capture = read_motion_capture(export('t.csv', header + '0,1,2,3,0.9,0.1,0.2,0.3,0.8,0.4,0.5,0.6\n'))
    np.testing.assert_array_equal(capture.bodies['A'].positions, [[1, 2, 3]])
    np.testing.assert_array_equal(capture.bodies['A'].orientations, [[0.1, 0.2, 0.3, 0.9]])
    assert capture.bodies['imu_2'].positions is None
    np.testing.assert_array_equal(capture.bodies['imu_2'].orientations, [[0.4, 0.5, 0.6, 0.8]])


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        (
            'time_s,M1_x,M1_y,M1_z,m2_x,M2_y,M2_z\n0,1,2,3,4,5,6\n',
            'no column (M2_x, but M2_y|m2_y, but m2_x)',
        ),
        (
            'when,M1_x,M1_y,M1_z\n0,1,2,3\n',
            "no column time_s; the nearest is '.*A CSV must have the columns time_s",
        ),
        (HEADER, 'has no samples below its header'),
        (HEADER.replace('M1_y', 'M1_x'), '2 columns are called M1_x'),
        ('time_s,time_s,M1_x,M1_y,M1_z\n0,0,1,2,3\n', '2 columns are called time_s'),
        (HEADER + '0,1,2,3,4,5,6\n0.1,1,2,x3,4,5,6\n', "t.csv, line 3: M1_z is 'x3', expected a number"),
        (HEADER + ',1,2,3,4,5,6\n', 'line 2: time_s is empty'),
        (HEADER + '0,1,2\n1,1,2,3,4,5,6\n', 'line 2: fewer cells than the 7 expected'),
        ('time_s,gyro,acc\n0,1,2\n', "none of its columns is a marker's or an IMU's: time_s, gyro, acc"),
    ],
)
def test_refuses_and_says_where(export, text, message):
    with pytest.raises(MocapError, match=message):
        read_motion_capture(export('t.csv', text))


@pytest.mark.parametrize(
    'above',
    [
        '# made by hand\n\n# twice\n' + HEADER,
        '# ' + HEADER,
        '# made by hand\n#' + HEADER,
        HEADER + 's,m,m,m,m,m,m\n',
        HEADER.replace(',', ' ').replace('time', '# time'),
        HEADER.replace(',', ':', 0).replace('_x', ':x').replace('_y', ':y').replace('_z', ':z'),
    ],
)
def test_comments_units_and_blanks(export, above):
    numbers = '0.5,1,2,3,4,5,6\n0.6,1.5,2,3,4,5,-6\n'
    if ',' not in above:
        numbers = numbers.replace(',', '  ')
    capture = read_motion_capture(export('t.csv', above + numbers))
    assert list(capture.bodies) == ['M1', 'M2']
    assert capture.notes == ()
    np.testing.assert_array_equal(capture.bodies['M2'].times, [0.5, 0.6])
    np.testing.assert_array_equal(capture.bodies['M2'].positions, [[4, 5, 6], [4, 5, -6]])


def test_a_line_of_units_is_believed(export):
    path = export('t.csv', 'time,M1_x,M1_y,M1_z\n[ms],[mm],[mm],[mm]\n500,10,20,300\n')
    body = read_motion_capture(path).bodies['M1']
    np.testing.assert_allclose(body.times, [0.5])
    np.testing.assert_allclose(body.positions, [[0.01, 0.02, 0.3]])


def test_a_body_in_two_units_is_refused(export):
    with pytest.raises(MocapError, match='M1 is in m and in mm, expected one unit'):
        read_motion_capture(export('t.csv', 'time_s,M1_x [mm],M1_y [mm],M1_z [m]\n0,1,2,3\n'))


def test_what_is_not_used_is_told(export):
    rows = '0,1,1,2,3,25\n'
    path = export('t.csv', 'time_s,frame,M1_x,M1_y,M1_z,temperature\n' + rows)
    assert read_motion_capture(path).notes == ('t.csv: columns not used: temperature',)
    path = export('t.csv', 'time_s,M1_yaw,M1_x,M1_y,M1_z,frame\n' + rows)
    (note,) = read_motion_capture(path).notes
    assert 't.csv: columns not used: M1_yaw; roll, pitch and yaw are not read' in note
    with pytest.raises(
        MocapError, match=r'imu_2_yaw\. roll, pitch and yaw are not read.*expected quaternions'
    ):
        read_motion_capture(export('t.csv', 'time_s,imu_2_roll,imu_2_pitch,imu_2_yaw\n0,1,2,3\n'))


def test_a_tip_is_not_taken_for_euroc(export):
    capture = read_motion_capture(export('t.csv', '# time,tip_x,tip_y,tip_z\n0.5,1,2,3\n'))
    assert capture.kind == 'CSV with named columns'
    assert list(capture.bodies) == ['tip']
