import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.estimation.stuck import StuckWatch, stuck_spans

RATE = 50.0


def turning(seconds=10.0, n_imu=4, degrees=30.0):
    """IMUs that swing ± so far within 4 s, the first hardly."""
    t = np.arange(0.0, seconds, 1.0 / RATE)
    angles = np.deg2rad(degrees) * np.sin(0.5 * np.pi * t)[:, None] * np.linspace(0.1, 1.0, n_imu)
    q = Rotation.from_rotvec(angles.reshape(-1, 1) * (1.0, 0.0, 0.0)).as_quat().reshape(len(t), n_imu, 4)
    return t, q, np.ones((len(t), n_imu), bool)


def held(q, t, imu, begin, end):
    inside = (t >= begin) & (t < end)
    q = q.copy()
    q[inside, imu] = q[np.argmax(inside), imu]
    return q


def watched(t, q, there, block=30):
    watch = StuckWatch(q.shape[1])
    for k in range(0, len(t), block):
        watch.add(t[k : k + block], q[k : k + block], there[k : k + block])
    watch.end()
    return watch.seconds


def test_nobody_is_stuck_who_turns():
    t, q, there = turning()
    assert stuck_spans(t, q, there) == [[], [], [], []]
    assert not watched(t, q, there).any()


def test_a_stuck_imu_is_found_live_and_afterwards():
    t, q, there = turning()
    q = held(q, t, 2, 3.0, 6.6)
    assert stuck_spans(t, q, there) == [[], [], [pytest.approx((3.0, 6.58))], []]
    assert watched(t, q, there) == pytest.approx([0.0, 0.0, 3.58, 0.0], abs=0.15)


def test_an_arm_that_rests_is_not_stuck():
    t, q, there = turning()
    for imu in range(4):
        q = held(q, t, imu, 3.0, 7.0)
    assert stuck_spans(t, q, there) == [[], [], [], []]
    assert not watched(t, q, there).any()


def test_a_little_turning_beside_it_proves_nothing():
    t, q, there = turning(degrees=7.0)
    q = held(q, t, 2, 3.0, 7.0)
    assert stuck_spans(t, q, there)[2] == []
    assert not watched(t, q, there).any()


def test_samples_that_were_not_measured_are_neither_equal_nor_turned():
    t, q, there = turning()
    gone = (t >= 3.0) & (t < 7.0)
    q[gone, 2] = (0.0, 0.0, 0.0, 1.0)  # what stands at an IMU that has not measured means nothing
    there[gone, 2] = False
    assert stuck_spans(t, q, there)[2] == []
    assert not watched(t, q, there).any()


def test_parts_are_judged_each_by_itself():
    t, q, there = turning()
    q = held(q, t, 2, 5.0, 10.0)
    watch = StuckWatch(4)
    for _ in range(2):
        watch.add(t, q, there)
        watch.end()
    assert watch.seconds == pytest.approx([0.0, 0.0, 10.0, 0.0], abs=0.3)
    watch.add(t[:5], q[:5], there[:5])
    watch.end()
    watch.end()
    assert watch.seconds[2] == pytest.approx(10.0, abs=0.3)


def test_what_was_between_two_parts_is_not_known():
    """The same quaternion at the end of one part and at the beginning of the next, a minute later."""
    t, q, there = turning()
    q = held(q, t, 2, 4.0, 6.5)
    assert [len(spans) for spans in stuck_spans(t, q, there)] == [0, 0, 1, 0]
    assert stuck_spans(np.where(t >= 5.2, t + 60.0, t), q, there) == [[], [], [], []]
