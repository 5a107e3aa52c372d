"""Sweeps from samples: whole ones, lost samples, unplugged IMUs, bad samples, clocks that jump, bursts, lossy links."""

import math

import numpy as np
import pytest
from lossy_link import over_a_link

from sesa2.estimation.sweeps import NO_BASE, WAITING_MAX, SweepAssembler
from sesa2.estimation.time_steps import HELD_MAX
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


def test_the_base_imu_is_waited_for_and_held_within_the_timeout_and_no_longer():
    a = SweepAssembler([True], has_base=True, timeout=0.05)
    assert feed(a, [(0, 10**12)]) == []
    [sweep] = a.add(1, 10**12 + MS, *turned(0.1))
    np.testing.assert_allclose(sweep.base, turned(0.1))
    silent = feed(a, [(0, 10**12 + k * 10 * MS) for k in range(1, 20)])
    # 10 to 50 ms after its last sample at 1 ms; then there is no shape, and each sample of the arm's IMU is counted.
    assert [s.stamp_ns - 10**12 for s in silent] == [10 * MS, 20 * MS, 30 * MS, 40 * MS, 50 * MS]
    np.testing.assert_allclose([s.base for s in silent], [turned(0.1)] * 5)
    assert a.dropped == {NO_BASE: 14}
    [again, *_] = a.add(1, 10**12 + 191 * MS, *turned(0.1)) + a.add(0, 10**12 + 200 * MS, *ONE) + a.flush()
    assert again.stamp_ns > 10**12 + 190 * MS


def test_no_shape_without_an_orientation_of_the_base():
    a = SweepAssembler([True], has_base=True)
    assert feed(a, [(0, 10**12 + k * 10 * MS) for k in range(1, 20)]) == []
    assert a.dropped['of a sweep without the orientation of the base'] > 0


def live(assembler, arrivals):
    """What a node gives that is told (arrival, IMU, stamp)."""
    return [sweep for now, i, stamp in arrivals for sweep in assembler.add(i, stamp, *ONE, now)]


def stamps_of(sweeps):
    return [s.stamp_ns for s in sweeps]


def ends(samples, last=3):
    """Stamps of whole sweeps: those of the IMU that is read last."""
    return [t for i, t in samples if i == last]


@pytest.mark.parametrize('patience', [None, 5.0])
@pytest.mark.parametrize('between', [0, 20 * MS])
def test_instants_that_arrive_topic_by_topic_give_as_many_whole_sweeps(between, patience):
    samples = list(board(100, 8))
    burst = sorted(samples)
    now = 5 * 10**9
    a = SweepAssembler([True] * 8, patience=patience)
    sweeps = live(a, [(now + between * i + k, i, t) for k, (i, t) in enumerate(burst)])
    assert stamps_of(sweeps) == ends(samples, 7)
    assert all(s.measured.all() for s in sweeps)
    assert not a.dropped


