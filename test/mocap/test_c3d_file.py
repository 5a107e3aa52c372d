"""C3D files made by a library other than the one that reads them."""

import sys

import numpy as np
import pytest

from sesa2.mocap.capture import MocapError
from sesa2.mocap.formats import read_motion_capture


@pytest.fixture
def made(tmp_path):
    pytest.importorskip('ezc3d', reason='the extra mocap is not installed')
    c3d = pytest.importorskip('c3d', reason='c3d, which makes the files, is not installed')

    def make(unit='mm', rate=200.0, lost=False):
        writer = c3d.Writer(point_rate=rate, point_units=f'{unit:4s}')
        for k in range(10):
            points = np.zeros((2, 5), np.float32)
            points[0, :3], points[1, :3] = [1 + k, 2, 300.5], [4, 5, 600 + k]
            points[1, 3] = -1 if lost and k == 3 else 0
            writer.add_frames([(points, np.zeros((0, 0)))])
        writer.set_point_labels(['Arm:M1', 'Arm:M2'])
        path = tmp_path / 'arm.c3d'
        with path.open('wb') as file:
            writer.write(file)
        return path

    return make


@pytest.mark.filterwarnings('ignore::UserWarning')
@pytest.mark.parametrize(('unit', 'metre'), [('mm', 1e-3), ('m', 1.0)])
def test_markers(made, unit, metre):
    capture = read_motion_capture(made(unit))
    assert capture.kind == 'C3D'
    assert list(capture.bodies) == ['Arm:M1', 'Arm:M2']
    one, two = capture.bodies.values()
    np.testing.assert_allclose(one.times, 0.005 * np.arange(10))
    np.testing.assert_allclose(one.positions[:, 0], metre * (1.0 + np.arange(10)), rtol=1e-6)
    np.testing.assert_allclose(two.positions[0], metre * np.array([4, 5, 600]), rtol=1e-6)


@pytest.mark.filterwarnings('ignore::UserWarning')
def test_a_marker_that_is_not_seen(made):
    seen = ~np.isnan(read_motion_capture(made(lost=True)).bodies['Arm:M2'].positions[:, 0])
    np.testing.assert_array_equal(np.flatnonzero(~seen), [3])


@pytest.mark.filterwarnings('ignore::UserWarning')
def test_what_is_no_whole_file(made):
    path = made()
    path.write_bytes(path.read_bytes()[:600])
    with pytest.raises(MocapError, match='no whole C3D file'):
        read_motion_capture(path)


def test_without_the_library_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'ezc3d', None)
    path = tmp_path / 'arm.c3d'
    path.write_bytes(b'\x02\x50' + b'\0' * 600)
    with pytest.raises(MocapError, match=r"pip install 'sesa2\[mocap\]', or export a CSV"):
        read_motion_capture(path)
