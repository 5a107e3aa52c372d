"""Lengths in recordings of every kind, put to the sweeps: against numpy.interp."""

import numpy as np
import pytest
from growing_arm import (
    IDS,
    MS,
    NAMES,
    VALUES,
    length_message,
    lengths_at,
    orientations_at,
    write_growing,
)
from made_bags import T0, cut
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.typesys import Stores, get_typestore

from sesa2.bags.reading import ImuRecording
from sesa2.bags.recorded_sweeps import read_sweeps
from sesa2.bags.recording import open_recording
from sesa2.configuration import validate
from sesa2.errors import Sesa2Error
from sesa2.messages.imu_messages import TYPE as IMU
from sesa2.messages.length_messages import LENGTHS_TYPE

SWEEPS = np.arange(0.0, 4000.0, 10.0)
SAMPLES = np.arange(-16.0, 4016.0, 8.0)


@pytest.fixture(scope='module')
def c():
    return validate(VALUES)


def expected_at(stamps_ns, samples=SAMPLES):
    t = (stamps_ns - T0) / MS
    return np.stack([np.interp(t, samples, column) for column in lengths_at(samples).T], axis=-1)


def check(recording, c):
    sweeps = read_sweeps(recording, c)
    assert len(sweeps.stamps_ns) == len(SWEEPS)
    np.testing.assert_allclose(sweeps.lengths, expected_at(sweeps.stamps_ns), atol=1e-9)
    assert not sweeps.problems
    return sweeps


def test_a_bag(c, tmp_path):
    check(write_growing(tmp_path / 'bag', SWEEPS, SAMPLES), c)


def test_a_configuration_without_lengths_does_not_see_them(tmp_path):
    bag = write_growing(tmp_path / 'bag', SWEEPS, SAMPLES)
    values = {k: v for k, v in VALUES.items() if k != 'lengths'}
    sweeps = read_sweeps(bag, validate(values))
    assert len(sweeps.stamps_ns) == len(SWEEPS)
    assert sweeps.lengths is None


def test_alignment_needs_no_lengths(c, tmp_path):
    bag = write_growing(tmp_path / 'bag', SWEEPS, [])
    assert len(read_sweeps(bag, c).stamps_ns) == len(SWEEPS)


def test_parts_of_the_names_from_several_publishers(c, tmp_path):
    also = []
    for t in SAMPLES:
        also += [
            (t + 1, length_message(t, names=('tip_r', 'axis'))),
            (t + 2, length_message(t, names=('tip_l',))),
        ]
    check(write_growing(tmp_path / 'bag', SWEEPS, [], also=also), c)


def test_a_bag_that_was_cut_short_gives_what_is_there(c, tmp_path):
    bag = cut(
        write_growing(tmp_path / 'bag', np.arange(0.0, 60_000.0, 10.0), np.arange(-16.0, 60_016.0, 8.0))
    )
    sweeps = read_sweeps(bag, c)
    assert len(sweeps.stamps_ns) > 1000
    known = ~np.isnan(sweeps.lengths).any(axis=1)
    assert known[:-50].all()
    np.testing.assert_allclose(
        sweeps.lengths[:-50], expected_at(sweeps.stamps_ns, np.arange(-16.0, 60_016.0, 8.0))[:-50], atol=1e-9
    )


