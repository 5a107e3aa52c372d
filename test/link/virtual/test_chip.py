from random import Random

import pytest

from sesa2.link.packets import scores_of
from sesa2.link.requests import FusionMode
from sesa2.link.virtual.chip import BOOT_US, Chip
from sesa2.sensing.imu.bno055.offsets import Offsets
from sesa2.sensing.imu.bno055.scores import Scores

OFFSETS = Offsets((1, 2, 3), (4, 5, 6), (7, 8, 9), 10, 11).to_registers()
FULL_US = 12_000_000


@pytest.fixture
def chip():
    return Chip(Random(1), FULL_US)


def scores(chip, now_us):
    return scores_of(chip.calib(now_us))


def test_scores_grow_to_the_full(chip):
    chip.set_mode(FusionMode.NDOF, 0)
    assert scores(chip, 0) == (0, 0, 0, 0)
    seen = [scores(chip, t) for t in range(0, FULL_US + 1, 100_000)]
    for column in zip(*seen, strict=True):
        assert list(column) == sorted(column)
    assert seen[-1] == (3, 3, 3, 3)
    assert all(score.sys == min(score[1:]) for score in seen)


def test_imu_mode_has_no_magnetometer_score(chip):
    chip.set_mode(FusionMode.IMU, 0)
    assert scores(chip, FULL_US) == Scores(sys=3, gyro=3, accel=3, mag=0)


def test_without_fusion_there_are_no_scores_and_nothing_is_learnt(chip):
    before = chip.read_offsets()
    chip.set_mode(FusionMode.RAW, 0)
    assert scores(chip, FULL_US) == (0, 0, 0, 0)
    chip.set_mode(0, FULL_US)
    assert chip.read_offsets() == before
    chip.set_mode(FusionMode.NDOF, FULL_US)
    assert scores(chip, FULL_US) == (0, 0, 0, 0)


def test_given_offsets_calibrate_four_times_as_fast(chip):
    chip.write_offsets(OFFSETS)
    chip.set_mode(FusionMode.NDOF, 0)
    assert scores(chip, FULL_US // 4) == (3, 3, 3, 3)
    chip.set_mode(0, FULL_US)
    assert chip.read_offsets() == OFFSETS


def test_offsets_are_learnt_with_full_scores_and_differ_between_chips():
    learnt = []
    for seed in (1, 2):
        chip = Chip(Random(seed), FULL_US)
        before = chip.read_offsets()
        chip.set_mode(FusionMode.NDOF, 0)
        chip.set_mode(0, FULL_US // 2)
        assert chip.read_offsets() == before
        chip.set_mode(FusionMode.NDOF, FULL_US // 2)
        chip.set_mode(0, FULL_US)
        learnt.append(chip.read_offsets())
        assert learnt[-1] != before
    assert learnt[0] != learnt[1]


def test_a_visit_to_config_mode_costs_no_scores(chip):
    chip.set_mode(FusionMode.NDOF, 0)
    chip.set_mode(0, FULL_US)
    assert scores(chip, FULL_US) == (0, 0, 0, 0)
    chip.set_mode(FusionMode.NDOF, FULL_US)
    assert scores(chip, FULL_US) == (3, 3, 3, 3)


def test_power_takes_everything_with_it(chip):
    chip.write_offsets(OFFSETS)
    chip.set_mode(FusionMode.NDOF, 0)
    chip.unplug()
    assert not chip.answers(10**9)
    chip.power_on(10**9)
    assert not chip.answers(10**9 + BOOT_US - 1)
    assert chip.answers(10**9 + BOOT_US)
    assert chip.mode == 0
    assert chip.read_offsets() != OFFSETS


def test_heading_is_new_after_power_on_in_imu_mode_only(chip):
    chip.set_mode(FusionMode.NDOF, 0)
    assert chip.heading == 0
    headings = set()
    for start_us in (10**6, 10**7):
        chip.power_on(start_us)
        chip.set_mode(FusionMode.IMU, start_us + BOOT_US)
        headings.add(chip.heading)
        chip.set_mode(0, start_us + 2 * BOOT_US)
        chip.set_mode(FusionMode.IMU, start_us + 2 * BOOT_US)
        headings.add(chip.heading)
    assert len(headings) == 2
