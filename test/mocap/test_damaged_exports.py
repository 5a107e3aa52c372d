"""Exports cut short or damaged anywhere: read, or refused with a reason, never anything else."""

import numpy as np
import pytest

from sesa2.errors import Sesa2Error
from sesa2.mocap.formats import read_motion_capture

MOTIVE = """\
Format Version,1.23,Take Name,a,Export Frame Rate,100,Rotation Type,Quaternion,Length Units,Meters

,Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Marker,Marker,Marker
,Name,A,A,A,A,A,A,A,B,B,B
,ID,1,1,1,1,1,1,1,2,2,2
,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Position,Position,Position
Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,X,Y,Z
0,0.00,0,0,0,1,1,2,3,4,5,6
1,0.01,0,0,0,1,1,2,3,,,
"""
VICON = """\
Objects
100
,,Global Angle (Quaternion) a:a,,,,,,,b:M1,,
Frame,Sub Frame,RX,RY,RZ,RW,TX,TY,TZ,TX,TY,TZ
,,,,,,mm,mm,mm,mm,mm,mm
1,0,0,0,0,1,1,2,3,4,5,6
2,0,0,0,0,1,1,2,3,4,5,6
"""
QUALISYS = """\
NO_OF_FRAMES\t2
FREQUENCY\t100
DATA_INCLUDED\t6D
BODY_NAMES\ta
a X\tY\tZ\tRoll\tPitch\tYaw\tResidual\tRot[0]\tRot[1]\tRot[2]\tRot[3]\tRot[4]\tRot[5]\tRot[6]\tRot[7]\tRot[8]
1\t2\t3\t0\t0\t0\t0\t1\t0\t0\t0\t1\t0\t0\t0\t1
"""
TRC = """\
PathFileType\t4\t(X/Y/Z)\ta.trc
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits
100\t100\t2\t1\tmm
Frame#\tTime\tM1\t\t
\t\tX1\tY1\tZ1

1\t0.00\t1\t2\t3
2\t0.01\t1\t2\t3
"""
EUROC = '#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w [],q_x [],q_y [],q_z []\n100000000,1,2,3,1,0,0,0\n'
TUM = '# time\n0.1 1 2 3 0 0 0 1\n0.2 1 2 3 0 0 0 1\n'
NAMED = 'time_s,M1_x,M1_y,M1_z,imu_2_x,imu_2_y,imu_2_z,imu_2_w\n0,1,2,3,0,0,0,1\n'
ALL = {
    'motive': MOTIVE,
    'vicon': VICON,
    'qualisys': QUALISYS,
    'trc': TRC,
    'euroc': EUROC,
    'tum': TUM,
    'named': NAMED,
}


@pytest.mark.parametrize('kind', ALL)
def test_cut_anywhere(export, kind):
    read = 0
    for end in range(len(ALL[kind]) + 1):
        try:
            read += bool(read_motion_capture(export('f.txt', ALL[kind][:end])).bodies)
        except Sesa2Error as error:
            assert 'f.txt' in str(error)  # noqa: PT017
    assert read


@pytest.mark.parametrize('kind', ALL)
def test_damaged_anywhere(export, kind):
    rng = np.random.default_rng(7)
    for _ in range(300):
        data = bytearray(ALL[kind].encode())
        for place in rng.integers(0, len(data), rng.integers(1, 6)):
            data[place] = rng.choice([*b'\n\t,;. 0-9aNXF"\x00\xff', rng.integers(0, 256)])
        path = export('f.txt', '')
        path.write_bytes(bytes(data))
        try:
            capture = read_motion_capture(path)
        except Sesa2Error:
            continue
        for body in capture.bodies.values():
            assert np.isfinite(body.times).all()
            assert body.positions is None or body.positions.shape == (len(body.times), 3)
            assert body.orientations is None or body.orientations.shape == (len(body.times), 4)
