"""What a layout tells, against magpylib's readings and what is known of the paper's layouts."""

import numpy as np
import pytest
from paper_arm import REAL, PaperArm

from sesa2.sensing.magnetometry.axial_field import AxialField
from sesa2.sensing.magnetometry.magnet_survey import survey_magnets
from sesa2.sensing.magnetometry.ring_magnet import RingMagnet


def drawn(arm):
    return arm.limits.draw(500, np.random.default_rng(0))


def test_readings_and_errors_are_those_of_magpylib():
    arm = PaperArm(1, noise=2e-6)
    survey, q = survey_magnets(arm.predictor), drawn(arm)
    u = arm.simulate(q)
    np.testing.assert_allclose(survey.largest, np.abs(u).max(axis=0), rtol=1e-6)
    np.testing.assert_allclose(survey.swing, np.ptp(u, axis=0), rtol=1e-6)
    steps = 1e-5 * arm.limits.scales
    J = np.stack(
        [(arm.simulate(q + step) - arm.simulate(q - step)) / (2.0 * step.sum()) for step in np.diag(steps)],
        axis=-1,
    )
    prior = np.diag(arm.limits.scales**-2.0)
    covariance = np.linalg.inv(np.swapaxes(J, 1, 2) @ J / 2e-6**2 + prior)
    expected = np.median(np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)), axis=0)
    np.testing.assert_allclose(survey.deviations, expected, rtol=1e-3)


def test_the_series_leaves_out_less_than_is_said():
    arm = PaperArm(1)
    assert np.abs(arm.predictor.predict(drawn(arm)).readings - arm.simulate(drawn(arm))).max() < 1e-10
    near = REAL.left_out(3, 0.03)
    r, a = np.array([[0.0, 0.0, 0.03]]), np.array([[0.0, 0.0, 1.0]])
    low, high = (_field(order, r, a) for order in (3, 13))
    assert 0.2 * near < np.linalg.norm(high - low) / np.linalg.norm(_field(1, r, a) / 2.0) < near


def _field(order, r, a):
    return AxialField(REAL.moments(order)[None], np.array([REAL.sphere])).field(r, a)


@pytest.mark.parametrize(
    ('layout', 'unseen'),
    [
        ({'segments': 1}, [(0.0, 0.055)]),
        ({}, [(0.0, 0.055)]),
        ({'segments': 1, 'kinematics': 'affine', 'bend_max': 2.6}, []),
        # 0.35 mT in its plane, over 40 is heard above ten times the noise, over 60 is not.
        ({'segments': 1, 'magnet': RingMagnet(0.006, 0.012, 0.006, 1.45 / 40)}, [(0.0, 0.055)]),
        ({'segments': 1, 'magnet': RingMagnet(0.006, 0.012, 0.006, 1.45 / 60)}, [(0.0, 0.11)]),
    ],
)
def test_stretches_without_magnet_and_sensor_on_either_side(layout, unseen):
    found = survey_magnets(PaperArm(**layout).predictor).unseen
    assert len(found) == len(unseen)
    np.testing.assert_allclose(np.reshape(found, (-1, 2)), np.reshape(unseen, (-1, 2)), atol=1e-9)


def test_two_sensors_a_segment_do_not_tell_the_bend_across():
    survey = survey_magnets(PaperArm(per_segment=2).predictor)
    assert survey.untold_share == 1.0
    assert survey.spare == -3
    assert {name for of in survey.untold for name in of.names} == {f'segment_{k}_bend_y' for k in (1, 2, 3)}


@pytest.mark.parametrize(
    ('layout', 'needed', 'spare'),
    [({}, 9, 0), ({'per_segment': 4}, 0, 3), ({'segments': 1, 'per_segment': 1, 'axes': 'xyz'}, 1, 0)],
)
def test_sensors_that_cannot_be_spared(layout, needed, spare):
    survey = survey_magnets(PaperArm(**layout).predictor)
    assert survey.untold == []
    assert (len(survey.needed), survey.spare) == (needed, spare)


def test_a_sensor_that_bending_brings_too_near():
    assert survey_magnets(PaperArm(1).predictor).too_near == []
    big = PaperArm(1, magnet=RingMagnet(0.0, 0.05, 0.02, 1.0))
    assert survey_magnets(big.predictor).too_near == [(0, 0), (1, 0), (2, 0)]