def test_after_a_cut_of_seconds_all_are_whole():
    samples = list(board(800, 8))
    start, arrivals = samples[0][1], []
    for i, t in samples:
        cut = t - start >= 1000 * MS
        # The link is back at 6 s and carries what it kept, topic by topic, within 400 ms.
        arrivals.append(
            (max(t + MS, start + 6001 * MS + 50 * MS * i + (t - start) // 1000) if cut else t + MS, i, t)
        )
    a = SweepAssembler([True] * 8)
    sweeps = live(a, sorted(arrivals))
    assert stamps_of(sweeps) == ends(samples, 7)
    assert all(s.measured.all() for s in sweeps)


def test_an_imu_that_dies_costs_a_pause_and_no_sweep():
    samples = list(board(400, 4))
    start = samples[0][1]
    there = [(t + MS, i, t) for i, t in samples if not (i == 2 and t - start >= 2000 * MS)]
    a = SweepAssembler([True] * 4)
    given = []
    for now, i, t in there:
        given += [(now, s) for s in a.add(i, t, *ONE, now)]
    assert stamps_of(s for _, s in given) == ends(samples)
    assert all(s.measured[2] == (s.stamp_ns - start < 2000 * MS) for _, s in given)
    late = [now - s.stamp_ns for now, s in given]
    assert max(late) < 1100 * MS
    assert max(late[-50:]) <= 11 * MS  # it is not waited for any more
    assert a.alive == [True, True, False, True]


def test_on_a_link_that_has_long_been_well_the_pause_is_short():
    samples = list(board(3000, 4))
    start = samples[0][1]
    a = SweepAssembler([True] * 4)
    given = []
    for i, t in samples:
        if not (i == 2 and t - start >= 25_000 * MS):
            given += [(t, s) for s in a.add(i, t, *ONE, t)]
    assert max(now - s.stamp_ns for now, s in given) < 330 * MS
    assert len(given) == 3000


@pytest.mark.parametrize('stall', [700, 2000, 5000])
@pytest.mark.parametrize('kept', [100, 1000])
@pytest.mark.parametrize('within', [0, 3, 7])
def test_a_stall_of_a_link_that_has_long_been_well_makes_nobody_silent(stall, kept, within):
    """It begins in the middle of a sweep; then the topics come back one by one, with as much as was kept of each."""
    samples = list(board(3200, 8))
    begin = samples[2500 * 8 + within][1]
    end, arrivals = begin + stall * MS, []
    for i, t in samples:
        back = end + 20 * MS * ((i - within) % 8)
        if begin <= t < end - kept * 10 * MS:
            continue
        arrivals.append((max(t, back) if begin <= t else t, i, t))
    a = SweepAssembler([True] * 8)
    sweeps = live(a, sorted(arrivals))
    assert all(s.measured.all() for s in sweeps)
    # What was kept makes whole sweeps, but for those at either end of a gap.
    there = [{t // (10 * MS) for _, k, t in arrivals if k == i} for i in range(8)]
    assert len(set.intersection(*there)) - 2 <= len(sweeps) <= len(set.intersection(*there))
    assert (np.diff(stamps_of(sweeps)) > 0).all()
    assert not a.dropped['later than its sweep could wait']


def test_while_nobody_is_heard_an_imu_that_is_late_already_is_not_taken_for_dead():
    samples = list(board(3500, 4))
    begin = samples[0][1] + 30_000 * MS
    # IMU 2 misses 200 ms; then for 3 s nothing comes of any, and all resume.
    arrivals = [
        (t if t < begin + 200 * MS else max(t, begin + 3200 * MS + i), i, t)
        for i, t in samples
        if not (i == 2 and begin <= t < begin + 200 * MS)
    ]
    a = SweepAssembler([True] * 4)
    sweeps = live(a, sorted(arrivals))
    assert stamps_of(sweeps) == ends(samples)
    assert sum(not s.measured.all() for s in sweeps) == 20


@pytest.mark.parametrize(('n_silent', 'pause'), [(1, 300), (4, 300), (5, 1000), (7, 1000)])
def test_when_most_fall_silent_the_rest_waits_longer(n_silent, pause):
    samples = list(board(3000, 8))
    dead = samples[0][1] + 25_000 * MS
    a, last, longest = SweepAssembler([True] * 8), None, 0
    for i, t in samples:
        if not (i < n_silent and t >= dead) and a.add(i, t, *ONE, t):
            longest, last = max(longest, t - (last or t)), t
    assert pause * MS < longest < (pause + 25) * MS
    assert a.alive == [i >= n_silent for i in range(8)]


@pytest.mark.parametrize(('n_silent', 'n_partial'), [(1, 30), (4, 30), (5, 0), (7, 0)])
def test_of_a_silence_of_most_that_was_short_nothing_is_made(n_silent, n_partial):
    samples = list(board(3000, 8))
    start = samples[0][1] + 25_000 * MS
    there = [(t, i, t) for i, t in samples if not (i < n_silent and start <= t + 2 * MS < start + 300 * MS)]
    a = SweepAssembler([True] * 8, patience=5.0)
    sweeps = live(a, there)
    assert sum(not s.measured.all() for s in sweeps) == n_partial
    assert len(sweeps) == 2970 + n_partial
    assert sum(a.dropped.values()) == (0 if n_partial else 30 * (8 - n_silent))


@pytest.mark.parametrize('patience', [None, 5.0])
def test_nothing_is_made_of_one_imu_while_nobody_is_heard(patience):
    a = SweepAssembler([True] * 2, patience=patience)
    burst = [(10**9 + k, 0, k * 10 * MS + 10**12) for k in range(50)]
    assert live(a, burst) == []
    assert live(a, [(3600 * 10**9, 0, 10**12 + 500 * MS)]) == []
    later = [(3600 * 10**9 + k * 10 * MS, 0, 10**12 + (500 + k * 10) * MS) for k in range(1, 600)]
    assert len(live(a, later)) == 650


def test_a_silence_shorter_than_the_patience_costs_no_sweep_either():
    samples = list(board(100, 4))
    start = samples[0][1]
    there = [(t, i, t) for i, t in samples if not (i == 1 and 300 * MS <= t - start < 500 * MS)]
    a = SweepAssembler([True] * 4)
    sweeps = live(a, there)
    assert stamps_of(sweeps) == ends(samples)
    missing = [s.stamp_ns - start for s in sweeps if not s.measured.all()]
    assert len(missing) == 20
    assert 300 * MS <= min(missing) < max(missing) < 500 * MS


def test_an_imu_that_says_that_it_has_not_measured_is_not_waited_for_by_the_clock():
    samples = list(board(100, 4))
    a = SweepAssembler([True] * 4)
    late = []
    for k, (i, t) in enumerate(samples):
        q = (0.0, 0.0, 0.0, 0.0) if i == 2 and k > 200 else ONE
        late += [t - s.stamp_ns for s in a.add(i, t, *q, t)]
    assert len(late) == 100
    assert max(late) <= 70 * MS


@pytest.mark.parametrize('delay', [5, 50])
@pytest.mark.parametrize('loss', [0.02, 0.2])
def test_over_a_lossy_link_with_repetition_all_are_whole_and_in_order(loss, delay):
    samples = list(board(3000, 8))
    arrivals = over_a_link(samples, loss=loss, delay_ns=delay * MS, seed=int(1000 * loss) + delay)
    a = SweepAssembler([True] * 8)
    sweeps = live(a, arrivals)
    stamps = np.array(stamps_of(sweeps))
    assert (np.diff(stamps) > 0).all()
    assert all(s.measured.all() for s in sweeps)
    assert stamps.tolist() == ends(samples, 7)[: len(stamps)]
    assert len(stamps) > 2900


def test_over_a_link_that_loses_for_good_none_is_out_of_order_or_lacks_an_imu():
    rng = np.random.default_rng(4)
    samples = [s for s in board(1000, 8) if rng.random() > 0.02]
    late = rng.integers(0, 5 * MS, size=8)
    a = SweepAssembler([True] * 8)
    sweeps = live(a, sorted((t + late[i], i, t) for i, t in samples))
    assert (np.diff(stamps_of(sweeps)) > 0).all()
    assert all(s.measured.all() for s in sweeps)
    assert 0.8 * 1000 < len(sweeps) < 0.9 * 1000  # 0.98⁸ = 0.85
    assert a.dropped['of a sweep that was not whole'] > 0


def test_what_comes_after_its_sweep_was_given_is_counted_and_the_imu_lives_again():
    samples = list(board(600, 4))
    start = samples[0][1]
    held_up = [
        (
            t
            if i != 3 or not 2000 * MS <= t - start < 4000 * MS
            else start + 4000 * MS + (t - start) // 10**6,
            i,
            t,
        )
        for i, t in samples
    ]
    a = SweepAssembler([True] * 4)
    sweeps = live(a, sorted(held_up))
    assert (np.diff(stamps_of(sweeps)) > 0).all()
    late = a.dropped['later than its sweep could wait']
    assert 0 < late <= sum(not s.measured[3] for s in sweeps) <= late + 1
    assert len(sweeps) == 600
    assert sweeps[-1].measured.all()


@pytest.mark.parametrize('lag', [200, -200])
def test_an_imu_with_a_clock_of_its_own_is_waited_for_and_told(lag):
    samples = [(t, i, t - lag * MS if i == 2 else t) for i, t in board(500, 4)]
    a = SweepAssembler([True] * 4)
    sweeps = live(a, samples)
    assert len(sweeps) >= 475
    assert all(s.measured.all() for s in sweeps[20:])
    assert list(a.arrivals.lags) == [2]
    assert a.arrivals.lags[2] == pytest.approx(lag / 1000, abs=1e-6)


def test_a_glitch_of_all_clocks_by_years_is_left_out():
    samples = list(board(300, 4))
    start = samples[0][1]
    years = 44 * 365 * 86_400 * 10**9

    def glitching(t):
        return t - years if 1000 * MS <= t - start < 1200 * MS else t

    a = SweepAssembler([True] * 4)
    sweeps = live(a, [(t, i, glitching(t)) for i, t in samples])
    assert stamps_of(sweeps) == [t for t in ends(samples) if glitching(t) == t]
    assert all(s.measured.all() for s in sweeps)
    assert a.dropped == {'stamped 44 years before the rest': 80}
    assert a.resets == 0


@pytest.mark.parametrize('step', [-44 * 365 * 86_400 * 10**9, -30 * 10**9, 30 * 10**9, 1000 * 10**9])
@pytest.mark.parametrize('when', [0, 1000])
def test_a_glitch_of_one_clock_costs_its_own_samples(step, when):
    """Also at the very start, when nobody knows yet which of the stamps is right."""
    samples = list(board(300, 4))
    start = samples[0][1]
    a = SweepAssembler([True] * 4)
    glitching = [
        (t, i, t + step if i == 0 and when * MS <= t - start < (when + 100) * MS else t) for i, t in samples
    ]
    sweeps = live(a, glitching)
    assert (np.diff(stamps_of(sweeps)) > 0).all()
    assert set(stamps_of(sweeps)) <= {t for _, t in samples}
    assert sum(s.measured.all() for s in sweeps) >= 280
    assert a.resets == 0
    assert sum(n for reason, n in a.dropped.items() if 'the rest' in reason) == 10


def test_a_clock_that_stays_in_another_time_is_told_and_nothing_grows():
    a = SweepAssembler([True] * 4)
    samples = ((t, i, t - 60 * 10**9 if i == 1 and t > 10**12 + 10**9 else t) for i, t in board(20_000, 4))
    sweeps = live(a, samples)
    assert len(sweeps) == pytest.approx(20_000, abs=2)
    assert a.arrivals.lags[1] == pytest.approx(60.0)
    assert sum(a.dropped.values()) == pytest.approx(19_900, abs=HELD_MAX)


def test_a_bag_that_loops_resets_and_every_round_is_whole():
    a = SweepAssembler([True] * 4)
    samples = list(board(150, 4))
    now = 10**9
    out = []
    for k in range(20):
        out += live(a, [(now + k * 1500 * MS + t - samples[0][1], i, t) for i, t in samples])
    # The last sweep of a round needs nothing of the next.
    assert stamps_of(out) == 20 * ends(samples)
    assert all(s.measured.all() for s in out)
    assert a.resets == 19
    assert not a.dropped


def test_a_loop_in_bursts_topic_by_topic():
    a = SweepAssembler([True] * 4)
    samples = sorted(board(150, 4))
    out = []
    for k in range(3):
        out += live(a, [(10**9 + k * 1500 * MS + n, i, t) for n, (i, t) in enumerate(samples)])
    assert stamps_of(out) == 3 * ends(samples)
    assert all(s.measured.all() for s in out)


def test_a_pause_of_all_for_a_minute_is_no_glitch():
    samples = [*board(100, 4), *board(100, 4, start=1_060_000 * MS)]
    a = SweepAssembler([True] * 4)
    sweeps = live(a, [(t, i, t) for i, t in samples])
    assert stamps_of(sweeps) == ends(samples)
    assert not a.dropped
    assert a.resets == 0


def test_one_imu_that_runs_on_alone_fills_no_memory():
    """By a clock that stands still, as in a recording without times."""
    a = SweepAssembler([True] * 2)
    n = sum(len(a.add(0, 10**12 + k * MS, *ONE, 0)) for k in range(WAITING_MAX + 100))
    assert n == WAITING_MAX + 100


def test_topics_that_are_connected_one_after_another_give_whole_sweeps_from_the_start():
    samples = list(board(100, 4))
    start = samples[0][1]
    a = SweepAssembler([True] * 4)
    sweeps = live(a, [(t, i, t) for i, t in samples if t - start >= 150 * MS * i])
    assert stamps_of(sweeps) == ends(samples)[45:]
    assert all(s.measured.all() for s in sweeps)
    assert a.dropped['before there were samples of all'] > 0


@pytest.mark.parametrize('seed', range(30))
def test_whatever_happens_sweeps_leave_in_order_and_every_sample_is_told(seed):
    """Random loss, delay, silence and order; offline, with the whole patience, nothing that was measured is late."""
    rng = np.random.default_rng(seed)
    samples = [s for s in board(300, 4) if rng.random() > 0.03]
    start = samples[0][1]
    for _ in range(3):
        who, begin, length = rng.integers(4), rng.integers(2500), rng.integers(1, 500)
        samples = [
            (i, t) for i, t in samples if i != who or not begin * MS <= t - start < (begin + length) * MS
        ]
    arrivals = over_a_link(samples, loss=0.1, delay_ns=20 * MS, seed=seed)
    for patience in (None, 5.0):
        a = SweepAssembler([True] * 4, patience=patience)
        sweeps = live(a, arrivals)
        sweeps += a.flush()
        assert (np.diff(stamps_of(sweeps)) > 0).all()
    assert not a.dropped['later than its sweep could wait']
    in_order = SweepAssembler([True] * 4, patience=5.0)
    expected = live(in_order, [(t, i, t) for i, t in samples]) + in_order.flush()
    assert stamps_of(sweeps) == stamps_of(expected)
    np.testing.assert_array_equal([s.measured for s in sweeps], [s.measured for s in expected])
