"""The simulated arm with magnets: its fields against magpylib, how far it is off what was drawn, and its steps."""

from dataclasses import replace

import numpy as np
import pytest
from magnetic_bag import configuration
from paper_arm import PaperArm

from sesa2.errors import Sesa2Error
from sesa2.twin.magnetic_arm import MagneticArm

TIMES = np.linspace(0.0, 10.0, 60)


def fields_of(arm):
    q = arm.coordinates(TIMES)
    return q, np.array([arm.fields(one) for one in q])


def test_as_drawn_it_reads_what_magpylib_says_and_noise():
    pytest.importorskip('magpylib', reason='magpylib is not installed')
    q, fields = fields_of(MagneticArm(configuration(), build_errors=0.0))
    assert np.isnan(fields[..., :2]).all()
    off = fields[..., 2] - PaperArm(3, 4).simulate(q)
    # 0.7 µT of noise and steps of 61 nT.
    assert np.sqrt(np.mean(off**2)) == pytest.approx(0.7e-6, rel=0.1)
    steps = fields[..., 2] / (2.0 * 2.0e-3 / 2**16)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)


def test_it_stays_within_the_limits_and_goes_round():
    c = configuration()
    arm = MagneticArm(c)
    q = arm.coordinates(TIMES)
    bends = np.hypot(q[:, 0::3], q[:, 1::3])
    assert 0.7 < bends.max() < c.segments.bend_max
    stretch = q[:, 2::3] / 0.11
    assert 0.95 < stretch.min() < 1.0 < stretch.max() < 1.10
    np.testing.assert_allclose(q[0], q[-1], atol=1e-12)
    assert np.abs(np.diff(arm.coordinates(np.linspace(0.0, 10.0, 1001)), axis=0)).max() < 0.02


def test_build_errors_are_of_their_size_and_of_the_seed():
    def off(**options):
        return fields_of(MagneticArm(configuration(), **options))[1] - drawn

    drawn = fields_of(MagneticArm(configuration(), build_errors=0.0))[1]
    one = off()
    rms = np.sqrt(np.nanmean(one**2))
    assert 5e-6 < rms < 100e-6
    np.testing.assert_array_equal(one, off())
    assert np.nanmax(np.abs(one - off(seed=1))) > 5e-6
    assert 1.5 < np.sqrt(np.nanmean(off(build_errors=2.0) ** 2)) / rms < 2.5


def test_masked_ones_say_nothing_and_the_range_ends():
    c = configuration()
    c = replace(c, magnetometers=replace(c.magnetometers, masked=(3,), range=1.0e-3))
    _, fields = fields_of(MagneticArm(c, build_errors=0.0))
    assert np.isnan(fields[:, 2]).all()
    assert np.nanmax(np.abs(fields)) == 1.0e-3


def test_without_a_model_that_needs_them():
    c = replace(configuration(), models=('pcc',))
    with pytest.raises(Sesa2Error, match='expected magnetic'):
        MagneticArm(c)