def test_a_bag_of_ros_1(c, tmp_path):
    """As rosbags writes it; its messages are in the order of ROS 1."""
    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types

    def header(t, k=0):
        stamp = T0 + round(t * MS) + k * MS
        time = types['builtin_interfaces/msg/Time'](sec=stamp // 10**9, nanosec=stamp % 10**9)
        return types['std_msgs/msg/Header'](seq=0, stamp=time, frame_id='')

    def imu(t, k):
        q, three, nine = orientations_at(t)[k], types['geometry_msgs/msg/Vector3'](0, 0, 0), np.zeros(9)
        quaternion = types['geometry_msgs/msg/Quaternion'](*q)
        return types[IMU](header(t, k), quaternion, nine, three, nine, three, nine)

    def lengths(t):
        none = np.zeros(0)
        return types[LENGTHS_TYPE](header(t), list(NAMES), lengths_at(t), none, none)

    path = tmp_path / 'growing.bag'
    with Rosbag1Writer(path) as bag:
        topics = [bag.add_connection(f'/arm/imu_{i}/data', IMU, typestore=store) for i in IDS]
        of_lengths = bag.add_connection('/arm/backbone_lengths', LENGTHS_TYPE, typestore=store)
        entries = [(t + 1.5 + k, topics[k], IMU, imu(t, k)) for t in SWEEPS for k in range(2)]
        entries += [(t + 0.5, of_lengths, LENGTHS_TYPE, lengths(t)) for t in SAMPLES]
        for t, connection, kind, message in sorted(entries, key=lambda entry: entry[0]):
            bag.write(connection, T0 + round(t * MS), store.serialize_ros1(message, kind))
    check(path, c)


def test_messages_without_a_stamp_have_that_of_their_recording(c, tmp_path):
    also = [(t, length_message(-T0 / MS, values=lengths_at(t), start_ns=T0)) for t in SAMPLES]
    sweeps = read_sweeps(write_growing(tmp_path / 'bag', SWEEPS, [], also=also), c)
    np.testing.assert_allclose(sweeps.lengths, expected_at(sweeps.stamps_ns), atol=1e-9)
    assert sweeps.problems == [
        f'lengths: {len(SAMPLES)} messages have no stamp (0); the time of their recording stands in'
    ]


def test_what_is_refused_is_counted_and_the_rest_is_used(c, tmp_path):
    bad = [
        (500.1, length_message(500.0)[:60]),
        (500.2, length_message(500.0, values=[0.1, np.nan, 0.1])),
        (500.3, length_message(500.0, values=[0.1, -0.1, 0.1])),
        (1500.1, length_message(100.0)),
        (1500.2, length_message(1e6)),
    ]
    sweeps = read_sweeps(write_growing(tmp_path / 'bag', SWEEPS, SAMPLES, also=bad), c)
    np.testing.assert_allclose(sweeps.lengths, expected_at(sweeps.stamps_ns), atol=1e-9)
    told = '\n'.join(sweeps.problems)
    assert '1 messages not used: cut short' in told
    assert '2 messages not used: with a length that is no positive number: [0.1, nan, 0.1]' in told
    for name in NAMES:
        assert f'{name}: 1 samples not used: stamped long before the rest' in told
        assert f'{name}: 1 samples not used: stamped long after the rest' in told


def test_a_gap_is_none_and_told(c, tmp_path):
    there = [t for t in SAMPLES if not 1000.0 < t < 2600.0]
    sweeps = read_sweeps(write_growing(tmp_path / 'bag', SWEEPS, there), c)
    t = (sweeps.stamps_ns - T0) / MS
    gone = (t > 1000.0 + 200.0) & (t < 2600.0)
    np.testing.assert_array_equal(np.isnan(sweeps.lengths).all(axis=1), gone)
    held = (t > 1000.0) & ~gone & (t < 2600.0)
    np.testing.assert_allclose(sweeps.lengths[held], np.tile(lengths_at(1000.0), (held.sum(), 1)))
    assert f'axis: {gone.sum()} sweeps had no length of it within lengths.timeout: no result of them' in (
        sweeps.problems
    )


@pytest.mark.parametrize('ahead', [0.5, -3.0])
def test_a_bag_in_which_time_steps_back(c, tmp_path, ahead):
    """Whichever of the topics steps first; the second round is as the first."""
    also = [(r * 4000.0 + t + ahead, length_message(t)) for r in range(3) for t in SAMPLES[2:-2]]
    bag = write_growing(tmp_path / 'bag', SWEEPS, [], also=also, rounds=3)
    sweeps = read_sweeps(bag, c)
    assert len(sweeps.stamps_ns) == 3 * len(SWEEPS)
    assert (np.diff(sweeps.stamps_ns) < 0).sum() == 2
    np.testing.assert_allclose(sweeps.lengths[:-1], expected_at(sweeps.stamps_ns)[:-1], atol=2e-4)
    assert sum('samples not used' in line for line in sweeps.problems) == 0


def write_csv(path, *, names=NAMES, unit='', scale=1.0, start_s=0.0, empty=False, sweeps=SWEEPS):
    header = ['time_s', *(f'imu_{i}_{axis}' for i in IDS for axis in 'xyzw'), *(f'{n}{unit}' for n in names)]
    lines = [','.join(header)]
    for k, t in enumerate(sweeps):
        values = [t / 1e3 + start_s, *orientations_at(t).ravel()]
        lengths = [f'{v * scale:.12g}' for v in lengths_at(t)[: len(names)]]
        if empty and k % 4:
            lengths[1] = ''
        lines.append(','.join([*(f'{v:.12g}' for v in values), *lengths]))
    path.write_text('\n'.join(lines) + '\n')
    return path


@pytest.mark.parametrize(('unit', 'scale'), [('', 1.0), (' [mm]', 1000.0), ('_m', 1.0)])
@pytest.mark.parametrize('start_s', [0.0, -2.5, 1000.0])
def test_columns_of_a_csv(c, tmp_path, unit, scale, start_s):
    sweeps = read_sweeps(write_csv(tmp_path / 'a.csv', unit=unit, scale=scale, start_s=start_s), c)
    assert len(sweeps.stamps_ns) == len(SWEEPS)
    np.testing.assert_allclose(sweeps.lengths, lengths_at(SWEEPS), atol=1e-9)
    sweeps = read_sweeps(write_csv(tmp_path / 'b.csv', empty=True), c)
    every = np.interp(SWEEPS, SWEEPS[::4], lengths_at(SWEEPS[::4])[:, 1])
    np.testing.assert_allclose(sweeps.lengths[:, 1], every, atol=1e-9)
    np.testing.assert_allclose(sweeps.lengths[:, [0, 2]], lengths_at(SWEEPS)[:, [0, 2]], atol=1e-9)


def test_columns_of_a_long_csv_come_with_its_orientations(c, tmp_path):
    """Longer than a sweep waits."""
    t = np.arange(0.0, 30_000.0, 10.0)
    sweeps = read_sweeps(write_csv(tmp_path / 'a.csv', sweeps=t, start_s=1.0), c)
    np.testing.assert_allclose(sweeps.lengths, lengths_at(t), atol=1e-9)
    assert not sweeps.problems


def test_a_csv_that_lacks_a_column_says_which(c, tmp_path):
    with pytest.raises(Sesa2Error, match='no column tip_r, but axis; expected the length of each backbone'):
        read_sweeps(write_csv(tmp_path / 'a.csv', names=NAMES[:2]), c)
    with (
        open_recording(write_csv(tmp_path / 'b.csv', names=())) as recording,
        pytest.raises(
            Sesa2Error,
            match=r'b\.csv: no measured length in it, expected a topic /backbone_lengths of sensor_msgs/msg/JointState '
            'with the lengths of axis, tip_l, tip_r; in a CSV, columns of these names, in m',
        ),
    ):
        ImuRecording(recording, c).check_lengths()


def test_a_topic_of_another_type_or_without_messages_is_none(c, tmp_path):
    for number, (name, samples) in enumerate([('/other', SAMPLES), ('/backbone_lengths', [])]):
        bag = write_growing(tmp_path / f'bag{number}', SWEEPS, samples, name=name)
        with open_recording(bag) as recording, pytest.raises(Sesa2Error, match='no measured length in it'):
            ImuRecording(recording, c).check_lengths()
