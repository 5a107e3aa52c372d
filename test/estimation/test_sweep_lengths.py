"""Lengths put to sweeps: whole, in order, by the stamps alone, and never a silent constant."""

import numpy as np
import pytest

from sesa2.estimation.arrivals import OFFLINE_PATIENCE, PATIENCE_MIN_NS, Arrivals
from sesa2.estimation.sweep_lengths import SweepLengths
from sesa2.estimation.sweeps import Sweep

MS = 1_000_000
T0 = 1_700_000_000_000 * MS


def ns(t_ms):
    return round(t_ms * MS)


def truth(t_ms, backbone=0):
    """The lengths of the arm in these tests, m."""
    return 0.16 + 0.02 * np.sin(t_ms / 300.0 + backbone) + 0.01 * backbone


class Live:
    """Samples and sweeps as they arrive, and what comes out: (stamp, ms; lengths; arrival, ms)."""

    def __init__(self, n=1, patience=None, timeout=0.2):
        self.imus = Arrivals(1, patience)
        self.lengths = SweepLengths(n, timeout=timeout, imus=self.imus, patience=patience)
        self.out = []

    def sample(self, arrival, t, backbones=(0,), offset=0.0):
        values = np.array([[truth(t, b) for b in backbones]])
        self.lengths.add(backbones, np.array([T0 + ns(t + offset)]), values, np.array([ns(arrival)]))
        self._note(self.lengths.ready(ns(arrival)), arrival)

    def sweep(self, arrival, t):
        self.imus.observe(0, T0 + ns(t), ns(arrival))
        self._note(self.lengths.put([sweep_at(t)], ns(arrival)), arrival)

    def tick(self, arrival):
        self._note(self.lengths.ready(ns(arrival)), arrival)

    def run(self, events):
        """(arrival, what, arguments) in order of arrival."""
        for arrival, what, *arguments in sorted(events, key=lambda event: event[0]):
            getattr(self, what)(arrival, *arguments)

    def _note(self, sweeps, arrival):
        self.out += [((s.stamp_ns - T0) / MS, s.lengths, arrival) for s in sweeps]

    @property
    def stamps(self):
        return [stamp for stamp, _, _ in self.out]

    def of(self, backbone=0):
        return np.array([lengths[backbone] for _, lengths, _ in self.out])


def sweep_at(t):
    return Sweep(T0 + ns(t), np.tile([0.0, 0.0, 0.0, 1.0], (1, 1)), np.array([True]), None)


def healthy(begin, end, *, sweeps=True, samples=True):
    """Sweeps and samples at 100 Hz, 1 and 0.5 ms on their way; samples are taken 3.3 ms after the sweeps."""
    events = []
    for t in np.arange(begin, end, 10.0):
        events += [(t + 1.0, 'sweep', t)] if sweeps else []
        events += [(t + 3.8, 'sample', t + 3.3)] if samples else []
    return events


def test_each_sweep_has_what_was_measured_around_it_and_leaves_in_order():
    live = Live()
    live.run(healthy(0, 2000))
    assert live.stamps == list(np.arange(0, 2000, 10.0))
    samples = np.arange(3.3, 2000, 10.0)
    np.testing.assert_allclose(live.of()[1:], np.interp(live.stamps[1:], samples, truth(samples)), atol=1e-12)
    assert np.isnan(live.of()[0]), 'before the first sample nothing is known'
    assert max(arrival - stamp for stamp, _, arrival in live.out) < 10.0


