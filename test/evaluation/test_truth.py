import numpy as np
import pytest

from sesa2.evaluation.trajectory import EvaluationError
from sesa2.evaluation.truth import read_csv

HEADER = 'time_s,M1_x,M1_y,M1_z,M2_x,M2_y,M2_z\n'
NAMES = ('M1', 'M2')


@pytest.fixture
def csv(tmp_path):
    def write(text, encoding='utf-8'):
        path = tmp_path / 'truth.csv'
        path.write_bytes(text.encode(encoding))
        return path

    return write


def test_reads_metres_and_seconds(csv):
    truth, left_out = read_csv(csv(HEADER + '100.0,1,2,3,4,5,6\n100.01,1.5,2,3,4,5,-6e-1\n'), NAMES)
    np.testing.assert_array_equal(truth.times, [100.0, 100.01])
    np.testing.assert_array_equal(truth.positions, [[[1, 2, 3], [4, 5, 6]], [[1.5, 2, 3], [4, 5, -0.6]]])
    assert truth.names == NAMES
    assert left_out == ()


def test_columns_by_name_whatever_their_order(csv):
    text = 'frame, M2_z ,M2_x,M2_y,time_s,M1_x,M1_y,M1_z\n1,3,1,2,0.5,4,5,6\r\n\r\n'
    truth, _ = read_csv(csv('﻿' + text), ('M2',))
    np.testing.assert_array_equal(truth.times, [0.5])
    np.testing.assert_array_equal(truth.positions, [[[1, 2, 3]]])


def test_gaps_stay_gaps(csv):
    truth, left_out = read_csv(
        csv(HEADER + '0,1,2,3,4,5,6\n1,nan,nan,NaN,4,5,6\n2,1,2,3,,,\n3,1,,3,4,5,6\n'), NAMES
    )
    np.testing.assert_array_equal(truth.seen, [[True, True], [False, True], [True, False], [False, True]])
    assert left_out == ('truth.csv: 1 marker positions with a missing component count as not seen',)


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        ('time_s,M1_x,M1_y,M1_z\n0,1,2,3\n1,4,5,6\n', 'M2 has no columns and is not evaluated'),
        (HEADER + '0,1,2,3,,,\n1,4,5,6,,,\n', 'M2 was never seen in 2 samples and is not evaluated'),
    ],
)
def test_the_markers_that_are_there_are_read(csv, text, why):
    truth, left_out = read_csv(csv(text), NAMES)
    assert truth.names == ('M1',)
    np.testing.assert_array_equal(truth.positions, [[[1, 2, 3]], [[4, 5, 6]]])
    assert left_out == (f'truth.csv: {why}',)


def test_lines_back_in_time_are_left_out_and_counted(csv):
    truth, left_out = read_csv(csv(HEADER + ''.join(f'{t},1,2,3,4,5,6\n' for t in (0, 1, 1, 0.5, 2))), NAMES)
    np.testing.assert_array_equal(truth.times, [0, 1, 2])
    assert left_out == ('truth.csv: 2 lines whose time_s is not after the line before were left out',)


def test_a_file_cut_short_is_used_as_far_as_it_goes(csv):
    truth, left_out = read_csv(csv(HEADER + '0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n2,1,2'), NAMES)
    np.testing.assert_array_equal(truth.times, [0, 1])
    assert left_out == ('truth.csv was cut short: its last line, 4, is incomplete and left out',)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('time_s,M1_x,M1_y,M1_z,m2_x,M2_y,M2_z\n', "no column M2_x; the nearest is '(m2_x|M2_y|M1_x)'"),
        ('time,M1_x,M1_y,M1_z\n0,1,2,3\n', "no column time_s; the nearest is 'time'"),
        ('time_s;M1_x;M1_y\n', 'must be separated by commas'),
        ('', 'no column time_s; the first line is empty'),
        (HEADER, 'has no samples below its header'),
        (HEADER.replace('M1_y', 'M1_x'), '2 columns are called M1_x'),
        (HEADER + '0,1,2,3,4,5,6\n0.1,1,2,x3,4,5,6\n', "truth.csv, line 3: M1_z is 'x3', expected a number"),
        (HEADER + '0,1,2,inf,4,5,6\n', "line 2: M1_z is 'inf'"),
        (HEADER + ',1,2,3,4,5,6\n', 'line 2: time_s is empty'),
        (HEADER + '0,1,2\n1,1,2,3,4,5,6\n', 'line 2: fewer fields than the 7 columns'),
        (HEADER + '0,,,,,,\n1,,,,,,\n', 'none of M1, M2 was seen in 2 samples'),
        ('time_s,m1_x,m1_y,m1_z\n0,1,2,3\n', "no column M1_x; the nearest is 'm1_x'"),
    ],
)
def test_refuses_and_says_where(csv, text, message):
    with pytest.raises(EvaluationError, match=message):
        read_csv(csv(text), NAMES)


def test_refuses_what_is_no_text_file(csv, tmp_path):
    with pytest.raises(EvaluationError, match=r'absent\.csv: No such file'):
        read_csv(tmp_path / 'absent.csv', NAMES)
    with pytest.raises(EvaluationError, match='not a CSV text file'):
        read_csv(csv(HEADER, 'utf-16'), NAMES)
