"""A backbone's length at any instant, against numpy.interp and one sample at a time; steps of time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sesa2.estimation.length_track import NOT_NEWER, LengthTrack, interpolated, n_jumps

MS = 1_000_000
T0 = 1_700_000_000_000 * MS
TIMEOUT = 200 * MS


def track_of(stamps_ms, lengths=None, sweeps_ms=None, **options):
    """One that was given samples one by one."""
    track = LengthTrack(**options)
    for k, stamp in enumerate(stamps_ms):
        length = 0.1 if lengths is None else lengths[k]
        sweeps = None if sweeps_ms is None else T0 + round(sweeps_ms * MS)
        track.add(np.array([T0 + round(stamp * MS)]), np.array([length]), sweeps)
    return track


def at(track, *ms, timeout=TIMEOUT):
    return track.at(np.array([T0 + round(t * MS) for t in ms]), timeout)


@given(st.lists(st.integers(1, 200), min_size=1, max_size=40), st.integers(0, 2**32 - 1))
def test_between_samples_it_is_what_numpy_interpolates(steps_ms, seed):
    """No gap is longer than the timeout here."""
    rng = np.random.default_rng(seed)
    stamps = np.cumsum(steps_ms) * MS
    lengths = rng.uniform(0.05, 0.3, len(stamps))
    asked = rng.integers(stamps[0], stamps[-1] + 1, 50)
    expected = np.interp(asked, stamps, lengths)
    np.testing.assert_allclose(interpolated(asked, stamps, lengths, TIMEOUT), expected, atol=1e-12)


def by_hand(asked, stamps, lengths, timeout):
    """The rule sample by sample, as a sentence says it."""
    if asked in stamps:
        return lengths[stamps.index(asked)]
    older = [k for k, stamp in enumerate(stamps) if stamp < asked]
    if not older or asked - stamps[older[-1]] > timeout:
        return np.nan
    k = older[-1]
    if k + 1 == len(stamps) or stamps[k + 1] - stamps[k] > timeout:
        return lengths[k]
    share = (asked - stamps[k]) / (stamps[k + 1] - stamps[k])
    return (1 - share) * lengths[k] + share * lengths[k + 1]


@given(
    st.lists(st.integers(1, 500), min_size=0, max_size=12),
    st.lists(st.integers(-100, 3000), min_size=1, max_size=12),
    st.integers(1, 400),
)
def test_gaps_ends_and_what_holds(steps_ms, asked_ms, timeout_ms):
    stamps = [int(t) for t in np.cumsum(steps_ms)]
    lengths = [0.1 + 0.01 * (k % 5) for k in range(len(stamps))]
    expected = [by_hand(t, stamps, lengths, timeout_ms) for t in asked_ms]
    got = interpolated(np.array(asked_ms), np.array(stamps, dtype=np.int64), np.array(lengths), timeout_ms)
    np.testing.assert_allclose(got, expected, atol=1e-15)


def test_nanoseconds_of_today_are_not_rounded():
    """As doubles such stamps are 256 ns apart."""
    stamps = np.array([T0, T0 + 1000])
    np.testing.assert_allclose(
        interpolated(T0 + np.array([250, 500]), stamps, np.array([0.0, 1.0]), TIMEOUT), [0.25, 0.5]
    )


def test_what_comes_in_blocks_is_the_same_and_the_past_is_forgotten():
    rng = np.random.default_rng(3)
    stamps = T0 + np.cumsum(rng.integers(1, 30 * MS, 20_000))
    lengths = rng.uniform(0.1, 0.2, len(stamps))
    one, many = LengthTrack(0.06), LengthTrack(0.06)
    for k in range(len(stamps)):
        one.add(stamps[k : k + 1], lengths[k : k + 1], None)
    for k in range(0, len(stamps), 700):
        many.add(stamps[k : k + 700], lengths[k : k + 700], None)
    asked = rng.integers(stamps[-1] - 15_000 * MS, stamps[-1], 500)
    for track in (one, many):
        expected = np.interp(asked - T0, stamps - T0, lengths)  # doubles are too coarse for the time of day
        np.testing.assert_allclose(track.at(asked, TIMEOUT), expected, atol=1e-12)
        assert len(track._stamps) < 10_000
    assert one.jumps == many.jumps == n_jumps(stamps, lengths, 0.06) > 0
    assert one.n_taken == many.n_taken == 20_000


def test_a_sample_that_is_not_newer_is_counted():
    track = track_of([0, 10, 10, 5, 20], [0.1, 0.2, 9.0, 9.0, 0.3])
    assert track.dropped == {NOT_NEWER: 2}
    np.testing.assert_allclose(at(track, 0, 5, 10, 15, 20), [0.1, 0.15, 0.2, 0.25, 0.3])


@pytest.mark.parametrize('glitch_ms', [1e6, -1e6, -3000.0])
def test_a_glitch_of_the_clock_costs_one_sample(glitch_ms):
    track = track_of([0, 10, 10 + glitch_ms, 20, 30], [0.1, 0.2, 9.0, 0.3, 0.4], sweeps_ms=8)
    assert sum(track.dropped.values()) == 1
    assert 'stamped long' in next(iter(track.dropped))
    np.testing.assert_allclose(at(track, 15, 25), [0.25, 0.35])


def test_a_glitch_that_no_rule_knows_for_one_is_disproved_by_what_follows():
    """5 s ahead may be a pause; then the samples that follow are nearer to the sweeps."""
    track = track_of([0, 10, 5010, 20, 30], [0.1, 0.2, 9.0, 0.3, 0.4], sweeps_ms=15)
    np.testing.assert_allclose(at(track, 15, 25), [0.25, 0.35])
    assert track.newest_ns == T0 + 30 * MS


def test_a_first_stamp_of_another_time_does_no_harm():
    for sweeps in (None, 8):
        track = track_of([1e6, 10, 20], [9.0, 0.2, 0.3], sweeps_ms=sweeps)
        np.testing.assert_allclose(at(track, 15), [0.25])


def test_after_a_long_pause_it_goes_on_at_once():
    track = track_of([0, 10], sweeps_ms=8)
    track.add(np.array([T0 + 60_000 * MS]), np.array([0.3]), T0 + 60_005 * MS)
    assert not track.dropped
    np.testing.assert_allclose(at(track, 60_005), [0.3])


@pytest.mark.parametrize('lengths_first', [True, False])
def test_when_time_steps_back_nothing_is_lost_whoever_steps_first(lengths_first):
    stamps = np.arange(0, 5000, 10.0)
    track = track_of(stamps, sweeps_ms=4990)
    if lengths_first:
        for k in range(3):
            track.add(np.array([T0 + 10 * k * MS]), np.array([0.2 + 0.01 * k]), T0 + 4990 * MS)
        track.step(T0 + 2 * MS)
    else:
        track.step(T0 + 2 * MS)
        for k in range(3):
            track.add(np.array([T0 + 10 * k * MS]), np.array([0.2 + 0.01 * k]), T0 + 2 * MS)
    assert not track.dropped
    np.testing.assert_allclose(at(track, 0, 5, 20), [0.2, 0.205, 0.22])
    assert np.isnan(at(track, 4990)).all(), 'nothing of the time before is left'


def test_jumps_are_those_beyond_the_rate_and_the_grain():
    stamps = T0 + np.arange(5) * 10 * MS
    lengths = np.array([0.1, 0.1006, 0.1105, 0.1105, 0.0])
    assert n_jumps(stamps, lengths, 0.06) == 2
    assert n_jumps(stamps, lengths, 1.0) == 1
    assert n_jumps(stamps[:1], lengths[:1], 0.06) == 0


def test_a_block_that_is_empty_is_none():
    track = LengthTrack()
    track.add(np.zeros(0, dtype=np.int64), np.zeros(0), None)
    assert track.newest_ns is None
    assert np.isnan(at(track, 5)).all()
