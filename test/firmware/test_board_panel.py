"""The thesis's display and calibration button, compiled in with LCD=1."""

import pytest

from bench import assert_no_gap, assert_quaternions_right


@pytest.fixture
def panel(new_bench, build_variant):
    return new_bench(elf=build_variant('lcd', 'LCD=1').elf)


def display(bench):
    """Both rows, once all characters of a change are written."""
    shown = None
    while shown != (shown := bench.simulated.command('display')):
        bench.wait(0.02)
    return shown.split('|')


def press(bench):
    for pressed in (1, 0):
        bench.simulated.command('button', pressed)
        bench.wait(0.1)
    bench.wait(0.3)


def test_it_shows_which_imus_are_plugged_in_while_nobody_uses_the_board(panel):
    panel.simulated.command('unplug', 3)
    panel.wait(1.5)
    assert display(panel) == ['sesa2 is waiting', 'found   123-5678']


def test_it_shows_which_imus_run(panel):
    panel.simulated.command('unplug', 3)
    panel.boot()
    panel.start(mask=0b01111111)
    panel.wait(0.5)
    assert display(panel) == ['IMU     12345678', 'missing RRR-RRR ']
    panel.simulated.command('plug', 3)
    panel.wait(1.2)
    assert display(panel) == ['IMU     12345678', 'all run RRRRRRR ']


def test_the_button_switches_to_the_scores_and_back(panel):
    panel.simulated.command('unplug', 3)
    for channel in range(8):
        panel.simulated.command('calibration', channel, channel % 4 << 6 | 3 << 4 | 1 << 2)
    panel.boot()
    panel.start()
    press(panel)
    shown = set()
    for _ in range(9):
        panel.wait(0.6)
        shown.add(tuple(display(panel)))
    assert shown == {
        ('IMU     12345678', 'system  012-0123'),
        ('IMU     12345678', 'gyro    333-3333'),
        ('IMU     12345678', 'accel   111-1111'),
        ('IMU     12345678', 'mag     000-0000'),
    }
    press(panel)
    assert display(panel)[1] == 'missing RRR-RRRR'


def test_it_does_not_disturb_the_stream(panel):
    panel.boot()
    panel.simulated.set_pattern()
    panel.start()
    data = panel.watch(1.0)
    press(panel)
    data += panel.data()[len(data) :]
    assert_no_gap(data)
    assert_quaternions_right(data)
    assert panel.client.stats().late == 0


def test_it_survives_a_reset_of_the_board(panel):
    panel.boot()
    panel.start()
    panel.simulated.command('reset')
    panel.wait(0.5)
    assert display(panel) == ['sesa2 is waiting', 'found   12345678']
