"""Trajectories of one body: TUM and EuRoC."""

import numpy as np
import pytest

from sesa2.mocap.capture import MocapError
from sesa2.mocap.formats import read_motion_capture

TUM = """\
# timestamp tx ty tz qx qy qz qw
100.0 1 2 3 0.1 0.2 0.3 0.9
100.1 1.5 2 3e0 0.1 0.2 0.3 0.9
"""
EUROC = """\
#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],v_RS_R_x [m s^-1]
100000000000,1,2,3,0.9,0.1,0.2,0.3,7
100100000000,1.5,2,3,0.9,0.1,0.2,0.3,7
"""


@pytest.mark.parametrize(
    ('name', 'content', 'kind'),
    [
        ('tip.txt', TUM, 'TUM trajectory'),
        ('tip.tum', TUM.replace(' ', '   '), 'TUM trajectory'),
        ('tip.csv', TUM.replace('100.1', '\n# a pause\n100.1') + '\n', 'TUM trajectory'),
        ('tip.csv', EUROC, 'EuRoC CSV'),
        ('tip.csv', EUROC.replace(' [ns]', '').replace(' []', '').replace(' [m]', ''), 'EuRoC CSV'),
        (
            'tip.csv',
            EUROC.replace('_RS_R_x', '_x').replace('_RS_R_y', '_y').replace('_RS_R_z', '_z'),
            'EuRoC CSV',
        ),
    ],
)
@pytest.mark.parametrize('newline', ['\n', '\r\n'])
def test_one_body_named_after_the_file(export, name, content, kind, newline):
    capture = read_motion_capture(export(name, content, newline=newline))
    assert capture.kind == kind
    [(body_name, body)] = capture.bodies.items()
    assert body_name == 'tip'
    np.testing.assert_allclose(body.times, [100.0, 100.1])
    np.testing.assert_allclose(body.positions, [[1, 2, 3], [1.5, 2, 3]])
    np.testing.assert_allclose(body.orientations, [[0.1, 0.2, 0.3, 0.9]] * 2)  # x y z w, of both


def test_refused(export):
    with pytest.raises(MocapError, match='without the columns qw'):
        read_motion_capture(export('tip.csv', EUROC.replace('q_RS_w', 'q_RS_v')))
    with pytest.raises(MocapError, match="line 3: tz is 'x'"):
        read_motion_capture(export('tip.txt', TUM.replace('3e0', 'x')))
