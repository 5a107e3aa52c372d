import numpy as np
import pytest

from sesa2.mocap.capture import MocapError
from sesa2.mocap.time_units import in_seconds


@pytest.mark.parametrize('rate', [2.5, 25.0, 100.0, 1900.0])
@pytest.mark.parametrize(('per_second', 'unit'), [(1.0, None), (1e3, 'milli'), (1e6, 'micro'), (1e9, 'nano')])
@pytest.mark.parametrize('start', [-0.3, 0.0, 1.7e9])
def test_the_unit_is_seen_in_the_steps(rate, per_second, unit, start):
    if unit == 'milli' and rate > 200.0:
        pytest.skip('steps of half a millisecond may be a slow recording in seconds: left as said')
    times = start + np.arange(200) / rate
    found = in_seconds(times * per_second, 'time_s', 'f.csv')
    np.testing.assert_allclose(found.times, times, rtol=1e-12)
    assert [unit in note for note in found.notes] == ([True] if unit else [])


@pytest.mark.parametrize('step', [1, 2, 4, 5])
def test_whole_numbers_in_even_steps_are_asked_about(step):
    with pytest.raises(MocapError, match=f'steps by {step}, always: frames'):
        in_seconds(step * np.arange(300.0), 'time_s', 'f.csv')


def test_slow_recordings_are_in_seconds():
    times = 1.7e9 + 2.288 * np.arange(1500)
    assert in_seconds(times, 'time_s', 'f.csv').notes == ()
    assert in_seconds(np.arange(4.0), 'time_s', 'f.csv').notes == ()
    assert in_seconds(np.array([5.0]), 'time_s', 'f.csv').notes == ()


def test_what_is_no_time():
    with pytest.raises(MocapError, match='no time of a recording in any unit'):
        in_seconds(1e13 * np.arange(30.0), 'time_s', 'f.csv')
