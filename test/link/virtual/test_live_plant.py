"""The simulated arm by the clock, with a clock that the test turns."""

import threading

import numpy as np
import pytest

from sesa2.configuration import files
from sesa2.link.virtual import live_plant
from sesa2.link.virtual.live_plant import LivePlant


@pytest.fixture
def clock(monkeypatch):
    class Clock:
        s = 100.0

        def __call__(self):
            return round(self.s * 1e9)

    turned = Clock()
    monkeypatch.setattr(live_plant, 'steady_ns', turned)
    return turned


@pytest.fixture
def live(clock):
    return LivePlant(files.load_configuration('tri_backbone'))


def test_it_is_as_far_as_it_was_asked_for(clock, live):
    live.command([0.2, 0.2, 0.2])
    clock.s += 0.51
    live.motion([[0.5, 0.501]])
    assert live.plant.time == pytest.approx(0.5)
    live.motion([[0.7]])  # still to come
    assert live.plant.time == pytest.approx(0.51)
    clock.s += 0.724
    at, said = live.said_lengths()
    assert at == pytest.approx(1.23)
    np.testing.assert_allclose(said, live.plant.encoders)
    assert live.motion(np.full((3, 2), 1.2)).shape == (3, 2, 2, 4)
    assert live.plant.time == pytest.approx(1.23)  # nobody takes it back


def test_who_asks_and_in_which_strides_does_not_matter(clock):
    c = files.load_configuration('tri_backbone')
    one, other = LivePlant(c), LivePlant(c)
    for k in range(1, 700):
        one.coordinates_at(0.01 * k)
        clock.s = 100.0 + 0.01 * k
        one.said_lengths()
    for t in (1.5, 3.0, 4.5):
        other.motion(t)
    assert other.plant.time == pytest.approx(4.5)
    other.coordinates_at(6.3)
    other.said_lengths()
    np.testing.assert_array_equal(one.plant.coordinates, other.plant.coordinates)
    assert np.abs(one.plant.bends).max() > 0.1  # it moved by itself


def test_the_past_can_be_asked_for(clock, live):
    live.command([0.2, 0.17, 0.17])
    seen = {}
    for k in range(1, 100):
        clock.s = 100.0 + 0.01 * k
        live.said_lengths()
        seen[k] = live.plant.coordinates
    for k in (1, 50, 98):
        np.testing.assert_allclose(live.coordinates_at(0.01 * k), seen[k], atol=1e-9)


def test_an_arm_whose_process_was_held_up_stood_still_meanwhile(clock, live):
    live.command([0.2, 0.2, 0.2])
    clock.s += 0.1
    live.said_lengths()
    before = live.plant.time
    clock.s += 3600.0
    live.said_lengths()
    assert live.plant.time - before < 0.1
    seen = live.plant.coordinates
    clock.s += 0.5
    at, _ = live.said_lengths()
    assert at == pytest.approx(3600.6, abs=0.02)
    assert live.plant.time - before == pytest.approx(0.5, abs=0.03)
    np.testing.assert_allclose(live.coordinates_at(3600.1), seen, atol=2e-4)
    assert np.abs(live.plant.coordinates - seen).max() > 0.02


def test_once_told_it_does_nothing_by_itself_any_more(clock, live):
    clock.s += 8.0
    for k in range(1, 9):
        live.coordinates_at(float(k))
    assert np.abs(live.plant.bends).max() > 0.1
    stayed = live.plant.encoders
    live.obey()
    clock.s += 1.9
    live.said_lengths()
    np.testing.assert_allclose(live.plant.encoders, stayed, atol=1.1e-4)
    live.command([0.1, 0.11, 0.12])
    live.obey()  # again: the command stands
    clock.s += 1.9
    live.said_lengths()
    np.testing.assert_allclose(live.plant.encoders, [0.1, 0.11, 0.12], atol=1e-4)


def test_threads_may_ask_at_once(clock, live):
    clock.s += 1.5
    got = []
    threads = [threading.Thread(target=lambda: got.append(live.coordinates_at(1.5))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert live.plant.time == pytest.approx(1.5)
    np.testing.assert_array_equal(got, np.broadcast_to(got[0], (4, 3)))
