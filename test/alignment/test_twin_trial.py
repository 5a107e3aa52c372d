"""The figures on a simulated trial with a BNO055's errors (data of the project, not part of the package)."""

from typing import NamedTuple

import numpy as np
import pytest

from sesa2.alignment.heading_filter import HeadingFilter
from sesa2.alignment.self_calibration import self_calibrate
from sesa2.sensing.imu.mounting import Mounting
from sesa2.shape.arm import Arm
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model
from sesa2.shape.rotations import IDENTITY

LAYOUT = Layout(Arm(0.66), (0.08, 0.16, 0.24, 0.32, 0.40, 0.48, 0.56, 0.64))
MARKERS = np.array([0.36, 0.60])
DELAY = 0.02


class Trial(NamedTuple):
    stamps: np.ndarray
    raw: np.ndarray
    true: np.ndarray
    truth_stamps: np.ndarray
    truth: np.ndarray


@pytest.fixture(scope='module')
def trial(recordings):
    file = recordings / 'twin/trial_A_bno055_seed1.npz'
    if not file.is_file():
        pytest.skip(f'no {file}')
    with np.load(file) as data:
        raw, true = (data[name].astype(float)[:, 1:, [1, 2, 3, 0]] for name in ('q', 'qtrue'))
        return Trial(data['ti'], raw, true, data['t100'], data['M100'].astype(float))


@pytest.fixture(scope='module')
def calibrated(trial):
    everything = np.ones(trial.raw.shape[:2], bool)
    found = self_calibrate(
        trial.stamps, trial.raw, everything, LAYOUT, IDENTITY, np.tile(IDENTITY, (8, 1)), np.zeros(8)
    )
    assert found.told.all()
    return Mounting(found.mountings, found.headings).link_orientations(trial.raw)


def median_error(trial, links, name='spline', **options):
    """Median distance to the markers in per cent of their arc length, (2,)."""
    points = create_model(name, LAYOUT, **options).fit(Measured(links)).positions(MARKERS)
    at = trial.stamps - DELAY
    inside = (at >= trial.truth_stamps[0]) & (at <= trial.truth_stamps[-1])
    truth = np.stack(
        [[np.interp(at[inside], trial.truth_stamps, trial.truth[:, m, k]) for k in range(3)] for m in (0, 1)]
    ).transpose(2, 0, 1)
    return 100.0 * np.median(np.linalg.norm(points[inside] - truth, axis=-1), axis=0) / MARKERS


def test_without_errors_the_spline_is_nearly_exact(trial):
    assert (median_error(trial, trial.true) <= [0.42, 0.38]).all()


def test_raw(trial):
    assert (median_error(trial, trial.raw) <= [1.9, 1.4]).all()


def test_after_self_calibration(trial, calibrated):
    assert (median_error(trial, calibrated) <= [1.2, 1.0]).all()
    assert (median_error(trial, calibrated, 'pcc', segments=[2] * 8) <= [1.95, 1.65]).all()


def test_with_the_heading_filter(trial, calibrated):
    everything = np.ones(trial.raw.shape[:2], bool)
    filtered = HeadingFilter(LAYOUT).correct(trial.stamps, calibrated, everything, IDENTITY)
    assert (median_error(trial, filtered) <= [1.1, 0.95]).all()
