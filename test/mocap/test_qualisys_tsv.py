import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.mocap.capture import MocapError
from sesa2.mocap.formats import read_motion_capture

HEADER = """\
NO_OF_FRAMES\t2
NO_OF_CAMERAS\t8
NO_OF_MARKERS\t2
FREQUENCY\t200
NO_OF_ANALOG\t0
ANALOG_FREQUENCY\t0
DESCRIPTION\t--
TIME_STAMP\t2025-03-04, 10:39:38.777\t406646.66
DATA_INCLUDED\t3D
EVENT\tstart\t1\t0.00000
MARKER_NAMES\tM1\tM2
"""


def check(capture, start=0.0):
    one, two = capture.bodies['M1'], capture.bodies['M2']
    np.testing.assert_allclose(one.times, [start, start + 0.005])
    np.testing.assert_allclose(one.positions, [[1e-3, 2e-3, 0.3005], [1.5e-3, 2e-3, 0.301]])
    np.testing.assert_allclose(two.positions, [[4e-3, 5e-3, 0.6], [4e-3, 5e-3, 0.601]])


def test_frames_alone(export):
    check(read_motion_capture(export('q.tsv', HEADER + '1\t2\t300.5\t4\t5\t600\n1.5\t2\t301\t4\t5\t601\n')))


def test_types_of_trajectories_and_a_tab_at_the_end(export):
    body = 'TRAJECTORY_TYPES\tMeasured\tMixed\n1\t2\t300.5\t4\t5\t600\t\n1.5\t2\t301\t4\t5\t601\t\n'
    check(read_motion_capture(export('q.tsv', HEADER + body, newline='\r\n')))


def test_headings_with_frame_and_time(export):
    body = 'Frame\tTime\tM1 X\tM1 Y\tM1 Z\tM2 X\tM2 Y\tM2 Z\n'
    body += '41\t0.20000\t1\t2\t300.5\t4\t5\t600\n42\t0.20500\t1.5\t2\t301\t4\t5\t601\n'
    check(read_motion_capture(export('q.tsv', HEADER + body)), 0.2)


def test_a_marker_that_is_not_seen(export):
    capture = read_motion_capture(
        export('q.tsv', HEADER + '1\t2\t300.5\t\t\t\n1.5\t2\t301\tNULL\tNULL\tNULL\n')
    )
    assert np.isnan(capture.bodies['M2'].positions).all()


def test_rigid_bodies(export):
    header = HEADER.replace('3D', '6D').replace('MARKER_NAMES\tM1\tM2', 'BODY_NAMES\timu_2')
    header += 'imu_2 X\tY\tZ\tRoll\tPitch\tYaw\tResidual\t' + '\t'.join(f'Rot[{i}]' for i in range(9)) + '\n'
    turn = Rotation.from_euler('ZYX', [10, 20, 30], degrees=True)
    by_columns = '\t'.join(f'{v:.12f}' for v in turn.as_matrix().T.ravel())
    lost = '\t'.join(['0.000'] * 16)
    capture = read_motion_capture(
        export('q.tsv', f'{header}10\t20\t30\t30\t20\t10\t0.5\t{by_columns}\n{lost}\n')
    )
    body = capture.bodies['imu_2']
    np.testing.assert_allclose(body.positions, [[0.01, 0.02, 0.03], [np.nan] * 3])
    np.testing.assert_allclose(body.orientations[0], turn.as_quat(), atol=1e-11)
    assert np.isnan(body.orientations[1]).all()


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        (HEADER.replace('FREQUENCY\t200\n', ''), 'without a FREQUENCY'),
        (HEADER.replace('MARKER_NAMES\tM1\tM2\n', '') + '1\t2\t3\n', '0 names of markers'),
        (HEADER + '1\t2\tx\t4\t5\t6\n', 'no samples'),
        (HEADER + '1\t2\t3\t4\t5\t6\n1\t2\tx\t4\t5\t6\n', "line 13: column 3 is 'x'"),
    ],
)
def test_refused(export, content, message):
    with pytest.raises(MocapError, match=message):
        read_motion_capture(export('q.tsv', content))
