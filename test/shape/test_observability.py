"""Directions that sensors do not tell."""

import numpy as np
import pytest
from paper_arm import PaperArm

from sesa2.shape.coordinate_fit import CoordinateFit
from sesa2.shape.observability import untold_directions


def untold(arm, readings_off=()):
    q = arm.limits.kinematics.rest
    u = arm.predictor.predict(q).readings
    u[list(readings_off)] = np.nan
    fitted = CoordinateFit(arm.predictor).fit(u)
    return untold_directions(fitted.information, arm.limits.kinematics.coordinate_names)


@pytest.mark.parametrize('arm', [PaperArm(3), PaperArm(1, 1, axes='xyz'), PaperArm(1, kinematics='affine')])
def test_enough_sensors_tell_everything(arm):
    assert untold(arm) == []


def test_two_sensors_opposite_each_other_do_not_tell_y():
    directions = untold(PaperArm(3, 2))
    assert {d.names for d in directions} == {
        ('segment_1_bend_y',),
        ('segment_2_bend_y',),
        ('segment_3_bend_y',),
    }
    for d in directions:
        assert d.left > 0.999
        assert np.linalg.norm(d.direction) == pytest.approx(1.0)


def test_a_sensor_less_than_needed():
    directions = untold(PaperArm(3), readings_off=[8])
    assert len(directions) == 1
    assert directions[0].names[0].startswith('segment_3')
    assert untold(PaperArm(3, 4), readings_off=[3, 7, 11]) == []


def test_no_readings_tell_nothing():
    directions = untold(PaperArm(1), readings_off=[0, 1, 2])
    assert [d.left for d in directions] == [1.0, 1.0, 1.0]
