import numpy as np
import pytest

from sesa2.mocap.capture import MocapError
from sesa2.mocap.formats import read_motion_capture

TRAJECTORIES = """\
Trajectories
200
,,arm:M1,,,arm:M2,,
Frame,Sub Frame,X,Y,Z,X,Y,Z
,,mm,mm,mm,mm,mm,mm
101,0,1,2,300.5,,,
102,0,1.5,2,301,4,5,600
"""
DEVICES = """\
Devices
1000
,,Plate - Force,,
Frame,Sub Frame,Fx,Fy,Fz
,,N,N,N
101,0,1,2,3
101,1,1,2,3

"""


def check(capture):
    assert list(capture.bodies) == ['arm:M1', 'arm:M2']
    one, two = capture.bodies.values()
    np.testing.assert_allclose(one.times, [0.5, 0.505])
    np.testing.assert_allclose(one.positions, [[1e-3, 2e-3, 0.3005], [1.5e-3, 2e-3, 0.301]])
    np.testing.assert_allclose(two.positions, [[np.nan] * 3, [4e-3, 5e-3, 0.6]])


@pytest.mark.parametrize(
    'content',
    [
        TRAJECTORIES,
        DEVICES + TRAJECTORIES,
        TRAJECTORIES + '\n' + DEVICES,
        TRAJECTORIES.replace('200\n', '200,,,,,,,\n').replace('Trajectories\n', 'Trajectories,,,,,,,\n')
        + ',,,,,,,\n',
        TRAJECTORIES.replace(',', ';'),
        TRAJECTORIES.replace('.', '!').replace(',', '\t').replace('!', ','),
        TRAJECTORIES.replace('300.5,,,', '300.5'),
    ],
)
def test_trajectories_among_other_sections(export, content):
    check(read_motion_capture(export('trial.csv', content)))


def test_windows(export):
    check(read_motion_capture(export('trial.csv', DEVICES + TRAJECTORIES, newline='\r\n')))


def test_metres_where_the_header_says_so(export):
    capture = read_motion_capture(export('trial.csv', TRAJECTORIES.replace('mm', 'm')))
    np.testing.assert_allclose(capture.bodies['arm:M1'].positions[0], [1, 2, 300.5])


def test_objects_of_tracker(export):
    content = """\
Objects
100
,,Global Angle (Quaternion) imu_2:imu_2,,,,,,
Frame,Sub Frame,RX,RY,RZ,RW,TX,TY,TZ
,,,,,,mm,mm,mm
1,0,0.1,0.2,0.3,0.9,10,20,30
2,0,,,,,,,
"""
    body = read_motion_capture(export('trial.csv', content)).bodies['imu_2']
    np.testing.assert_allclose(body.times, [0.0, 0.01])
    np.testing.assert_allclose(body.orientations, [[0.1, 0.2, 0.3, 0.9], [np.nan] * 4])
    np.testing.assert_allclose(body.positions[0], [0.01, 0.02, 0.03])


def test_segments_without_quaternions(export):
    content = """\
Segments
100
,,Arm:tip,,,,,
Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ
,,deg,deg,deg,mm,mm,mm
1,0,10,20,30,10,20,30
"""
    capture = read_motion_capture(export('trial.csv', content))
    assert capture.bodies['Arm:tip'].orientations is None
    np.testing.assert_allclose(capture.bodies['Arm:tip'].positions, [[0.01, 0.02, 0.03]])
    assert 'no quaternions' in capture.notes[0]


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        (DEVICES, 'with the sections Devices; expected Trajectories'),
        (TRAJECTORIES.replace('200', 'fast'), "line 2: 'fast', expected the rate in Hz"),
        (DEVICES + TRAJECTORIES.replace('301', '3o1'), "line 15: arm:M1 Z is '3o1'"),
    ],
)
def test_refused(export, content, message):
    with pytest.raises(MocapError, match=message):
        read_motion_capture(export('trial.csv', content))
