import pytest

from sesa2.mocap.capture import MocapError
from sesa2.mocap.formats import READERS, read_motion_capture

TRC = 'PathFileType\t4\nDataRate\tUnits\n100\tmm\nFrame#\tTime\tM1\t\t\n\t\tX1\tY1\tZ1\n1\t0\t1\t2\t3\n'


def test_what_is_in_a_file_decides_not_its_name(export):
    assert read_motion_capture(export('take.csv', TRC)).kind == 'TRC'


def test_utf_16(export):
    assert list(read_motion_capture(export('take.trc', TRC, encoding='utf-16')).bodies) == ['M1']


@pytest.mark.parametrize(
    'content', ['', 'hello', '1,2,0.1\n2,2,0.2\n', '\0\1\2\3' * 99, '# a page\n', 'a;b;c\n1;2;3\n']
)
def test_what_is_not_known_says_what_a_csv_must_have(export, content):
    with pytest.raises(
        MocapError, match=r'no known export \(C3D, Motive CSV.*A CSV must have the columns time_s'
    ) as said:
        read_motion_capture(export('notes.txt', content))
    assert 'notes.txt' in str(said.value)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(MocapError, match=r'absent\.csv: cannot be read: No such file'):
        read_motion_capture(tmp_path / 'absent.csv')


def test_kinds_are_named_once():
    assert len({reader.KIND for reader in READERS}) == len(READERS)
