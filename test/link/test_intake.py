"""Stamps of a session's packets, from the times on them alone."""

import numpy as np
import pytest

from sesa2.link.intake import Intake
from sesa2.link.packets import Acceleration, Data, State, SweepHeader
from sesa2.link.status import Counters
from sesa2.sensing.imu.addresses import mask_of

IDS = (1, 3, 4, 8)
BAUD = 500_000
BYTE_NS = 20_000  # ten bits
SCAN_US = 2_100
T0_US = 70_000_000
START_NS = 5 * 10**15  # of the board's clock, on the host's
MS = 1_000_000


class Notes:
    """A handler that keeps stamps and events."""

    def __init__(self):
        self.data, self.accelerations, self.events = [], [], []

    def on_data(self, data, stamps_ns):
        self.data.append(stamps_ns)

    def on_acceleration(self, acceleration, stamps_ns):
        self.accelerations.append(stamps_ns)

    def on_event(self, event):
        self.events.append(event.message)


@pytest.fixture
def notes():
    return Notes()


@pytest.fixture
def intake(notes):
    made = Intake(IDS, BAUD, 100, notes, Counters())
    made.begin()
    return made


def header(k, seq=None, period_us=10_000, ids=IDS):
    return SweepHeader(
        (k if seq is None else seq) % 2**16, (T0_US + k * period_us) % 2**32, SCAN_US, mask_of(ids)
    )


def data(head, states=None):
    n = len(head.ids)
    return Data(head, np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)), bytes(states or n * [State.RUN]), bytes(n))


def begun_ns(k, period_us=10_000):
    """When a sweep began, by the host's steady clock."""
    return START_NS + k * period_us * 1000


def read_at(intake, k):
    """Each IMU is read in the middle of its quarter of the scan, on the wall clock."""
    middles_us = SCAN_US / 4 * (np.arange(4) + 0.5)
    return intake.wall.of(begun_ns(k)) + np.rint(1000 * middles_us).astype(int)


def test_a_packet_is_stamped_with_the_time_of_reading_not_of_its_arrival(intake, notes):
    """Sent when the scan is over, it arrives when its last bit does: what it took is known, and is no delay.

    A sweep that has four IMUs has 4 · 10 bytes of them, a head of 11 and four of the frame.
    """
    for k in range(3):
        packet = data(header(k))
        assert packet.line_bytes == 55
        intake.take(packet, begun_ns(k) + 1000 * SCAN_US + 55 * BYTE_NS)
    for k in range(3):
        np.testing.assert_allclose(notes.data[k], read_at(intake, k), rtol=0, atol=1)


def test_the_acceleration_of_a_sweep_has_the_stamps_of_its_orientations(intake, notes):
    head = header(0)
    intake.take(data(head), begun_ns(0) + 1000 * SCAN_US + 55 * BYTE_NS)
    intake.take(Acceleration(head, np.zeros((4, 3))), begun_ns(0) + 9 * MS)
    assert notes.accelerations == notes.data


def test_sweeps_that_are_missing_are_counted_through_the_wrap_of_their_number(intake):
    for k, seq in enumerate([65533, 65534, 1, 2]):
        intake.take(data(header(k, seq)), begun_ns(k) + 4 * MS)
    assert intake._counters.lost_sweeps == 2
    assert intake._counters.sweeps == 4


def test_what_was_not_asked_for_is_counted_and_not_stamped(intake, notes):
    intake.take(data(header(0, ids=(1, 3, 4))), begun_ns(0) + 4 * MS)
    intake.end()
    intake.take(data(header(1)), begun_ns(1) + 4 * MS)
    assert intake._counters.stray_packets == 2
    assert not notes.data


def test_chips_that_go_and_come_back_are_told_once(intake, notes):
    gone = [State.RUN, State.ABSENT, State.RUN, State.RUN]
    starts = [State.RUN, State.TO_NDOF, State.RUN, State.RUN]
    for k, states in enumerate([None, gone, gone, starts, None, None]):
        intake.take(data(header(k), states), begun_ns(k) + 4 * MS)
        assert intake.absent == ({3} if k in (1, 2, 3) else set())
        assert intake.returned == ({3} if k > 3 else set())
    assert notes.events == ['IMU 3 does not answer']
