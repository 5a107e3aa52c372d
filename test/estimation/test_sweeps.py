"""Sweeps from samples: whole ones, lost samples, unplugged IMUs, bad samples, clocks that jump."""

import math

import numpy as np
import pytest

from sesa2.estimation.sweeps import SweepAssembler
from sesa2.shape.rotations import from_rotation_vector

MS = 1_000_000
ONE = (0.0, 0.0, 0.0, 1.0)


def turned(angle):
    return tuple(from_rotation_vector([0.0, angle, 0.0]))


def board(n_sweeps, n_imu=4, period=10 * MS, scan=4 * MS, start=1_000_000 * MS):
    """Samples in the order in which a board reads: (IMU, stamp)."""
    for k in range(n_sweeps):
        for i in range(n_imu):
            yield i, start + k * period + round(scan * (i + 0.5) / n_imu)


def feed(assembler, samples, q=ONE):
    out = []
    for i, stamp in samples:
        out += assembler.add(i, stamp, *q)
    return out


def test_a_result_per_sweep_stamped_with_its_newest_sample():
    a = SweepAssembler([True] * 4)
    samples = list(board(5))
    sweeps = feed(a, samples)
    assert [s.stamp_ns for s in sweeps] == [t for i, t in samples if i == 3]
    assert all(s.measured.all() for s in sweeps)
    assert not a.dropped


def test_disabled_imus_are_not_waited_for_and_not_measured():
    a = SweepAssembler([True, False, True, True])
    sweeps = feed(a, board(3))
    assert len(sweeps) == 3
    assert sweeps[0].measured.tolist() == [True, False, True, True]


def test_an_unplugged_imu_costs_one_timeout_and_comes_back():
    a = SweepAssembler([True] * 4, timeout=0.05)
    samples = list(board(30))
    gone = [(i, t) for i, t in samples if not (i == 2 and 100 * MS <= t - samples[0][1] < 200 * MS)]
    sweeps = feed(a, gone)
    times = np.array([s.stamp_ns for s in sweeps])
    missing = [s for s in sweeps if not s.measured[2]]
    assert all(s.measured[[0, 1, 3]].all() for s in sweeps)
    assert len(missing) == 10  # late by the timeout, but none is lost
    assert len(sweeps) == 30
    assert (np.diff(times) > 0).all()
    assert sweeps[-1].measured.all()


def test_a_lost_sample_loses_its_sweep_and_no_more_and_the_next_is_whole():
    samples = list(board(8))
    del samples[2 * 4 + 1]
    a = SweepAssembler([True] * 4)
    sweeps = feed(a, samples)
    assert len(sweeps) == 7
    ends = [t for i, t in samples if i == 3]
    assert [s.stamp_ns for s in sweeps] == ends[:2] + ends[3:]
    assert a.dropped['of a sweep that was not whole'] == 2


@pytest.mark.parametrize('first', [1, 2, 3])
def test_listening_that_begins_in_the_middle_finds_the_sweeps(first):
    samples = list(board(8))[first:]
    sweeps = feed(SweepAssembler([True] * 4), samples)
    spans = [t for i, t in samples if i == 3]
    assert [s.stamp_ns for s in sweeps][-5:] == spans[-5:]


@pytest.mark.parametrize('n_imu', [1, 2, 3, 8])
def test_imus_read_back_to_back_are_taken_as_they_come(n_imu):
    """The predecessor's board has no pause between sweeps, and its stamps jitter."""
    rng = np.random.default_rng(n_imu)
    samples = [(i, t + int(rng.integers(-MS, MS))) for i, t in board(50, n_imu, period=29 * MS, scan=29 * MS)]
    a = SweepAssembler([True] * n_imu)
    assert len(feed(a, samples)) == 50
    assert not a.dropped


def test_samples_may_arrive_in_any_order_between_imus():
    rng = np.random.default_rng(8)
    samples = list(board(60))
    expected = [t for i, t in samples if i == 3]
    for _ in range(20):
        # Each IMU's own samples stay in order; between IMUs they are late by up to three sweeps.
        late = rng.integers(0, 30 * MS, size=4)
        shuffled = sorted(samples, key=lambda s: s[1] + late[s[0]])
        sweeps = feed(SweepAssembler([True] * 4), shuffled)
        assert [s.stamp_ns for s in sweeps] == expected
        assert all(s.measured.all() for s in sweeps)


