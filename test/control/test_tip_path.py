"""Over which points the tip is led."""

import numpy as np
import pytest
from looped_arm import racks

from sesa2.control.reach import Reach
from sesa2.control.tip_path import TipPath

DT, SPEED = 0.01, 0.12
TARGET = np.array([0.09, 0.0, 0.14])
BENT = np.array([0.0, 0.8, 0.13])


@pytest.fixture
def reach():
    return Reach([0.16], racks(1), 1.6, (0.75, 1.5), (0.05, 0.34))


def led(path, reached, tip, command=BENT, seconds=20.0, follows=True):
    """The points it is led to, and when."""
    points, t = [], 0.0
    for _ in range(round(seconds / DT)):
        point = path.point(reached, tip, command, DT)
        if not points or not np.array_equal(point, points[-1][1]):
            points.append((t, point))
        if follows:
            away = point - tip
            tip = tip + away * min(1.0, SPEED * DT / max(np.linalg.norm(away), 1e-12))
        t += DT
    return points


def test_direct_is_the_target_at_once(reach):
    reached = reach.nearest(TARGET)
    assert [t for t, _ in led(TipPath(False, reach, SPEED), reached, reach.tip(BENT))] == [0.0]


def test_unbent_is_straight_as_it_is_straight_as_it_will_be_and_the_target(reach):
    reached = reach.nearest(TARGET)
    points = [p for _, p in led(TipPath(True, reach, SPEED), reached, reach.tip(BENT))]
    np.testing.assert_allclose(points, [[0, 0, 0.13], [0, 0, reached.coordinates[2]], TARGET], atol=1e-9)


def test_a_target_as_far_along_the_arm_is_gone_to_at_once(reach):
    reached = reach.nearest(reach.tip([0.8, 0.0, 0.132]))
    points = led(TipPath(True, reach, SPEED), reached, reach.tip(BENT))
    np.testing.assert_allclose([p for _, p in points], [reached.point], atol=1e-9)


def test_points_on_the_way_lie_within_the_limits(reach):
    reached = reach.nearest(TARGET)
    points = led(TipPath(True, reach, SPEED), reached, reach.tip(BENT), command=np.array([0.0, 2.5, 0.30]))
    np.testing.assert_allclose(points[0][1], [0, 0, 0.24], atol=1e-9)


def test_what_is_on_the_way_and_is_not_reached_stops_nobody(reach):
    reached = reach.nearest(TARGET)
    points = led(TipPath(True, reach, SPEED), reached, reach.tip(BENT), follows=False)
    np.testing.assert_allclose(points[-1][1], TARGET, atol=1e-9)
    assert 4.0 < points[-1][0] < 7.0


def test_a_new_target_is_a_new_way(reach):
    path = TipPath(True, reach, SPEED)
    led(path, reach.nearest(TARGET), reach.tip(BENT))
    there = reach.nearest([0.0, 0.06, 0.2])
    points = led(path, there, TARGET, command=reach.nearest(TARGET).coordinates)
    assert len(points) == 3
    np.testing.assert_allclose(points[-1][1], there.point, atol=1e-9)
