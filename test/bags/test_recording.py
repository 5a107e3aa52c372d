"""Every format and every way in which a recording can end."""

import shutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_samples import make_samples, write_samples
from mcap.writer import CompressionType
from mcap.writer import Writer as Mcap
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2
from rosbags.typesys import Stores, get_typestore

from sesa2.bags.recording import open_recording
from sesa2.bags.topics import RecordedTopic
from sesa2.bags.writing import BagWriter, new_bag
from sesa2.errors import Sesa2Error
from sesa2.messages.imu_messages import TYPE

STORE = get_typestore(Stores.ROS2_JAZZY)


def read(path):
    with open_recording(path) as recording:
        messages = [(m.topic, m.log_ns, bytes(m.data)) for m in recording.messages()]
        return messages, recording.problems


def attempt(path):
    """What `read` gives, or the message of our error; any other error is let through."""
    try:
        return *read(path), None
    except Sesa2Error as error:
        return [], [], str(error)


def expected(samples):
    return [(m.topic, m.stamp_ns, m.data) for m in samples]


def write_with_rosbags(path, samples, plugin, mode=CompressionMode.NONE, version=9):
    """An independent writer."""
    writer = Rosbag2(path, version=version, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topics = {
            name: writer.add_connection(name, TYPE, typestore=STORE)
            for name in dict.fromkeys(m.topic for m in samples)
        }
        for m in samples:
            writer.write(topics[m.topic], m.stamp_ns, m.data)


FORMATS = [
    (plugin, mode, version)
    for plugin in StoragePlugin
    for mode in CompressionMode
    for version in (8, 9)
    if plugin is StoragePlugin.MCAP or mode is not CompressionMode.STORAGE
]


@pytest.mark.parametrize(('plugin', 'mode', 'version'), FORMATS)
def test_what_others_wrote(tmp_path, samples, plugin, mode, version):
    write_with_rosbags(tmp_path / 'in', samples, plugin, mode, version)
    assert read(tmp_path / 'in') == (expected(samples), [])


@pytest.mark.parametrize('plugin', list(StoragePlugin))
def test_a_single_file(tmp_path, samples, plugin):
    write_with_rosbags(tmp_path / 'in', samples, plugin)
    (file,) = (p for p in (tmp_path / 'in').iterdir() if p.suffix != '.yaml')
    assert read(file) == (expected(samples), [])


@pytest.mark.parametrize('plugin', list(StoragePlugin))
def test_a_folder_without_metadata(tmp_path, samples, plugin):
    write_with_rosbags(tmp_path / 'in', samples, plugin)
    (tmp_path / 'in/metadata.yaml').unlink()
    assert read(tmp_path / 'in') == (expected(samples), [])


def test_topics_and_their_types_and_counts(tmp_path, samples):
    with new_bag(tmp_path / 'in') as writer:
        late = writer.add_topic('/configuration', 'std_msgs/msg/String', latched=True)
        writer.write(late, samples[0].stamp_ns, b'')
        write_samples(writer, samples)
    for path in (tmp_path / 'in', tmp_path / 'in/in_0.mcap', cut(tmp_path / 'in/in_0.mcap', 0.99)):
        with open_recording(path) as recording:
            assert set(recording.topics) == {'/configuration', '/imu_1/data', '/imu_2/data', '/imu_3/data'}
            assert recording.topics['/configuration'] == RecordedTopic('std_msgs/msg/String', 1, True)
            assert recording.topics['/imu_1/data'] == RecordedTopic(TYPE, 300, False)
            assert 'float64[9] orientation_covariance' in recording.topics['/imu_1/data'].definition
            only = list(recording.messages(['/imu_2/data']))
            assert [m.data for m in only] == [m.data for m in samples if m.topic == '/imu_2/data']
            assert list(recording.messages([])) == []


def test_messages_that_were_written_topic_by_topic_come_in_order_of_time(tmp_path, samples):
    with new_bag(tmp_path / 'in') as writer:
        write_samples(writer, sorted(samples, key=lambda m: m.topic))
    assert read(tmp_path / 'in')[0] == expected(samples)


def test_topics_without_a_slash_in_front(tmp_path, samples):
    bare = [m._replace(topic=m.topic[1:]) for m in samples]
    write_with_rosbags(tmp_path / 'in', bare, StoragePlugin.SQLITE3)
    assert read(tmp_path / 'in')[0] == expected(samples)


def test_files_of_a_split_bag_come_in_order_of_their_numbers(tmp_path, samples):
    (tmp_path / 'in').mkdir()
    for k in range(12):
        writer = BagWriter(tmp_path / 'in', 'x')
        write_samples(writer, samples[75 * k : 75 * k + 75])
        writer.close()
        (tmp_path / 'in/x_0.mcap').rename(tmp_path / f'in/part_{k}.mcap')
    (tmp_path / 'in/metadata.yaml').unlink()
    assert read(tmp_path / 'in')[0] == expected(samples)


def test_unchunked_mcap_of_another_profile(tmp_path, samples):
    with (tmp_path / 'in.mcap').open('wb') as file:
        writer = Mcap(file, compression=CompressionType.NONE, use_chunking=False)
        writer.start('')
        schema = writer.register_schema(TYPE, 'ros2msg', b'')
        channel = writer.register_channel('/imu_1/data', 'cdr', schema)
        for m in samples[::3]:
            writer.add_message(channel, m.stamp_ns, m.data, m.stamp_ns)
        writer.finish()
    assert read(tmp_path / 'in.mcap') == (expected(samples[::3]), [])


def test_mcap_that_is_not_ros_2(tmp_path):
    with (tmp_path / 'in.mcap').open('wb') as file:
        writer = Mcap(file)
        writer.start('ros1')
        schema = writer.register_schema('sensor_msgs/Imu', 'ros1msg', b'')
        writer.add_message(writer.register_channel('/imu', 'ros1', schema), 1, b'', 1)
        writer.finish()
    with pytest.raises(Sesa2Error, match="/imu is encoded as 'ros1', expected cdr"):
        open_recording(tmp_path / 'in.mcap')


@pytest.mark.parametrize(
    ('name', 'content', 'message'),
    [
        ('missing', None, 'no such file or folder'),
        ('missing.mcap', None, 'no such file or folder'),
        ('notes.txt', b'hello', 'no bag, and no known export .* A CSV must have the columns time_s'),
        ('empty.mcap', b'', 'nothing readable'),
        ('text.mcap', b'hello, this is not MCAP at all', 'nothing readable'),
        ('empty.db3', b'', 'nothing readable'),
        ('text.db3', b'hello, this is not SQLite', 'nothing readable'),
        ('empty.bag', b'', 'nothing readable'),
        ('text.bag', b'hello, this is not a bag\n', 'nothing readable'),
        ('empty.csv', b'', 'A CSV must have the columns time_s .* imu_<id>_x'),
        ('markers.csv', b'time_s,M1_x,M1_y,M1_z\n0,1,2,3\n', 'no body is an IMU, .*there are M1'),
        ('part.csv', b'time_s,imu_3_x,imu_3_y,imu_3_w\n', 'has no column imu_3_z'),
        (
            'word.csv',
            b'time_s,imu_3_x,imu_3_y,imu_3_z,imu_3_w\n0,0,0,0,1\n1,0,x,0,1\n',
            "line 3: imu_3_y is 'x'",
        ),
        ('time.csv', b'time_s,imu_3_x,imu_3_y,imu_3_z,imu_3_w\n,0,0,0,1\n', 'line 2: time_s is empty'),
        ('image.csv', b'\x89PNG\xff\xfe', 'no known export'),
    ],
)
def test_what_is_no_recording(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(Sesa2Error, match=message) as raised:
        open_recording(tmp_path / name)
    assert name in str(raised.value)


def test_a_folder_with_nothing_to_read(tmp_path):
    with pytest.raises(Sesa2Error, match='no recording in this folder'):
        open_recording(tmp_path)
    (tmp_path / 'metadata.yaml').write_text('{')
    with pytest.raises(Sesa2Error, match='no recording in this folder'):
        open_recording(tmp_path)


def test_a_bag_that_lost_one_of_its_files(tmp_path, bag, samples):
    metadata = (bag / 'metadata.yaml').read_text()
    (bag / 'metadata.yaml').write_text(metadata.replace('- in_0.mcap', '- in_0.mcap\n  - in_1.mcap'))
    messages, problems = read(bag)
    assert messages == expected(samples)
    assert len(problems) == 1
    assert 'in_1.mcap' in problems[0]


def test_an_empty_bag(tmp_path):
    with new_bag(tmp_path / 'in'):
        pass
    assert read(tmp_path / 'in') == ([], [])


def cut(path, fraction=None, size=None):
    """The beginning of a file, alone in a folder, as a killed recorder leaves it."""
    folder = path.parent.parent / 'cut'
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    data = path.read_bytes()
    (folder / path.name).write_bytes(data[: round(len(data) * fraction) if size is None else size])
    return folder


@pytest.fixture(scope='module')
def small_chunks(tmp_path_factory):
    """A bag of ten chunks, and where they end."""
    folder = tmp_path_factory.mktemp('bags') / 'in'
    folder.mkdir()
    samples = make_samples(100)
    writer = BagWriter(folder, 'in')
    topics = {name: writer.add_topic(name, TYPE) for name in dict.fromkeys(m.topic for m in samples)}
    ends = []
    for k, m in enumerate(samples, start=1):
        writer.write(topics[m.topic], m.stamp_ns, m.data)
        if k % 30 == 0:
            writer.flush()
            ends.append((folder / 'in_0.mcap').stat().st_size)
    writer.close()
    return folder / 'in_0.mcap', samples, ends


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_of_a_file_cut_anywhere_all_whole_chunks_are_read(small_chunks, data):
    file, samples, ends = small_chunks
    size = data.draw(st.integers(0, file.stat().st_size - 1))
    # Message indices follow a chunk; it is whole before they are.
    at_least = 30 * sum(end <= size for end in ends)
    messages, problems, error = attempt(cut(file, size=size))
    if error:
        assert at_least == 0
        assert 'nothing readable' in error
        return
    assert messages == expected(samples)[: len(messages)]
    assert at_least <= len(messages) <= at_least + 30
    assert len(problems) == 1
    assert 'cut short' in problems[0]
    assert f'{len(messages)} messages over ' in problems[0]
    assert str(size) in problems[0]


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_damaged_bytes_never_end_in_anything_but_our_error(small_chunks, tmp_path_factory, data):
    file, _, _ = small_chunks
    content = bytearray(file.read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content))) :]
    damaged = tmp_path_factory.mktemp('damaged') / 'in.mcap'
    damaged.write_bytes(content)
    _, _, error = attempt(damaged)
    assert error is None or str(damaged) in error


