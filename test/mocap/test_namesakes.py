"""Several bodies of one name, which systems export: the first is taken, and it is said; never the last, silently."""

import numpy as np
import pytest

from sesa2.mocap.formats import read_motion_capture

MOTIVE = """\
Format Version,1.23,Take Name,arm,Export Frame Rate,100,Rotation Type,Quaternion,Length Units,Millimeters

,Type,Marker,Marker,Marker,Marker,Marker,Marker,Marker,Marker,Marker
,Name,M1,M1,M1,M2,M2,M2,M1,M1,M1
,ID,"1","1","1","2","2","2","3","3","3"
,,Position,Position,Position,Position,Position,Position,Position,Position,Position
Frame,Time (Seconds),X,Y,Z,X,Y,Z,X,Y,Z
0,0.0,1,2,3,4,5,6,7,8,9
"""
VICON = """\
Trajectories
100
,,M1,,,M2,,,M1,,
Frame,Sub Frame,X,Y,Z,X,Y,Z,X,Y,Z
,,mm,mm,mm,mm,mm,mm,mm,mm,mm
1,0,1,2,3,4,5,6,7,8,9
"""
QUALISYS = 'NO_OF_FRAMES\t1\nFREQUENCY\t100\nMARKER_NAMES\tM1\tM2\tM1\n1\t2\t3\t4\t5\t6\t7\t8\t9\n'
TRC = """\
PathFileType\t4\t(X/Y/Z)\ta.trc
DataRate\tUnits
100\tmm
Frame#\tTime\tM1\t\t\tM2\t\t\tM1\t\t
\t\tX1\tY1\tZ1\tX2\tY2\tZ2\tX3\tY3\tZ3

1\t0.0\t1\t2\t3\t4\t5\t6\t7\t8\t9
"""


def check(capture):
    places = {name: 1e3 * body.positions[0] for name, body in capture.bodies.items()}
    assert sorted(places) == ['M1', 'M1 (2)', 'M2']
    np.testing.assert_allclose(
        np.stack([places[n] for n in sorted(places)]), [[1, 2, 3], [7, 8, 9], [4, 5, 6]]
    )
    assert any('several bodies are called M1; the first was taken' in note for note in capture.notes)


@pytest.mark.parametrize(
    ('name', 'content'), [('t.csv', MOTIVE), ('t.csv', VICON), ('t.tsv', QUALISYS), ('t.trc', TRC)]
)
def test_the_first_is_taken_and_it_is_said(export, name, content):
    check(read_motion_capture(export(name, content)))


def test_in_c3d(tmp_path):
    ezc3d = pytest.importorskip('ezc3d', reason='extra mocap')
    file = ezc3d.c3d()
    file['parameters']['POINT']['UNITS']['value'] = ['mm']
    file['parameters']['POINT']['LABELS']['value'] = ['M1', 'M2', 'M1']
    file['parameters']['POINT']['RATE']['value'] = [100.0]
    points = np.ones((4, 3, 1))
    points[:3, :, 0] = np.arange(1, 10).reshape(3, 3).T
    file['data']['points'] = points
    file.write(str(tmp_path / 'a.c3d'))
    check(read_motion_capture(tmp_path / 'a.c3d'))
