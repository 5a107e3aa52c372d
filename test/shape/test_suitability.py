"""Which model is said to suit: layouts whose errors are known, and what `check` prints."""

from dataclasses import replace

import pytest

from sesa2.configuration import files
from sesa2.configuration.description import describe
from sesa2.shape.arm import Arm
from sesa2.shape.layout import Layout
from sesa2.shape.suitability import suitability

EIGHT = tuple(0.08 * (i + 1) for i in range(8))


@pytest.mark.parametrize(
    ('positions', 'model', 'widest', 'too_few'),
    [
        (EIGHT, 'spline', 0.08, False),
        (EIGHT[1::2], 'smooth_rod', 0.16, False),
        ((0.24, 0.40, 0.64), 'smooth_rod', 0.24, False),
        ((0.32, 0.64), 'pcc_exact', 0.32, True),
        ((0.66,), 'pcc_exact', 0.66, True),
        (EIGHT[:3], 'pcc_exact', 0.42, True),  # nothing is known of the tip
        (EIGHT[:1] + EIGHT[2:], 'smooth_rod', 0.16, False),  # one gap is what counts
    ],
)
def test_the_widest_gap_decides(positions, model, widest, too_few):
    got = suitability(Layout(Arm(0.66), positions))
    assert got.model == model
    assert got.widest == pytest.approx(widest)
    assert got.too_few == too_few
    assert got.bends == len(positions)


@pytest.mark.parametrize(
    ('name', 'off', 'words'),
    [
        ('prototype3_8', (), 'spline (not in models) where the arm bends as a whole'),
        ('prototype3_8', (3,), 'smooth_rod (not in models) where the arm bends as a whole'),
        ('prototype3_4', (), 'more than 4 bends at once cannot be told'),
        ('prototype3_2_pcc', (), 'pcc_exact, but IMUs are too few'),
    ],
)
def test_check_says_so_of_the_imus_that_are_used(name, off, words):
    c = files.load_configuration(name)
    enabled = tuple(i not in off for i in range(len(c.imus.ids)))
    c = replace(c, imus=replace(c.imus, enabled=enabled))
    assert words in describe(c)
