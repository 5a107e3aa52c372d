import numpy as np
import pytest
from made_poses import point, pose, write_topics

from sesa2.errors import Sesa2Error
from sesa2.evaluation.truth import read_truth

HEADER = 'time_s,M1_x,M1_y,M1_z,M2_x,M2_y,M2_z\n'
NAMES = ('M1', 'M2')


@pytest.fixture
def csv(tmp_path):
    def write(text):
        path = tmp_path / 'truth.csv'
        path.write_text(text)
        return path

    return write


def test_a_file_gives_the_markers_in_our_order(csv):
    truth = read_truth(csv(HEADER + '100.0,1,2,3,4,5,6\n100.01,1.5,2,3,4,5,-6e-1\n'), ('M2', 'M1'))
    np.testing.assert_array_equal(truth.trajectory.times, [100.0, 100.01])
    np.testing.assert_array_equal(
        truth.trajectory.positions, [[[4, 5, 6], [1, 2, 3]], [[4, 5, -0.6], [1.5, 2, 3]]]
    )
    assert truth.trajectory.names == ('M2', 'M1')
    assert (truth.frame, truth.notes, truth.axes) == ('', (), '')


def test_gaps_stay_gaps(csv):
    truth = read_truth(csv(HEADER + '0,1,2,3,4,5,6\n1,nan,nan,NaN,4,5,6\n2,1,2,3,,,\n3,1,,3,4,5,6\n'), NAMES)
    seen = [[True, True], [False, True], [True, False], [False, True]]
    np.testing.assert_array_equal(truth.trajectory.seen, seen)
    assert truth.notes == ('truth.csv: 1 marker positions with a missing component count as not seen',)


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        ('time_s,M1_x,M1_y,M1_z\n0,1,2,3\n1,4,5,6\n', 'M2 is not in it and is not evaluated; there are M1'),
        (HEADER + '0,1,2,3,,,\n1,4,5,6,,,\n', 'M2 was never seen in 2 samples and is not evaluated'),
    ],
)
def test_the_markers_that_are_there_are_read(csv, text, why):
    truth = read_truth(csv(text), NAMES)
    assert truth.trajectory.names == ('M1',)
    np.testing.assert_array_equal(truth.trajectory.positions, [[[1, 2, 3]], [[4, 5, 6]]])
    assert truth.notes == (f'truth.csv: {why}',)


def test_samples_back_in_time_are_left_out_and_counted(csv):
    truth = read_truth(csv(HEADER + ''.join(f'{t},1,2,3,4,5,6\n' for t in (0, 1, 1, 0.5, 2))), NAMES)
    np.testing.assert_array_equal(truth.trajectory.times, [0, 1, 2])
    assert truth.notes == ('truth.csv: 2 samples whose time is not after the one before were left out',)


def test_names_that_differ_are_given(csv):
    path = csv('time_s,low_x,low_y,low_z,tip_x,tip_y,tip_z\n0,1,2,3,4,5,6\n')
    truth = read_truth(path, NAMES, given={'M1': 'tip', 'M2': 'low'})
    np.testing.assert_array_equal(truth.trajectory.positions, [[[4, 5, 6], [1, 2, 3]]])
    with pytest.raises(Sesa2Error, match='none of M1, M2 is in it; there are low, tip'):
        read_truth(path, NAMES)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        (HEADER + '0,,,,,,\n1,,,,,,\n', 'none of M1, M2 was seen'),
        ('time_s,M1_x,M1_y,M1_z,M1_w\n0,0,0,0,1\n', 'M1 has orientations and no positions'),
    ],
)
def test_refused(csv, text, message):
    with pytest.raises(Sesa2Error, match=message):
        read_truth(csv(text), NAMES)


def test_a_bag_of_one_topic_a_marker(tmp_path):
    """A driver publishes a body only where it sees it, and bodies one after the other."""
    messages = [('/vrpn/M1/pose', k, pose(1e7 * k, (k, 2, 3))) for k in range(5)]
    messages += [('/vrpn/M2/pose', k, pose(1e7 * k, (4, 5, k))) for k in (0, 1, 4)]
    truth = read_truth(write_topics(tmp_path / 'bag', messages), NAMES)
    np.testing.assert_allclose(truth.trajectory.times, 0.01 * np.arange(5))
    np.testing.assert_array_equal(truth.trajectory.positions[:, 0, 0], np.arange(5))
    np.testing.assert_array_equal(truth.trajectory.positions[:, 1, 2], [0, 1, np.nan, np.nan, 4])
    assert truth.frame == 'mocap'