def test_damage_in_the_middle_is_told_and_what_comes_before_it_is_read(small_chunks, tmp_path):
    file, samples, ends = small_chunks
    content = bytearray(file.read_bytes())
    content[ends[4] + 200] ^= 0xFF
    (tmp_path / 'in.mcap').write_bytes(content)
    messages, problems = read(tmp_path / 'in.mcap')
    assert messages == expected(samples)[:150]
    assert len(problems) == 1
    assert 'is damaged after 150 messages' in problems[0]
    # Without the index at the end of the file, the same by mcap's stream reader.
    (tmp_path / 'in.mcap').write_bytes(content[: ends[-1]])
    messages, problems = read(tmp_path / 'in.mcap')
    assert messages == expected(samples)[:150]
    assert 'is damaged' in problems[0]


@pytest.fixture(scope='module')
def sqlite_bag(tmp_path_factory, samples):
    folder = tmp_path_factory.mktemp('bags')
    write_with_rosbags(folder / 'in', samples, StoragePlugin.SQLITE3)
    return folder / 'in/in.db3'


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_a_cut_sqlite_bag(sqlite_bag, samples, data):
    file = sqlite_bag
    size = data.draw(st.integers(0, file.stat().st_size - 1))
    messages, problems, error = attempt(cut(file, size=size))
    if error:
        assert 'in.db3' in error
        return
    assert messages == expected(samples)[: len(messages)]
    assert problems or len(messages) == len(samples)


def test_stamps_that_jump_back_stay_in_the_recorded_order_of_a_cut_bag(tmp_path):
    first, second = make_samples(20), make_samples(20, start_ns=5)
    with new_bag(tmp_path / 'in') as writer:
        write_samples(writer, first + second)
    messages, _ = read(cut(tmp_path / 'in/in_0.mcap', 0.9999))
    assert messages == expected(first + second)
    assert np.diff([m[1] for m in messages]).min() < 0