@pytest.mark.parametrize('seed', range(3))
def test_what_comes_out_does_not_depend_on_the_order_in_which_messages_arrive(seed):
    """Each topic in order, but late by up to 150 ms, in bursts, as over a bad link."""
    rng = np.random.default_rng(seed)
    events = []
    for what, begin in (('sweep', 0.0), ('sample', 3.3)):
        t = np.arange(begin, 3000, 10.0)
        burst = np.repeat(rng.uniform(0, 150, len(t) // 10 + 1), 10)[: len(t)]
        arrival = np.maximum.accumulate(t + burst) + 1e-3 * np.arange(len(t)) / len(t)
        events += list(zip(arrival, [what] * len(t), t, strict=True))
    live, calm = Live(), Live()
    live.run(events)
    calm.run(healthy(0, 3000))
    assert live.stamps == calm.stamps
    np.testing.assert_array_equal(live.of(), calm.of())


def test_when_lengths_end_results_end_at_the_timeout_and_sweeps_go_on():
    live = Live()
    ticks = [(t, 'tick') for t in range(0, 20_000, 50)]
    live.run([*healthy(0, 12_000), *healthy(12_000, 16_000, samples=False), *healthy(16_000, 20_000), *ticks])
    last = 11_993.3
    missing = np.isnan(live.of())
    expected = [t == 0.0 or last + 200.0 < t < 16_003.3 for t in live.stamps]
    assert list(missing) == expected
    held = [(t, v) for t, v in zip(live.stamps, live.of(), strict=True) if last < t <= last + 200.0]
    assert len(held) == 20
    np.testing.assert_array_equal([v for _, v in held], truth(last))
    assert live.lengths.n_without[0] == sum(expected)
    # The pause is told by the clock; while they are away nothing waits, and when they are back all is as before.
    waits = {stamp: arrival - stamp for stamp, _, arrival in live.out}
    patience_ms = live.lengths.arrivals.patience_ns / MS
    assert patience_ms == PATIENCE_MIN_NS / MS
    assert max(waits.values()) < 1000.0 + 60.0
    assert all(wait < 2.0 for t, wait in waits.items() if 13_100 < t < 15_990)
    assert all(wait < 10.0 for t, wait in waits.items() if t > 16_010)


def test_sweeps_do_not_wait_for_ever_when_all_falls_silent():
    live = Live()
    live.run(healthy(0, 1000))
    live.sweep(1001.0, 1000.0)
    n = len(live.out)
    live.tick(1500.0)
    assert len(live.out) == n, 'too early to tell'
    live.tick(2100.0)
    assert live.stamps[-1] == 1000.0
    assert live.of()[-1] == truth(993.3)


def test_several_publishers_each_with_a_part_of_the_names():
    live = Live(3)
    for t in np.arange(0.0, 1000.0, 10.0):
        live.sample(t + 1, t, (2, 0))
        if t % 30.0 == 0.0 and not 400.0 <= t < 800.0:
            live.sample(t + 2, t, (1,))
        live.sweep(t + 3, t)
    live.tick(10_000.0)
    stamps = np.array(live.stamps)
    np.testing.assert_allclose(live.of(0), truth(stamps), atol=1e-12)
    np.testing.assert_allclose(live.of(2), truth(stamps, 2), atol=1e-12)
    gone = (stamps > 390.0 + 200.0) & (stamps < 810.0)
    np.testing.assert_array_equal(np.isnan(live.of(1)), gone)
    assert live.lengths.n_without[0] == live.lengths.n_without[2] == 0


def test_without_any_length_sweeps_leave_without():
    live = Live(2)
    live.run([*healthy(0, 3000, samples=False), *[(t, 'tick') for t in range(0, 4000, 50)]])
    assert live.stamps == list(np.arange(0, 3000, 10.0))
    assert np.isnan(live.of(0)).all()
    assert max(arrival - stamp for stamp, _, arrival in live.out if stamp > 1200) < 2.0


@pytest.mark.parametrize(('offset', 'usable'), [(-150.0, True), (-400.0, False), (500.0, None)])
def test_a_clock_that_is_off_is_named_with_its_lag_and_holds_nobody_up(offset, usable):
    live = Live()
    for t in np.arange(0.0, 8000.0, 10.0):
        live.sweep(t + 1, t)
        live.sample(t + 2, t, offset=offset)
        live.tick(t + 3)
    assert live.lengths.lags[0] == pytest.approx(-offset / 1e3, abs=0.005)
    late = [arrival - stamp for stamp, _, arrival in live.out if stamp > 3000]
    if usable is False:
        assert np.isnan(live.of()[200:]).all()
        assert max(late) < 5.0
    else:
        begin = 51 if usable is None else 0
        np.testing.assert_allclose(
            live.of()[begin:], truth(np.array(live.stamps[begin:]) - offset), atol=1e-12
        )
        assert max(late) < max(5.0, -offset + 15.0)


@pytest.mark.parametrize('lengths_first', [True, False])
def test_a_loop_gives_each_round_the_same(lengths_first):
    live = Live()
    shift = -1.0 if lengths_first else 4.0
    for round_ in range(3):
        began = round_ * 2000.0
        live.imus.reset()  # as the assembler does
        events = [(began + t + shift, 'sample', t) for t in np.arange(0.0, 1995.0, 10.0)]
        events += [(began + t + 1, 'sweep', t) for t in np.arange(0.0, 1995.0, 10.0)]
        live.run(events)
    live.out += [((s.stamp_ns - T0) / MS, s.lengths, 0.0) for s in live.lengths.flush()]
    assert live.stamps == 3 * list(np.arange(0.0, 1995.0, 10.0))
    np.testing.assert_allclose(live.of(), truth(np.array(live.stamps)), atol=1e-12)
    assert not live.lengths.tracks[0].dropped
    assert not live.lengths.lags


def test_a_recording_in_blocks_gives_what_live_gave():
    live = Live(2)
    rng = np.random.default_rng(5)
    gone = rng.uniform(0, 30_000, 12)
    there = [t for t in np.arange(3.3, 30_000, 10.0) if not any(0 < t - g < 600 for g in gone)]
    sweeps = list(np.arange(0.0, 30_000, 10.0))
    live.run(
        [
            *[(t + 1, 'sweep', t) for t in sweeps],
            *[(t + 0.5, 'sample', t, (0, 1)) for t in there],
            *[(t, 'tick') for t in range(0, 40_000, 50)],
        ]
    )
    offline = SweepLengths(2, timeout=0.2, imus=Arrivals(1, OFFLINE_PATIENCE), patience=OFFLINE_PATIENCE)
    out = []
    for begin in range(0, 30_000, 2500):
        part = np.array([t for t in there if begin <= t < begin + 2500])
        lengths = np.stack([truth(part, 0), truth(part, 1)], axis=-1)
        stamps = T0 + np.round(part * MS).astype(np.int64)
        offline.add((0, 1), stamps, lengths, stamps - T0)
        out += offline.put([sweep_at(t) for t in sweeps if begin <= t < begin + 2500], ns(begin + 2500))
    out += offline.flush()
    assert [(s.stamp_ns - T0) / MS for s in out] == live.stamps == sweeps
    np.testing.assert_array_equal(np.array([s.lengths for s in out]), np.stack([live.of(0), live.of(1)], 1))
    assert offline.n_without == live.lengths.n_without
    assert np.isnan(live.of()).any()


def test_in_a_recording_too_what_is_always_too_late_has_no_lengths():
    """Though a block holds what came after its sweeps."""
    imus = Arrivals(1, OFFLINE_PATIENCE)
    offline = SweepLengths(1, timeout=0.2, imus=imus, patience=OFFLINE_PATIENCE)
    out = []
    for begin in range(0, 10_000, 2500):
        t = np.arange(begin, begin + 2500.0, 10.0)
        for one in t:
            imus.observe(0, T0 + ns(one), ns(one))
        arrivals = np.round(t * MS).astype(np.int64)
        offline.add((0,), T0 + arrivals - 400 * MS, truth(t)[:, None], arrivals)
        out += offline.put([sweep_at(one) for one in t], ns(begin + 2500))
    assert len(out) == 1000
    assert all(np.isnan(sweep.lengths).all() for sweep in out)
    assert offline.n_without[0] == 1000
