import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sesa2.mocap import number_table
from sesa2.mocap.capture import MocapError
from sesa2.mocap.number_table import read_numbers


def numbers(text, columns, delimiter=',', **more):
    names = [f'column {c}' for c in columns]
    return read_numbers(
        text.encode(), 0, columns, delimiter=delimiter, names=names, where='f.csv', first_line=2, **more
    )


@pytest.fixture
def fast_only(monkeypatch):
    monkeypatch.setattr(number_table, '_any_numbers', None)


@pytest.fixture
def careful_only(monkeypatch):
    monkeypatch.setattr(number_table, '_plain_decimals', lambda *_: None)


CASES = {
    'plain': ('1,0.5,-0.25\n2,10.125,3\n', ',', [[1, 0.5, -0.25], [2, 10.125, 3]]),
    'no end of line': ('1,2,3', ',', [[1, 2, 3]]),
    'gaps': ('1,,\n2,,0.5\n,1,2\n', ',', [[1, np.nan, np.nan], [2, np.nan, 0.5], [np.nan, 1, 2]]),
    'gaps side by side': ('1,,,,2\n,,,,\n,,,,1\n', ',', None),
    'nan': ('1,nan,NaN\n2,3,NAN\n', ',', [[1, np.nan, np.nan], [2, 3, np.nan]]),
    'decimal comma': ('1;0,5;-2,25\n2;,5;3\n', ';', [[1, 0.5, -2.25], [2, 0.5, 3]]),
    'tabs': ('1\t0.5\t\n2\t\t3.000\n', '\t', [[1, 0.5, np.nan], [2, np.nan, 3]]),
    'zeros in front': ('007,-0.001,00.10\n', ',', [[7, -0.001, 0.1]]),
    'signs': ('+1,-.5,+0.5\n', ',', [[1, -0.5, 0.5]]),
    'nanoseconds': ('1700000000040000000,1,2\n', ',', [[1700000000040000000, 1, 2]]),
}


@pytest.mark.parametrize('name', CASES)
def test_plain_decimals_are_read_fast(fast_only, name):
    text, delimiter, expected = CASES[name]
    if expected is None:
        expected = [[1, *[np.nan] * 3, 2], [*[np.nan] * 5], [*[np.nan] * 4, 1]]
    table = numbers(text, range(len(expected[0])), delimiter)
    np.testing.assert_array_equal(table.rows, expected)
    np.testing.assert_array_equal(table.lines, 2 + np.arange(len(expected)))


@pytest.mark.parametrize('name', [name for name in CASES if name != 'gaps side by side'])
def test_and_line_by_line_alike(careful_only, name):
    text, delimiter, expected = CASES[name]
    np.testing.assert_array_equal(numbers(text, range(3), delimiter).rows, expected)


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('1e-3,2,3\n', [[1e-3, 2, 3]]),
        ('"1.5","2","3"\n', [[1.5, 2, 3]]),
        ('1,2,3\n\n\n4,5,6\n', [[1, 2, 3], [4, 5, 6]]),
        ('1, 2 ,3\n', [[1, 2, 3]]),
        ('0.12345678901234567890123,2,3\n', [[0.12345678901234568, 2, 3]]),
        ('NA,null,-\n1,2,3\n', [[np.nan] * 3, [1, 2, 3]]),
        ('.,.,.\n1,2,3\n', [[np.nan] * 3, [1, 2, 3]]),
        ('.,.,.\n', [[np.nan] * 3]),
        ('5.,6.,.\n', [[5, 6, np.nan]]),
        (' ,  ,3\n', [[np.nan, np.nan, 3]]),
        ('1,2,3,more\n4,5,6,words\n', [[1, 2, 3], [4, 5, 6]]),
    ],
)
def test_what_is_not_plain(text, expected):
    np.testing.assert_array_equal(numbers(text, range(3)).rows, expected)


@given(
    st.lists(
        st.tuples(*[st.decimals(-10_000, 10_000, places=6, allow_nan=False)] * 3), min_size=1, max_size=20
    ),
    st.integers(0, 6),
)
def test_numbers_are_those_that_python_reads(rows, places):
    text = '\n'.join(','.join(f'{value:.{places}f}' for value in row) for row in rows)
    expected = [[float(f'{value:.{places}f}') for value in row] for row in rows]
    np.testing.assert_array_equal(numbers(text, range(3)).rows, expected)


