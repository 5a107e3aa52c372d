"""Racks: motors against the step response of a lag, and how their teeth slip."""

from dataclasses import replace

import numpy as np
import pytest
from slipping_arms import IDEAL, THIRDS, tripods

from sesa2.plant.racks import Racks
from sesa2.sensing.lengths import BackboneLengths
from sesa2.shape.arm import GeometryError

REST = np.array([0.16])
STRAIGHT, BENT = np.zeros((1, 2)), np.array([[0.8, 0.6]])
SLIPPING = replace(IDEAL, slip=0.5, slip_spread=0.0, slip_bend=0.2, slip_reach=0.08)


def racks(options=IDEAL, backbones=None, rest=REST):
    options = replace(options, home=options.home or (0.12,))
    return Racks(backbones or tripods(len(rest)), rest, options, np.random.default_rng(1))


def test_a_motor_makes_a_step_as_a_lag_does():
    r = racks(replace(IDEAL, lag=0.15))
    for k in range(1, 31):
        r.move([0.13, 0.12, 0.11], 0.01, STRAIGHT)
        gone = 1.0 - np.exp(-k * 0.01 / 0.15)
        np.testing.assert_allclose(r.travelled, 0.12 + 0.01 * gone * np.array([1, 0, -1]), atol=1e-14)
    np.testing.assert_array_equal(r.engaged, r.travelled)


def test_a_motor_is_no_faster_than_it_can_and_stops_at_the_ends():
    r = racks(replace(IDEAL, rate=0.1, travel=(0.05, 0.2)))
    r.move([1.0, 0.0, 0.12], 0.5, STRAIGHT)
    np.testing.assert_allclose(r.travelled, [0.17, 0.07, 0.12])
    r.move([1.0, 0.0, 0.12], 5.0, STRAIGHT)
    np.testing.assert_allclose(r.travelled, [0.2, 0.05, 0.12])


def test_teeth_slip_the_more_the_arm_bends():
    lost = []
    for theta in (0.0, 0.1, 0.3, 1.2):
        r = racks(SLIPPING)
        r.move([0.121, 0.121, 0.121], 0.01, theta * BENT)
        np.testing.assert_allclose(r.travelled, 0.121)  # the encoders see nothing of it
        assert np.ptp(r.engaged) < 1e-15
        lost.append(1e3 * (r.travelled - r.engaged)[0])
    np.testing.assert_allclose(lost, 0.5 * -np.expm1(-np.array([0.0, 0.1, 0.3, 1.2]) / 0.2), atol=1e-12)


def test_slip_depends_on_the_way():
    """Grown straight it is as told, grown bent it is shorter; and there and back something is left."""
    r = racks(SLIPPING)
    for k in range(1, 101):
        r.move(np.full(3, 0.12 + 0.0005 * k), 0.01, STRAIGHT)
    np.testing.assert_allclose(r.engaged, 0.17, atol=1e-12)
    r = racks(SLIPPING)
    for k in range(1, 101):
        r.move(np.full(3, 0.12 + 0.0005 * k), 0.01, BENT)
    # d slip / d travel = σ (1 − slip / reach)
    share = 0.5 * -np.expm1(-1.0 / 0.2)
    np.testing.assert_allclose(0.17 - r.engaged, 0.08 * -np.expm1(-share * 0.05 / 0.08), rtol=3e-3)
    for k in range(1, 101):
        r.move(np.full(3, 0.17 - 0.0005 * k), 0.01, BENT)
    assert (r.travelled - r.engaged < -1e-3).all()


def test_never_does_all_of_a_motion_slip_nor_is_the_reach_left():
    r, rng = racks(replace(SLIPPING, slip=0.9, slip_reach=0.03)), np.random.default_rng(4)
    for command in rng.uniform(0.1, 0.3, (60, 3)):
        bends = rng.normal(0.0, 0.5, (1, 2))
        for _ in range(50):
            travelled, engaged = r.travelled.copy(), r.engaged.copy()
            r.move(travelled + np.clip(command - travelled, -0.001, 0.001), 0.01, bends)
            share = np.abs(r.engaged - engaged) - 0.1 * np.abs(r.travelled - travelled)
            assert (share > -1e-12).all()
            assert (np.abs(r.travelled - r.engaged) <= 0.031).all()
    assert np.abs(r.travelled - r.engaged).max() > 0.01


@pytest.mark.parametrize(
    ('options', 'backbones', 'said'),
    [
        ({}, BackboneLengths(1, 2, angles=[0.0, 2.0], radii=[0.03]), '2 racks on 1 segments'),
        ({}, BackboneLengths(1, 3, angles=[0.0, 0.0, 1.0], radii=[0.03]), '3 racks on 1 segments'),
        ({'home': (0.12, 0.13)}, None, 'home has 2 entries'),
        ({'home': (0.4,)}, None, 'home: backbone 0 begins at 0.4'),
        ({'travel': (0.3, 0.1)}, None, 'travel = '),
        ({'travel': (0.1,)}, None, 'travel = '),
    ],
)
def test_what_does_not_fit_is_refused(options, backbones, said):
    with pytest.raises(GeometryError, match=said):
        racks(replace(IDEAL, **options), backbones)


def test_a_rack_that_passes_several_segments_begins_and_ends_with_all_of_them():
    through = BackboneLengths(2, 6, [1, 1, 1, 2, 2, 2], [1], THIRDS * 2, [0.03])
    r = racks(replace(IDEAL, home=(0.12, 0.1), travel=(0.05, 0.34)), through, np.array([0.16, 0.16]))
    np.testing.assert_allclose(r.engaged, [0.12] * 3 + [0.22] * 3)
    np.testing.assert_allclose(r.limits, [[0.05] * 3 + [0.1] * 3, [0.34] * 3 + [0.68] * 3])
