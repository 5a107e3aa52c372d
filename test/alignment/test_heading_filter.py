"""The heading filter: follows drift, looks at the past alone, and leaves alone what it cannot tell."""

import numpy as np
import pytest
from moving_arm import RATE, measure, moving_arm, rms_degrees

from sesa2.alignment.heading_filter import DRIFT_STD, HeadingFilter
from sesa2.shape.rotations import IDENTITY, from_rotation_vector, multiply


@pytest.fixture
def rng():
    return np.random.default_rng(12)


def drifting(rng, **options):
    motion = moving_arm(rng, seconds=120.0, **options)
    q, errors = measure(rng, motion.links, mounting=0.0, heading=0.0, drift=3.0, tilt=0.3)
    return motion, q, np.ones(q.shape[:2], bool), errors


@pytest.mark.parametrize(
    'base', [IDENTITY, np.array([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)])], ids=['up', 'flat']
)
def test_drift_is_followed(rng, base):
    motion, q, measured, errors = drifting(rng, base=base)
    heading_filter = HeadingFilter(motion.layout)
    got = heading_filter.correct(motion.stamps, q, measured, motion.base)
    assert rms_degrees(got, motion.links) < 0.75 * rms_degrees(q, motion.links)
    left = heading_filter.headings - errors.heading[-1]
    assert (np.abs(left) < 4.0 * np.sqrt(np.diag(heading_filter.covariance))).all()


def test_an_arm_that_twists_is_corrected_less(rng):
    motion, q, measured, _ = drifting(rng, twist=0.3)
    got = HeadingFilter(motion.layout).correct(motion.stamps, q, measured, motion.base)
    assert rms_degrees(got, motion.links) < 1.1 * rms_degrees(q, motion.links)


def test_the_future_does_not_matter(rng):
    """Sweep by sweep, in batches and cut short: all the same."""
    motion, q, measured, _ = drifting(rng)
    whole = HeadingFilter(motion.layout).correct(motion.stamps, q, measured, motion.base)
    in_parts = HeadingFilter(motion.layout)
    parts = [
        in_parts.correct(motion.stamps[a : a + 77], q[a : a + 77], measured[a : a + 77], motion.base)
        for a in range(0, 770, 77)
    ]
    np.testing.assert_array_equal(np.concatenate(parts), whole[:770])
    one = HeadingFilter(motion.layout)
    for i in range(200):
        headings = one.update(motion.stamps[i], q[i], measured[i], motion.base)
        unturn = from_rotation_vector(np.outer(-headings, [0.0, 0.0, 1.0]))
        np.testing.assert_allclose(multiply(unturn, q[i]), whole[i], atol=1e-15)


def test_a_looped_recording_begins_anew(rng):
    motion, q, measured, _ = drifting(rng)
    heading_filter = HeadingFilter(motion.layout)
    first = heading_filter.correct(motion.stamps, q, measured, motion.base)
    again = heading_filter.correct(motion.stamps, q, measured, motion.base)
    np.testing.assert_array_equal(again, first)


def test_an_imu_that_is_silent_keeps_what_it_had_and_forgets_it(rng):
    motion, q, measured, _ = drifting(rng)
    heading_filter = HeadingFilter(motion.layout)
    heading_filter.correct(motion.stamps[:1200], q[:1200], measured[:1200], motion.base)
    had = heading_filter.headings[5]
    measured[1200:, 5] = False
    q[1200:, 5] = np.nan
    heading_filter.correct(motion.stamps[1200:], q[1200:], measured[1200:], motion.base)
    assert np.isfinite(heading_filter.headings).all()
    assert abs(heading_filter.headings[5]) < abs(had) + 0.5 * DRIFT_STD
    assert heading_filter.covariance[5, 5] > heading_filter.covariance[4, 4]


def test_no_imu_at_all_leaves_everything_open(rng):
    motion, q, measured, _ = drifting(rng)
    heading_filter = HeadingFilter(motion.layout)
    got = heading_filter.correct(motion.stamps, q, measured & False, motion.base)
    np.testing.assert_array_equal(got, q)
    np.testing.assert_allclose(heading_filter.covariance, DRIFT_STD**2 * np.eye(8), atol=1e-15)


def test_a_damaged_sample_does_not_throw_it_off(rng):
    motion, q, measured, _ = drifting(rng)
    clean = HeadingFilter(motion.layout)
    clean.correct(motion.stamps[:1201], q[:1201], measured[:1201], motion.base)
    q[1200, 2] = [1.0, 0.0, 0.0, 0.0]
    hit = HeadingFilter(motion.layout)
    hit.correct(motion.stamps[:1201], q[:1201], measured[:1201], motion.base)
    assert np.rad2deg(np.abs(hit.headings - clean.headings).max()) < 0.5


def test_one_sweep_a_second_is_looked_at(rng):
    """Twenty sweeps a second tell no more than the first of each second: neighbours in time share their errors."""
    motion, q, measured, _ = drifting(rng)
    all_of_them, one_a_second = HeadingFilter(motion.layout), HeadingFilter(motion.layout)
    all_of_them.correct(motion.stamps, q, measured, motion.base)
    first = slice(None, None, round(RATE))
    one_a_second.correct(motion.stamps[first], q[first], measured[first], motion.base)
    np.testing.assert_array_equal(all_of_them.headings, one_a_second.headings)
    np.testing.assert_array_equal(all_of_them.covariance, one_a_second.covariance)
    seen = HeadingFilter(motion.layout)
    for k in range(3):
        headings = seen.update(motion.stamps[k], q[k], measured[k], motion.base)
    np.testing.assert_array_equal(
        headings, HeadingFilter(motion.layout).update(0.0, q[0], measured[0], motion.base)
    )


@pytest.mark.parametrize('silence', [5.0, 60.0, 600.0])
def test_what_was_known_is_forgotten_within_a_minute(rng, silence):
    """An Ornstein–Uhlenbeck process of a time of 60 s, from the last look on, in closed form."""
    motion, q, measured, _ = drifting(rng)
    heading_filter = HeadingFilter(motion.layout)
    heading_filter.correct(motion.stamps, q, measured, motion.base)
    had, known = heading_filter.headings.copy(), heading_filter.covariance.copy()
    assert np.abs(had).max() > np.deg2rad(0.5)
    last = np.floor(motion.stamps[-1])  # the last sweep that was looked at
    headings = heading_filter.update(last + silence, q[-1], measured[-1] & False, motion.base)
    kept = np.exp(-silence / 60.0)
    np.testing.assert_allclose(headings, kept * had, rtol=1e-9)
    fresh = (1.0 - kept**2) * np.deg2rad(2.0) ** 2 * np.eye(8)
    np.testing.assert_allclose(heading_filter.covariance, kept**2 * known + fresh, rtol=1e-9)