def test_markers_stamped_apart_are_brought_together(tmp_path):
    messages = [('/M1', k, pose(1e9 + 1e7 * k, (k, 2, 3))) for k in range(5)]
    messages += [('/M2', k, point(1e9 + 1e7 * k + 5e6, (4, 5, k + 0.5))) for k in range(-1, 5)]
    truth = read_truth(write_topics(tmp_path / 'bag', messages, start=10**9), NAMES)
    since = (truth.trajectory.times - 1.0) / 0.01
    np.testing.assert_allclose(truth.trajectory.positions[:, 1, 2], since)
    np.testing.assert_allclose(truth.trajectory.positions[1:-1, 0, 0], since[1:-1], atol=1e-6)
    assert np.isnan(truth.trajectory.positions[[0, -1], 0]).all()
    assert 'not seen at the same instants' in truth.notes[0]


def arrays(tmp_path, topic, places):
    """The first of them stands still."""
    messages = []
    for k in range(5):
        now = [place if i == 0 else tuple(np.add(place, k)) for i, place in enumerate(places)]
        messages.append((topic, k, pose(1e7 * k, *now, array=True)))
    return write_topics(tmp_path / 'bag', messages)


def test_the_poses_of_an_array_are_the_markers_in_order(tmp_path):
    truth = read_truth(arrays(tmp_path, '/truth/markers', [(1, 2, 3), (4, 5, 6)]), NAMES)
    np.testing.assert_array_equal(truth.trajectory.positions[0], [[1, 2, 3], [4, 5, 6]])


def test_estimates_beside_the_truth_are_not_taken_for_it(tmp_path):
    places = {'/truth/markers': [(1, 2, 3), (4, 5, 6)], '/pcc/markers': [(7, 8, 9), (1, 1, 1)]}
    messages = [
        (topic, k, pose(1e7 * k, *two, array=True)) for topic, two in places.items() for k in range(3)
    ]
    truth = read_truth(write_topics(tmp_path / 'bag', messages), NAMES)
    np.testing.assert_array_equal(truth.trajectory.positions[0], [[1, 2, 3], [4, 5, 6]])
    assert truth.notes == ()


def test_an_array_by_another_name_is_told_unless_it_was_asked_for(tmp_path):
    path = arrays(tmp_path, '/poses', [(1, 2, 3), (4, 5, 6)])
    [note] = read_truth(path, NAMES).notes
    assert note == 'bag: the poses of /poses were taken for M1, M2, in this order'
    assert read_truth(path, NAMES, topic='poses').notes == ()


def test_one_that_stands_still_among_them_is_the_base(tmp_path):
    truth = read_truth(arrays(tmp_path, '/poses', [(0, 0, 0), (1, 2, 3), (4, 5, 6)]), NAMES)
    np.testing.assert_array_equal(truth.trajectory.positions[0], [[1, 2, 3], [4, 5, 6]])
    assert 'bag: /poses[0] stands still: taken for the base' in truth.notes[0]


def test_more_poses_than_markers_are_asked_about(tmp_path):
    path = arrays(tmp_path, '/poses', [(0, 0, 0), (1, 2, 3), (4, 5, 6), (7, 8, 9)])
    with pytest.raises(Sesa2Error, match=r'/poses has 4 poses, expected 2: M1, M2.*--marker M1=/poses\[0\]'):
        read_truth(path, NAMES)
    truth = read_truth(path, NAMES, given={'M1': '/poses[1]', 'M2': '/poses[3]'})
    np.testing.assert_array_equal(truth.trajectory.positions[0], [[1, 2, 3], [7, 8, 9]])


def test_markers_in_different_frames_are_refused(tmp_path):
    messages = [('/M1', 0, pose(0, (1, 2, 3))), ('/M2', 0, pose(0, (1, 2, 3), frame='other'))]
    with pytest.raises(Sesa2Error, match='in different frames: mocap, other'):
        read_truth(write_topics(tmp_path / 'bag', messages), NAMES)
