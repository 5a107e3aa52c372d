"""Lateness and lags, as the clock of arrival tells them."""

import numpy as np
import pytest

from sesa2.estimation.arrivals import PATIENCE_MAX_NS, PATIENCE_MIN_NS, Arrivals, lag_in_words

MS = 1_000_000
T0 = 1_700_000_000_000 * MS


def run(arrivals, seconds, *, offsets, late=lambda i, k: 0, start=0):
    for k in range(round(100 * seconds)):
        for i, offset in enumerate(offsets):
            now = start + 10 * k * MS
            arrivals.observe(i, T0 + now + offset, now + late(i, k))


def test_patience_is_long_at_first_and_the_least_once_the_link_is_known_to_be_well():
    a = Arrivals(4)
    run(a, 5, offsets=[0] * 4)
    assert a.patience_ns == 10**9
    run(a, 25, offsets=[0] * 4, start=5 * 10**9)
    assert a.patience_ns == PATIENCE_MIN_NS


def test_patience_is_twice_the_lateness_and_is_unlearnt():
    a = Arrivals(2)
    run(a, 30, offsets=[0, 0])
    run(a, 10, offsets=[0, 0], late=lambda i, k: 400 * MS if (i, k) == (1, 500) else 0, start=30 * 10**9)
    assert a.patience_ns == 800 * MS
    run(a, 1, offsets=[0, 0], late=lambda i, k: 4_000 * MS if (i, k) == (1, 50) else 0, start=41 * 10**9)
    assert a.patience_ns == PATIENCE_MAX_NS
    run(a, 30, offsets=[0, 0], start=45 * 10**9)
    assert a.patience_ns == PATIENCE_MIN_NS


def test_a_given_patience_is_kept_and_a_long_timeout_is_the_least():
    a = Arrivals(2, 5.0)
    run(a, 30, offsets=[0, 0])
    assert a.patience_ns == 5 * 10**9
    a = Arrivals(2, None, 30.0)
    run(a, 30, offsets=[0, 0])
    assert a.patience_ns == 30 * 10**9


@pytest.mark.parametrize('lag', [0.2, -0.2, 3.0, 1e9])
def test_a_lag_is_that_of_its_clock_and_lateness_is_none(lag):
    rng = np.random.default_rng(0)
    a = Arrivals(8)
    lates = rng.exponential(50 * MS, size=(8, 3000)).astype(int)
    lates[:, ::7] = 0
    run(a, 30, offsets=[0, 0, 0, -round(lag * 1e9), 0, 0, 0, 0], late=lambda i, k: int(lates[i, k]))
    assert list(a.lags) == [3]
    assert a.lags[3] == pytest.approx(lag, abs=1e-3)


def test_small_lags_are_the_drivers_and_one_imu_has_none():
    a = Arrivals(3)
    run(a, 5, offsets=[0, 90 * MS, 0])
    assert a.lags == {}
    a = Arrivals(1)
    run(a, 5, offsets=[0])
    assert a.lags == {}


def test_of_two_the_later_one_is_told():
    a = Arrivals(2)
    run(a, 5, offsets=[0, -300 * MS])
    assert a.lags == {1: pytest.approx(0.3)}
    a = Arrivals(2)
    run(a, 5, offsets=[300 * MS, 0])
    assert a.lags == {1: pytest.approx(0.3)}


def test_a_clock_that_is_wrong_altogether_teaches_no_patience():
    a = Arrivals(4)
    run(a, 30, offsets=[0, 0, 1000 * 10**9, -1000 * 10**9])
    assert a.patience_ns == PATIENCE_MIN_NS


def test_a_clock_of_arrival_that_steps_back_begins_anew():
    a = Arrivals(2)
    run(a, 30, offsets=[0, 0], start=10**15)
    for k in range(3000):
        for i in range(2):
            a.observe(i, T0 + 10 * k * MS, 10 * k * MS)
    assert a.lags == {}
    assert a.patience_ns == PATIENCE_MIN_NS


def test_words():
    assert lag_in_words(0.2) == 'its stamps are 0.20 s behind those of the others: separate clocks?'
    assert lag_in_words(-0.25).startswith('its stamps are 0.25 s ahead of those')


def test_lags_behind_others_are_told_where_they_are_doubtful():
    imus, lengths = Arrivals(3), Arrivals(3)
    run(imus, 12, offsets=[0, 5 * MS, 0])
    run(lengths, 0.05, offsets=[-300 * MS] * 3)
    assert not lengths.lags_behind(imus), 'too few to tell'
    run(lengths, 12, offsets=[-300 * MS, 50 * MS, 200 * MS])
    assert lengths.lags_behind(imus) == {0: pytest.approx(0.3), 2: pytest.approx(-0.2)}
    lengths.forget(0)
    assert lengths.lags_behind(imus) == {2: pytest.approx(-0.2)}
    assert not lengths.lags_behind(Arrivals(2))
