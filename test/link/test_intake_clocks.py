"""What clocks that step, and packets that claim another time, do to a session: stamps, what is told, what is kept."""

import tracemalloc

import numpy as np
import pytest

from sesa2.link import intake as link_intake
from sesa2.link.intake import Intake
from sesa2.link.packets import Data, SweepHeader
from sesa2.link.status import Counters, Level

PERIOD_NS = 10_000_000
START_NS = 5_000 * 10**9
SCAN_US = 4000


class Told:
    """A handler that keeps what it needs for the test."""

    def __init__(self):
        self.stamps, self.events = [], []

    def on_data(self, data, stamps_ns):
        del data
        self.stamps.append(stamps_ns)

    def on_event(self, event):
        self.events.append(event)


@pytest.fixture
def told():
    return Told()


@pytest.fixture
def intake(told):
    made = Intake((1, 2), 500_000, 100, told, Counters())
    made.begin()
    return made


def feed(intake, at_ns, board_us, first_seq=0):
    """Take packets that arrive 1 ms after they were sent, by the two clocks."""
    for k, (arrival_ns, t_us) in enumerate(zip(at_ns.tolist(), board_us.tolist(), strict=True)):
        sweep = SweepHeader((first_seq + k) % 2**16, t_us % 2**32, SCAN_US, 3)
        data = Data(sweep, np.zeros((2, 4)), b'\3\3', b'\0\0')
        line_ns = data.line_bytes * 20_000
        intake.take(data, arrival_ns + 1000 * SCAN_US + line_ns + 1_000_000)


def times(n):
    at_ns = START_NS + np.arange(n) * PERIOD_NS
    return at_ns, (at_ns - START_NS) // 1000 + 77


def errors(intake, told, at_ns):
    """Of the stamps of the first IMU, which is read after a quarter of the sweep; s."""
    stamps = np.array(told.stamps)[:, 0] - intake.wall.of(0)
    return (stamps - at_ns - 1000 * SCAN_US // 4) * 1e-9


@pytest.mark.parametrize('suspended_s', [60, 3600])
def test_a_suspension_that_the_steady_clock_does_not_count(intake, told, suspended_s):
    """All stamps are right at once, and it is told once."""
    at_ns, board_us = times(1000)
    board_us[500:] += suspended_s * 10**6
    feed(intake, at_ns, board_us)
    np.testing.assert_allclose(errors(intake, told, at_ns), 0.001, atol=1e-5)
    (event,) = told.events
    assert event.level is Level.WARN
    assert 'clock' in event.message
    assert intake.clock.jumps == 1


@pytest.mark.parametrize('ahead_s', [1000, -1000, 0.03])
def test_a_packet_that_claims_another_time(intake, told, ahead_s):
    at_ns, board_us = times(1000)
    board_us[500] += int(ahead_s * 1e6)
    feed(intake, at_ns, board_us)
    np.testing.assert_allclose(errors(intake, told, at_ns), 0.001, atol=1e-5)
    assert told.events == []
    assert (intake.clock.jumps, intake.clock.doubted) == (0, 1)


def test_stamps_go_back_only_when_it_is_told(intake, told):
    at_ns, board_us = times(3000)
    at_ns[1000:] -= 800_000_000
    at_ns[2000:] -= 5 * 10**9
    feed(intake, at_ns[:2000], board_us[:2000])
    assert np.diff([stamps[0] for stamps in told.stamps]).min() > 0
    assert len(told.events) == 1
    feed(intake, at_ns[2000:], board_us[2000:], 2000)
    assert (np.diff([stamps[0] for stamps in told.stamps]) < 0).sum() == 1
    assert len(told.events) == 2


def test_nothing_grows(intake, told, monkeypatch):
    """The board clock has its minute of points after 60 s; from then on nothing is kept, also over steps and resets."""
    monkeypatch.setattr(link_intake.time, 'monotonic', lambda: 0.0)
    n = 9000

    def minute_and_a_half(count):
        at_ns, board_us = times(n)
        at_ns += count * n * PERIOD_NS
        board_us[n // 2 :] += 1_000_000_000
        board_us[n // 3] = 5
        feed(intake, at_ns, board_us, count * n)
        told.stamps.clear()
        told.events.clear()

    minute_and_a_half(0)
    tracemalloc.start()
    try:
        minute_and_a_half(1)
        before = tracemalloc.get_traced_memory()[0]
        for count in range(2, 6):
            minute_and_a_half(count)
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert grown < 20_000