def test_imus_of_different_rates_give_results_at_the_slowest():
    samples = sorted([(k * 10 * MS + MS, 0) for k in range(100)] + [(k * 40 * MS, 1) for k in range(25)])
    a = SweepAssembler([True, True], timeout=0.1)
    sweeps = feed(a, [(i, t + 10**12) for t, i in samples])
    assert 23 <= len(sweeps) <= 26
    assert all(s.measured.all() for s in sweeps)


@pytest.mark.parametrize(
    ('q', 'reason'),
    [
        ((0.0, 0.0, 0.0, 0.0), 'all zero, not measured'),
        ((math.nan, 0.0, 0.0, 1.0), 'not a number'),
        ((math.inf, 0.0, 0.0, 1.0), 'not a number'),
        ((0.5, 0.5, 0.5, 0.6), 'norm is not 1'),
        (turned(2.0), 'turned faster than the sensor can'),
    ],
)
def test_a_bad_sample_is_counted_and_never_used(q, reason):
    a = SweepAssembler([True])
    assert len(feed(a, [(0, 1000 * MS)])) == 1
    assert a.add(0, 1010 * MS, *q) == []
    assert a.dropped == {reason: 1}
    [sweep] = feed(a, [(0, 1020 * MS)])
    np.testing.assert_array_equal(sweep.orientations[0], ONE)


def test_the_chips_own_rounding_is_no_bad_norm():
    rng = np.random.default_rng(5)
    q = rng.normal(size=(1000, 4))
    q = np.round(q / np.linalg.norm(q, axis=1)[:, None] * 2**14) / 2**14
    a = SweepAssembler([True])
    for k, one in enumerate(q):
        a.add(0, (k + 1) * 10**9, *one)
    assert not a.dropped


def test_a_turn_that_stays_is_believed_after_a_while():
    a = SweepAssembler([True])
    feed(a, [(0, 1000 * MS)])
    got = [a.add(0, (1000 + 10 * k) * MS, *turned(3.0)) for k in range(1, 20)]
    assert 5 <= a.dropped['turned faster than the sensor can'] <= 9
    assert got[-1]


def test_time_that_goes_back_a_little_is_dropped_and_far_is_a_new_recording():
    a = SweepAssembler([True, True])
    assert len(feed(a, board(10, 2))) == 10
    late = list(board(1, 2, start=1_000_000 * MS))
    assert feed(a, late) == []
    assert a.dropped['not newer than the last of its IMU'] == 2
    again = feed(a, board(10, 2, start=5 * MS))
    assert len(again) == 10
    assert a.resets == 1


def test_flush_gives_what_waits():
    a = SweepAssembler([True] * 4)
    assert feed(a, list(board(1))[:3]) == []
    [sweep] = a.flush()
    assert sweep.measured.tolist() == [True, True, True, False]
    assert a.flush() == []


def test_interpolation_takes_all_to_the_first_stamp_and_latency_is_taken_off():
    rate = 1.3  # rad/s
    a = SweepAssembler([True] * 4, interpolate=True, latency=0.02)
    sweeps = []
    for i, t in board(6):
        sweeps += a.add(i, t, *turned(rate * (t - 10**12) * 1e-9))
    for k, sweep in enumerate(sweeps):
        first = 10**12 + k * 10 * MS + MS // 2
        assert sweep.stamp_ns == first - 20 * MS
        if k:
            expected = turned(rate * (first - 10**12) * 1e-9)
            np.testing.assert_allclose(sweep.orientations, np.tile(expected, (4, 1)), atol=1e-12)


def test_the_base_imu_is_waited_for_and_held():
    a = SweepAssembler([True], has_base=True)
    assert feed(a, [(0, 10**12)]) == []
    [sweep] = a.add(1, 10**12 + MS, *turned(0.1))
    np.testing.assert_allclose(sweep.base, turned(0.1))
    silent = feed(a, [(0, 10**12 + k * 10 * MS) for k in range(1, 20)])
    assert len(silent) > 5
    np.testing.assert_allclose(silent[-1].base, turned(0.1))


def test_no_shape_without_an_orientation_of_the_base():
    a = SweepAssembler([True], has_base=True)
    assert feed(a, [(0, 10**12 + k * 10 * MS) for k in range(1, 20)]) == []
    assert a.dropped['of a sweep without the orientation of the base'] > 0
