import pytest

from sesa2.mocap.body_names import find_bodies
from sesa2.mocap.capture import MocapError


@pytest.mark.parametrize(
    ('there', 'found'),
    [
        (['M1', 'M2'], {'M1': 'M1', 'M2': 'M2'}),
        (['Arm:M1', 'Arm:M2', 'Arm:M3'], {'M1': 'Arm:M1', 'M2': 'Arm:M2'}),
        (['M1', 'Arm:M1'], {'M1': 'M1'}),
        (['rig/M1', 'rig: M2'], {'M1': 'rig/M1', 'M2': 'rig: M2'}),
        (['Arm:m1', 'm2'], {'M1': 'Arm:m1', 'M2': 'm2'}),
    ],
)
def test_names(there, found):
    assert find_bodies(there, ['M1', 'M2'], {}, 'f') == found


def test_given_names():
    there = ['Arm:low', 'Arm:tip', 'M2']
    assert find_bodies(there, ['M1', 'M2'], {'M1': 'low', 'M2': 'Arm:tip'}, 'f') == {
        'M1': 'Arm:low',
        'M2': 'Arm:tip',
    }


def test_one_is_the_one():
    assert find_bodies(['trajectory'], ['M2'], {}, 'f') == {'M2': 'trajectory'}


@pytest.mark.parametrize(
    ('there', 'given', 'message'),
    [
        (['A:M1', 'B:M1'], {}, 'M1 may be A:M1 or B:M1; say which: --marker M1=A:M1'),
        (
            ['low', 'tip'],
            {},
            'none of M1, M2 is in it; there are low, tip. Where the names differ: --marker M1=NAME',
        ),
        (['low', 'tip'], {'M1': 'lwo'}, 'no body is called lwo; there are low, tip'),
        (['low', 'tip'], {'M3': 'low'}, 'no marker is called M3, expected one of M1, M2'),
        ([f'b{i}' for i in range(40)], {}, 'b29 and 10 more'),
    ],
)
def test_refused_with_the_names_that_there_are(there, given, message):
    with pytest.raises(MocapError, match=message):
        find_bodies(there, ['M1', 'M2'], given, 'f')
