"""Errors step by step are those of the error model, which makes them all at once."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sesa2.sensing.imu.error_model import Bno055Errors
from sesa2.sensing.imu.error_process import ErrorProcess
from sesa2.shape.rotations import conjugate, multiply, to_rotation_vector

STRAIGHT = np.tile([0.0, 0.0, 0.0, 1.0], (4, 1))


def test_without_errors_the_truth_is_measured():
    process = ErrorProcess(Bno055Errors().times(0.0).only(), 4, np.random.default_rng(0))
    process.advance(0.1)
    assert_allclose(process.measured(STRAIGHT), STRAIGHT)


@pytest.mark.parametrize('dt', [0.05, 0.4])
def test_what_wanders_has_the_size_and_the_time_of_the_model_at_any_step(dt):
    errors = Bno055Errors(heading=0.0, heading_wander=0.1, heading_time=2.0, tilt=0.05, tilt_time=1.0)
    process = ErrorProcess(errors, 400, np.random.default_rng(1))
    before = process.headings, process.tilts
    for _ in range(round(2.0 / dt)):
        process.advance(dt)
    for a, b, size, kept in (
        (before[0], process.headings, 0.1, np.exp(-1.0)),
        (before[1].ravel(), process.tilts.ravel(), 0.05, np.exp(-2.0)),
    ):
        assert np.std(b) == pytest.approx(size, rel=0.1)
        assert np.corrcoef(a, b)[0, 1] == pytest.approx(kept, abs=0.1)


def test_each_error_acts_where_the_model_has_it():
    link = np.tile([0.5, -0.5, 0.5, 0.5], (4, 1))
    process = ErrorProcess(Bno055Errors(white=0.0, tilt=0.0, step=0.0), 4, np.random.default_rng(2))
    turned = multiply(conjugate(link), process.measured(link))
    assert np.abs(to_rotation_vector(turned)).max() > 0.01
    headed = multiply(_about_z(process.headings), link)
    mounted = to_rotation_vector(multiply(conjugate(headed), process.measured(link)))
    assert_allclose(mounted, process.mountings, atol=1e-12)


def _about_z(angles):
    q = np.zeros((len(angles), 4))
    q[:, 2], q[:, 3] = np.sin(angles / 2.0), np.cos(angles / 2.0)
    return q


def test_noise_is_fresh_at_each_call():
    process = ErrorProcess(Bno055Errors().only('noise'), 4, np.random.default_rng(3))
    rows = to_rotation_vector(process.measured(np.broadcast_to(STRAIGHT, (2000, 4, 4))))
    assert_allclose(rows.std(axis=(0, 1)), np.deg2rad(0.2), rtol=0.05)
    assert (process.measured(STRAIGHT) != process.measured(STRAIGHT)).any()


def test_times_scales_angles_alone():
    twice, once = Bno055Errors().times(2.0), Bno055Errors()
    assert (twice.mounting, twice.white) == (2.0 * once.mounting, 2.0 * once.white)
    assert (twice.latency, twice.tilt_time, twice.step) == (once.latency, once.tilt_time, once.step)
