"""Samples whose messages carry no time."""

import struct

import numpy as np
import pytest
from made_samples import PERIOD_NS, make_samples, write_samples

from sesa2.bags.reading import ImuRecording, read_poses
from sesa2.bags.recorded_stamps import RecordedStamps
from sesa2.bags.recorded_sweeps import read_sweeps
from sesa2.bags.recording import open_recording
from sesa2.bags.replay import replay
from sesa2.bags.writing import new_bag
from sesa2.configuration import files, validate
from sesa2.messages.imu_messages import ImuMessages, read_imu


def arm(**imus):
    return validate(
        {
            'arm': {'length': 0.3},
            'imus': {'ids': [1, 2, 3], 'positions': [0.1, 0.2, 0.3], **imus},
            'markers': {'names': ['M'], 'positions': [0.3]},
            'models': ['pcc'],
        }
    )


def stamped(made, stamp_ns):
    """The same message, recorded when it was, with another stamp."""
    data = ImuMessages(made.topic.split('/')[-2]).make(stamp_ns, made.orientation)
    return made._replace(data=data)


def written(path, made):
    with new_bag(path) as bag:
        write_samples(bag, made)
    return path


def markers(path):
    return read_poses(path, 'pcc/markers')


def test_without_stamps_a_replay_is_that_of_the_times_of_recording(tmp_path):
    made = make_samples(40)
    right = written(tmp_path / 'right', made)
    zero = written(tmp_path / 'zero', [stamped(m, 0) for m in made])
    assert replay(right, arm(), tmp_path / 'a').warnings == []
    summary = replay(zero, arm(), tmp_path / 'b')
    assert summary.sweeps == 40
    assert summary.warnings == [
        'IMU 1, 2, 3: 120 messages have no stamp (0); the time of their recording stands in'
    ]
    for a, b in zip(markers(tmp_path / 'a')[:2], markers(tmp_path / 'b')[:2], strict=True):
        np.testing.assert_array_equal(a, b)
    # What was said of it is in the new bag, which is replayed without a word.
    assert replay(tmp_path / 'b', arm(), tmp_path / 'c').warnings == []


def test_one_imu_without_stamps_goes_with_the_others(tmp_path):
    made = [stamped(m, 0) if 'imu_2' in m.topic else m for m in make_samples(40)]
    summary = replay(written(tmp_path / 'in', made), arm(), tmp_path / 'out')
    assert (summary.sweeps, summary.partial) == (40, 0)
    assert summary.warnings == ['IMU 2: 40 messages have no stamp (0); the time of their recording stands in']


def test_alignment_takes_them_too(tmp_path):
    made = [stamped(m, 0) for m in make_samples(40)]
    sweeps = read_sweeps(written(tmp_path / 'in', made), arm())
    assert len(sweeps.stamps_ns) == 40
    assert set(np.diff(sweeps.stamps_ns)) == {PERIOD_NS}
    assert any('have no stamp' in problem for problem in sweeps.problems)


def test_arrival_stands_for_all_where_it_is_asked_for(tmp_path):
    """Stamps that mean nothing: seconds since each sensor's own start, all the same."""
    made = make_samples(40)
    odd = written(tmp_path / 'in', [stamped(m, 77) for m in made])
    summary = replay(odd, arm(stamps='arrival'), tmp_path / 'out')
    assert summary.sweeps == 40
    assert summary.warnings == []
    with open_recording(odd) as recording:
        samples = list(ImuRecording(recording, arm(stamps='arrival')).samples())
    assert [s.stamp_ns for s in samples] == [m.stamp_ns for m in made]
    assert [read_imu(s.data).stamp_ns for s in samples] == [m.stamp_ns for m in made]


def test_messages_of_either_byte_order_get_their_stamp():
    little = ImuMessages('imu_1').make(0, np.array([0.0, 0.6, 0.0, 0.8]))
    at = 4 + (12 + len('imu_1') + 1 + 7) // 8 * 8
    floats = struct.unpack_from('<37d', little, at)
    big = b'\0\0\0\0' + struct.pack('>iII', 0, 0, 6) + little[16:at] + struct.pack('>37d', *floats)
    data, stamps = [little, big], np.zeros(2, np.int64)
    log_ns = np.array([1_700_000_000_000_000_001, 1_700_000_000_999_999_999])
    RecordedStamps().complete(np.array([1, 1]), stamps, log_ns, data)
    assert stamps.tolist() == log_ns.tolist()
    for message, log in zip(data, log_ns, strict=True):
        assert read_imu(message) == (log, 0.0, 0.6, 0.0, 0.8)


def test_the_case(cases, tmp_path):
    configuration = files.load(files.find('prototype3_4'))
    summary = replay(cases / '02-stamp-zero/bag', configuration, tmp_path / 'out', models=['pcc'])
    assert summary.sweeps == 60
    assert round(summary.duration, 1) == 0.6
    [warning] = summary.warnings
    assert warning == 'IMU 2, 4, 6, 8: 240 messages have no stamp (0); the time of their recording stands in'
    whole, piece = read_poses(cases / '00-common/est10', 'pcc/markers'), markers(tmp_path / 'out')
    nearest = np.abs(whole.times_s - piece.times_s[:, None]).argmin(axis=1)
    np.testing.assert_allclose(whole.positions[nearest], piece.positions, atol=2e-3)


def test_a_recording_that_begins_at_0_lacks_no_stamp():
    stamps = RecordedStamps()
    stamps_ns = np.array([0, 5])
    stamps.complete(np.array([1, 1]), stamps_ns, np.array([0, 5]), [b'', b''])
    assert stamps_ns.tolist() == [0, 5]
    assert stamps.problems == []


def stepping(step_ns, n=200, apart_ns=10_000_000, repeat=1):
    """What is said of one IMU whose stamps step by so much, and whose messages came so far apart."""
    stamps = RecordedStamps()
    at = np.arange(n) // repeat
    for half in np.array_split(np.arange(n), 2):
        log_ns = 10**18 + np.arange(n)[half] * apart_ns // repeat
        stamps.complete(np.ones(len(half), int), 10**18 + at[half] * step_ns, log_ns, [b''] * len(half))
    return stamps.problems


@pytest.mark.parametrize('step_ns', [10_000, 10, 0, 10_000_000_000])
def test_stamps_of_another_unit_are_named(step_ns):
    (problem,) = stepping(step_ns)
    assert f'IMU 1: its stamps step by {step_ns / 1e9:.2g} s and its messages came every 0.01 s' in problem
    assert 'imus.stamps: arrival' in problem


@pytest.mark.parametrize('step_ns', [1_000_000, 10_000_000, 100_000_000])
@pytest.mark.parametrize('repeat', [1, 2])
def test_played_faster_or_slower_or_twice_they_are_sound(step_ns, repeat):
    assert stepping(step_ns, repeat=repeat) == []


def test_a_few_messages_or_all_recorded_at_once_tell_nothing():
    assert stepping(10, n=20) == []
    assert stepping(10, apart_ns=0) == []
