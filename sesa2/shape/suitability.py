"""Which model suits an arm, by the number and spacing of its IMUs."""

from typing import NamedTuple

import numpy as np

from sesa2.shape.layout import Layout

# Widest gap, as a fraction of the arm. On a simulated passive arm that bends two or three times at once the sensors'
# errors outweigh the model's up to the first (8 IMUs, gaps of 12 %); up to the second `smooth_rod` errs least (4 IMUs,
# 24 %: 1.0 %; 3 IMUs, 36 %: 3 %); beyond, all models err by 8 % or more (2 IMUs, 48 %).
_CLOSE = 0.15
_WIDE = 0.40


class Suitability(NamedTuple):
    """What suits an arm.

    Attributes
    ----------
    model
        for an arm that bends as a whole.
    widest : m
        the longest piece of the arm without an IMU or the base in it.
    bends
        as many bends at once can be told at most; an S has two.
    too_few
        whether the arm may bend unseen: no model is good unless it bends one way only between IMUs.
    """

    model: str
    widest: float
    bends: int
    too_few: bool


def suitability(layout: Layout) -> Suitability:
    """Judge a layout with at least one IMU; the piece beyond the last IMU counts as others do."""
    gaps = np.diff([*layout.stations, layout.arm.length])
    widest = float(gaps.max())
    share = widest / layout.arm.length - 1e-9
    model = 'spline' if share <= _CLOSE else 'smooth_rod' if share <= _WIDE else 'pcc_exact'
    return Suitability(model, widest, layout.n_imu, share > _WIDE)
