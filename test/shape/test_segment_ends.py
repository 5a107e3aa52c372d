"""Which IMUs feel the ends of segments; what is between is interpolated as scipy does, and said."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from sesa2.configuration import validate
from sesa2.configuration.description import describe
from sesa2.shape.arm import Arm
from sesa2.shape.layout import Layout
from sesa2.shape.segment_ends import SegmentEnds


def some_stations(n):
    return np.swapaxes(Rotation.random(5 * n, random_state=2).as_quat().reshape(n, 5, 4), 0, 1)


def test_without_segments_each_section_is_one():
    ends = SegmentEnds(Layout(Arm(0.5), (0.1, 0.3, 0.5)))
    np.testing.assert_allclose(ends.lengths, [0.1, 0.2, 0.2])
    stations = some_stations(4)
    assert ends.orientations(stations) is stations
    assert ends.doubts == ()
    assert ends.inner == ()


def test_past_the_last_imu_the_orientation_is_held():
    ends = SegmentEnds(Layout(Arm(0.6), (0.1, 0.3, 0.5)))
    np.testing.assert_allclose(ends.lengths, [0.1, 0.2, 0.2, 0.1])
    stations = some_stations(4)
    np.testing.assert_array_equal(ends.orientations(stations)[:, :4], stations)
    np.testing.assert_array_equal(ends.orientations(stations)[:, 4], stations[:, 3])


def test_an_imu_within_5_mm_of_an_end_feels_it():
    ends = SegmentEnds(Layout(Arm(0.4), (0.105, 0.3, 0.395), (0.1, 0.3)))
    stations = some_stations(4)
    np.testing.assert_array_equal(ends.orientations(stations), stations[:, [0, 1, 3]])
    assert ends.doubts == ()
    ((segment, station, fraction),) = ends.inner
    assert (segment, station) == (1, 2)
    assert fraction == pytest.approx(2.0 / 3.0)


def test_an_end_that_no_imu_feels_is_interpolated_and_said():
    ends = SegmentEnds(Layout(Arm(0.4), (0.08, 0.2, 0.38), (0.11, 0.29)))
    stations = some_stations(4)
    got = ends.orientations(stations)
    for row, expected in zip(got, stations, strict=True):
        between = Slerp([0.08, 0.2], Rotation.from_quat(expected[1:3]))(0.11)
        np.testing.assert_allclose((Rotation.from_quat(row[1]).inv() * between).magnitude(), 0.0, atol=1e-12)
        held = Rotation.from_quat(row[2]).inv() * Rotation.from_quat(expected[3])
        np.testing.assert_allclose(held.magnitude(), 0.0, atol=1e-12)
    assert ends.doubts == (
        'segment 1 ends at 0.11 m, where no IMU is (the nearest is at 0.08 m): interpolated',
        'segment 2 ends at 0.4 m, where no IMU is (the nearest is at 0.38 m): taken as straight past the last IMU',
    )
    assert [i.segment for i in ends.inner] == [0, 1, 1]


def test_an_imu_at_the_base_is_not_used_and_said():
    ends = SegmentEnds(Layout(Arm(0.2), (0.004, 0.2), (0.2,)))
    stations = some_stations(3)
    np.testing.assert_array_equal(ends.orientations(stations), stations[:, [0, 2]])
    assert ends.doubts == ('the IMU at 0.004 m is at the base of segment 1 and is not used',)
    assert ends.inner == ()


def test_check_says_so():
    c = validate(
        {
            'arm': {'length': 0.4},
            'segments': {'lengths': [0.11, 0.29]},
            'imus': {'ids': [1, 2], 'positions': [0.08, 0.4]},
            'models': ['pcc_delta'],
        }
    )
    text = describe(c)
    assert (
        '  pcc_delta: segment 1 ends at 0.11 m, where no IMU is (the nearest is at 0.08 m): interpolated'
        in text
    )
    assert 'pcc_delta/joint_states, coordinates, markers, tip, shape' in text
