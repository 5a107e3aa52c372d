import numpy as np
import pytest

from sesa2.mocap.capture import MocapError
from sesa2.mocap.formats import read_motion_capture

FILE = """\
PathFileType\t4\t(X/Y/Z)\tC:\\trials\\arm.trc
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames
200.00\t200.00\t2\t2\tmm\t200.00\t1\t2
Frame#\tTime\tM1\t\t\tM2\t\t
\t\tX1\tY1\tZ1\tX2\tY2\tZ2

1\t0.100\t1\t2\t300.5\t\t\t
2\t0.105\t1.5\t2\t301\t4\t5\t600
"""


@pytest.mark.parametrize(
    'content',
    [
        FILE,
        FILE.replace('\n\n', '\n'),
        FILE.replace('300.5\t\t\t', '300.5'),
        FILE.replace('\n1\t', '\t\n1\t').replace('600\n', '600\t\n'),
        FILE.replace('\tM1\t\t\tM2\t\t\n', '\tM1_x\tM1_y\tM1_z\tM2_x\tM2_y\tM2_z\n'),
        FILE.replace('300.5\t\t\t', '300.5\tnan\tnan\tnan'),
    ],
)
@pytest.mark.parametrize('newline', ['\n', '\r\n'])
def test_markers(export, content, newline):
    capture = read_motion_capture(export('arm.trc', content, newline=newline))
    assert list(capture.bodies) == ['M1', 'M2']
    one, two = capture.bodies.values()
    np.testing.assert_allclose(one.times, [0.1, 0.105])
    np.testing.assert_allclose(one.positions, [[1e-3, 2e-3, 0.3005], [1.5e-3, 2e-3, 0.301]])
    np.testing.assert_allclose(two.positions, [[np.nan] * 3, [4e-3, 5e-3, 0.6]])


def test_metres_where_the_header_says_so(export):
    capture = read_motion_capture(export('arm.trc', FILE.replace('\tmm\t', '\tm\t')))
    np.testing.assert_allclose(capture.bodies['M1'].positions[0], [1, 2, 300.5])


def test_refused(export):
    with pytest.raises(MocapError, match='without Units in line 3'):
        read_motion_capture(export('arm.trc', FILE.replace('Units', 'Unit')))
    with pytest.raises(MocapError, match="line 8: M1 Z is '3o1'"):
        read_motion_capture(export('arm.trc', FILE.replace('301', '3o1')))


def test_the_rate_where_there_are_no_times(export):
    content = FILE.replace('\t0.100\t', '\t\t').replace('\t0.105\t', '\t\t').replace('\n2\t', '\n5\t')
    np.testing.assert_allclose(read_motion_capture(export('a.trc', content)).bodies['M1'].times, [0.0, 0.02])
    with pytest.raises(MocapError, match="without times, and with a DataRate of 'x', expected Hz"):
        read_motion_capture(export('a.trc', content.replace('\n200.00\t', '\nx\t')))