@pytest.mark.parametrize('delimiter', [' ', ',', '\t'])
def test_any_number_of_blanks(delimiter):
    gap = {' ': '   ', ',': ' , ', '\t': ' \t '}[delimiter]
    np.testing.assert_array_equal(numbers(f'1{gap}2{gap}3\n', range(3), delimiter).rows, [[1, 2, 3]])


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('1,2,3\n1,x2,3\n', "line 3: column 1 is 'x2', expected a number"),
        ('1,2,3\n1,inf,3\n', "line 3: column 1 is 'inf'"),
        ('1,2,1.2.3\n', "line 2: column 2 is '1.2.3'"),
        ('1,2\n1,2,3\n', 'line 2: fewer cells than the 3 expected'),
        ('', 'no samples below its header'),
        ('\n\n', 'no samples below its header'),
    ],
)
def test_errors_say_where(text, message):
    with pytest.raises(MocapError, match=message):
        numbers(text, range(3))


def test_a_last_line_cut_short_is_left_out_and_said():
    table = numbers('1,2,3\n4,5', range(3))
    np.testing.assert_array_equal(table.rows, [[1, 2, 3]])
    assert table.notes == ('f.csv was cut short: its last line, 3, is incomplete and left out',)


def test_cells_may_be_missing_where_a_format_leaves_them_out():
    table = numbers('1,2\n1,2,3\n', range(3), short_rows=True)
    np.testing.assert_array_equal(table.rows, [[1, 2, np.nan], [1, 2, 3]])


@pytest.mark.parametrize('block', [1, 7, 50])
def test_a_file_is_read_in_blocks_of_whole_lines(monkeypatch, block):
    """Plain ones and others, with the numbers of their lines."""
    monkeypatch.setattr(number_table, '_BLOCK', block)
    text = '0.5,1\n1.5,2e0\n\n2.5,\n3.5,04\n4.25,5\n5.5,'
    table = numbers(text, range(2))
    np.testing.assert_array_equal(
        table.rows, [[0.5, 1], [1.5, 2], [2.5, np.nan], [3.5, 4], [4.25, 5], [5.5, np.nan]]
    )
    np.testing.assert_array_equal(table.lines, [2, 3, 5, 6, 7, 8])
    with pytest.raises(MocapError, match="line 9: column 1 is 'x'"):
        numbers(text + '\n6.5,x\n', range(2))
    with pytest.raises(MocapError, match='line 4: fewer cells'):
        numbers('0.5,1\n1.5,2\n2.5\n3.5,4\n', range(2))


def test_the_last_cell_is_a_number_to_its_end(fast_only):
    """What does not end in a digit is not read fast."""
    with pytest.raises(TypeError):
        numbers('1,2\n3,6e-1\n', range(2))


@given(st.text('0123456789.,-+ e\n', min_size=1, max_size=40))
def test_the_fast_way_reads_what_the_careful_way_reads_or_nothing(text):
    columns = [0]
    fast = number_table._plain_decimals(text.encode(), columns, ',')
    if fast is not None:
        notes: list = []
        careful, _ = number_table._any_numbers(text.encode(), columns, ',', ['a'], 'f', 1, False, True, notes)
        fast = fast[~np.isnan(fast[:, 0])]
        careful = careful[~np.isnan(careful[:, 0])]
        np.testing.assert_allclose(fast, careful, rtol=1e-15)


SMALL = st.builds(lambda v, n: v * 10.0**-n, st.floats(-9.9, 9.9), st.integers(0, 3))


@given(st.lists(st.tuples(SMALL, SMALL, SMALL), min_size=1, max_size=5))
def test_numbers_with_all_their_digits(rows):
    """As Python writes them: a small one has 20 decimals, which once made it ten times too large."""
    rows = [
        [v if abs(v) >= 1e-4 else 0.0 for v in row] for row in [*rows, (-0.00029742530374723454, 1.0, 0.5)]
    ]
    text = ''.join(','.join(map(repr, row)) + '\n' for row in rows)
    np.testing.assert_allclose(numbers(text, range(3)).rows, rows, rtol=1e-15)


def test_a_decimal_comma_in_quotes():
    table = numbers('"0,5","-1,25",3\n"1,5",2,"3"\n', range(3))
    np.testing.assert_array_equal(table.rows, [[0.5, -1.25, 3], [1.5, 2, 3]])
    with pytest.raises(MocapError, match=r"line 2: column 1 is '1.360.5', expected a number"):
        numbers('0.5,"1,360.5"\n', range(2))


@pytest.mark.parametrize('more', ['', ',', ',,,'])
def test_decimal_commas_between_commas_are_refused(more):
    assert len(numbers(f'1,2,3{more}\n4,5,6\n', range(3), width=3).rows) == 2
    with pytest.raises(MocapError, match=r'line 2: [67] cells below 3 names|line 2: 9 cells below 3 names'):
        numbers(f'0,04,0,360,1,5{more}\n', range(3), width=3)
