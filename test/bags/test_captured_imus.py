from pathlib import Path

import numpy as np
import pytest

from sesa2.bags.captured_imus import CapturedImus
from sesa2.bags.recording import open_recording
from sesa2.errors import Sesa2Error
from sesa2.messages.imu_messages import read_imu
from sesa2.mocap.capture import MotionCapture, TrackedBody


def body(times, *, seen=None):
    q = np.random.default_rng(len(times)).normal(size=(len(times), 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    if seen is not None:
        q[~np.array(seen)] = np.nan
    return TrackedBody(np.array(times, float), None, q)


def imus(**bodies):
    notes = ('said',)
    return CapturedImus(
        Path('take.csv'), MotionCapture('CSV', {n.replace('__', ':'): b for n, b in bodies.items()}, notes)
    )


def test_messages_in_order_of_time():
    one, two = body([1.0, 1.5, 2.0], seen=[True, False, True]), body([2.0, 1.0, 1.25])
    part = imus(imu_2=one, Arm__IMU_4=two, tip=body([0.0]))
    assert {name: topic.count for name, topic in part.topics.items()} == {'/imu_2/data': 2, '/imu_4/data': 3}
    messages = list(part.messages(part.topics))
    assert [(m.topic[5], m.log_ns) for m in messages] == [
        ('2', 10**9), ('4', 10**9), ('4', 1_250_000_000), ('2', 2 * 10**9), ('4', 2 * 10**9),
    ]  # fmt: skip
    expected = [
        one.orientations[0],
        two.orientations[1],
        two.orientations[2],
        one.orientations[2],
        two.orientations[0],
    ]
    read = [read_imu(m.data) for m in messages]
    np.testing.assert_allclose([r[1:5] for r in read], expected)
    assert [r[0] for r in read] == [m.log_ns for m in messages]
    assert [m.topic for m in part.messages(['/imu_4/data'])] == ['/imu_4/data'] * 3
    assert list(part.messages([])) == []
    assert part.problems == ['said']


def test_more_than_are_made_at_once():
    part = imus(imu_1=body(np.arange(6000) / 100.0), imu_2=body(np.arange(5000) / 100.0))
    stamps = [m.log_ns for m in part.messages(part.topics)]
    assert len(stamps) == 11_000
    assert (np.diff(stamps) >= 0).all()


@pytest.mark.parametrize(('start', 'shift'), [(-0.3, 1), (-2.0, 3), (0.0, 0)])
def test_times_before_zero_are_moved_and_said(start, shift):
    part = imus(imu_1=body([start, start + 0.01]), imu_2=body([start, start + 0.01]))
    stamps = [m.log_ns for m in part.messages(part.topics)]
    np.testing.assert_allclose(np.array(stamps) / 1e9, [start + shift] * 2 + [start + shift + 0.01] * 2)
    assert any(f'moved by {shift} s' in problem for problem in part.problems) == bool(shift)


@pytest.mark.parametrize(
    ('bodies', 'message'),
    [
        (
            {'M1': body([0.0])},
            'no body is an IMU, expected names imu_<id>; there are M1: rename in the file',
        ),
        ({'imu_2': body([0.0]), 'Arm__imu_2': body([0.0])}, 'imu_2 and Arm:imu_2 are both IMU 2'),
        ({'imu_2': TrackedBody(np.zeros(1), np.zeros((1, 3)))}, 'imu_2 has no orientation, .*; said'),
    ],
)
def test_refused(bodies, message):
    with pytest.raises(Sesa2Error, match=message):
        imus(**bodies)


@pytest.mark.parametrize('name', ['imu_2_quat', 'imu_2.orientation', 'Arm:IMU 2 Rotation', 'imu2_q'])
def test_what_of_an_imu_it_is_may_stand_in_its_name(name):
    part = CapturedImus(Path('take.csv'), MotionCapture('x', {name: body([0.0])}))
    assert list(part.topics) == ['/imu_2/data']


def test_a_trajectory_that_is_named_after_its_imu_is_a_recording(tmp_path):
    path = tmp_path / 'imu_2.tum'
    path.write_text('5.0 0 0 0 0.6 0 0 0.8\n5.1 0 0 0 0.6 0 0 0.8\n')
    with open_recording(path) as recording:
        assert {name: topic.count for name, topic in recording.topics.items()} == {'/imu_2/data': 2}
