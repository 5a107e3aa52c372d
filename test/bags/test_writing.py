"""What we write, read back by rosbags; and what is left when writing ends badly."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from made_samples import START_NS, make_samples, write_samples
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosHistory, QosReliability
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2

from sesa2.bags.definitions import STRING, string_message, typestore
from sesa2.bags.recording import open_recording
from sesa2.bags.writing import BagWriter, new_bag, record
from sesa2.errors import Sesa2Error
from sesa2.messages.imu_messages import TYPE

CALIBRATION = 'sesa2_msgs/msg/ImuCalibration'


def calibration_message():
    types = typestore().types
    header = types['std_msgs/msg/Header'](types['builtin_interfaces/msg/Time'](1, 2), 'imu_1')
    xyz = np.array([1, -2, 3], np.int16)
    message = types[CALIBRATION](header, 1, 3, 2, 1, 0, True, xyz, 2 * xyz, 3 * xyz, 1000, -500)
    return bytes(typestore().serialize_cdr(message, CALIBRATION))


@pytest.fixture
def several(tmp_path, samples):
    """A bag of three types, one topic latched."""
    with new_bag(tmp_path / 'out') as writer:
        latched = writer.add_topic('/configuration', STRING, latched=True)
        writer.write(latched, samples[0].stamp_ns, string_message('arm: {}'))
        calibration = writer.add_topic('/imu_1/calibration', CALIBRATION, latched=True)
        writer.write(calibration, samples[0].stamp_ns, calibration_message(), samples[0].stamp_ns - 7)
        write_samples(writer, samples)
    return tmp_path / 'out'


def test_rosbags_reads_it_with_the_types_that_the_bag_carries(several, samples):
    with AnyReader([several]) as reader:
        messages = [(c.topic, t, reader.deserialize(d, c.msgtype)) for c, t, d in reader.messages()]
        topics = {c.topic: c for c in reader.connections}
    assert [(topic, t) for topic, t, _ in messages[2:]] == [(m.topic, m.stamp_ns) for m in samples]
    assert messages[0][2].data == 'arm: {}'
    assert messages[1][2].mag_offset.tolist() == [2, -4, 6]
    assert messages[1][2].mag_radius == -500
    for (_, _, message), made in zip(messages[2:], samples, strict=True):
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == made.stamp_ns
        assert message.orientation.w == made.orientation[3]
    assert topics['/imu_1/data'].msgcount == 300
    for name, durability, depth in (
        ('/imu_1/data', QosDurability.VOLATILE, 100),
        ('/configuration', QosDurability.TRANSIENT_LOCAL, 1),
    ):
        (qos,) = topics[name].ext.offered_qos_profiles
        assert (qos.durability, qos.depth) == (durability, depth)
        assert (qos.reliability, qos.history) == (QosReliability.RELIABLE, QosHistory.KEEP_LAST)


def test_the_single_file_is_a_recording_of_its_own(several):
    with AnyReader([several / 'out_0.mcap']) as reader:
        assert reader.message_count == 902
        assert sum(1 for _ in reader.messages()) == 902


def test_metadata(several, samples):
    information = yaml.safe_load((several / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert information['starting_time']['nanoseconds_since_epoch'] == samples[0].stamp_ns
    assert information['duration']['nanoseconds'] == samples[-1].stamp_ns - samples[0].stamp_ns
    assert information['message_count'] == 902
    assert information['relative_file_paths'] == ['out_0.mcap']
    counts = {
        t['topic_metadata']['name']: t['message_count'] for t in information['topics_with_message_count']
    }
    assert counts['/imu_3/data'] == 300
    assert counts['/configuration'] == 1


def test_an_empty_bag_is_one_to_rosbags(tmp_path):
    with new_bag(tmp_path / 'out'):
        pass
    with AnyReader([tmp_path / 'out'], default_typestore=typestore()) as reader:
        assert reader.message_count == 0


def test_a_new_bag_does_not_overwrite(tmp_path):
    for name, make in (('file', Path.touch), ('folder', Path.mkdir)):
        make(tmp_path / name)
        with pytest.raises(Sesa2Error, match='exists already'), new_bag(tmp_path / name):
            pass
    assert sorted(p.name for p in tmp_path.iterdir()) == ['file', 'folder']


def test_a_new_bag_is_there_only_when_it_is_whole(tmp_path):
    with new_bag(tmp_path / 'out') as writer:
        write_samples(writer, make_samples(2))
        assert not (tmp_path / 'out').exists()
    assert [p.name for p in tmp_path.iterdir()] == ['out']


@pytest.mark.parametrize('error', [ValueError, KeyboardInterrupt])
def test_after_an_error_nothing_is_left(tmp_path, error):
    def fail():
        with new_bag(tmp_path / 'out') as writer:
            write_samples(writer, make_samples(2))
            raise error

    with pytest.raises(error):
        fail()
    assert list(tmp_path.iterdir()) == []


def test_where_no_bag_can_be_made(tmp_path):
    (tmp_path / 'file').touch()
    for folder in ('missing', 'file'):
        with (
            pytest.raises(Sesa2Error, match=f'{folder}/out: cannot be written: '),
            new_bag(tmp_path / folder / 'out'),
        ):
            pass
    with pytest.raises(Sesa2Error, match=r'file/out: cannot be written: .*file is a file, expected a folder'):
        record(tmp_path / 'file/out')


def test_a_recording_takes_the_next_free_name(tmp_path):
    writers = [record(tmp_path / 'new/trial') for _ in range(3)]
    assert [w.path.name for w in writers] == ['trial', 'trial_2', 'trial_3']
    for writer in writers:
        writer.close()
        writer.close()
    assert (tmp_path / 'new/trial_3/trial_3_0.mcap').is_file()


@pytest.fixture
def small_disk():
    """No file may grow beyond 20 kB."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def fill(writer):
    """Write what no compression makes smaller; yields how many messages are on the disk."""
    rng = np.random.default_rng(0)
    topic = writer.add_topic('/imu_1/data', TYPE)
    for k in range(100):
        writer.write(topic, k, rng.bytes(1000))
        writer.flush()
        yield k + 1


def test_a_new_bag_on_a_full_disk(tmp_path, small_disk):
    def write():
        with new_bag(tmp_path / 'out') as writer:
            list(fill(writer))

    with pytest.raises(Sesa2Error, match=r'out_0\.mcap: cannot be written: File too large'):
        write()
    assert list(tmp_path.iterdir()) == []


def test_a_recording_on_a_full_disk_keeps_what_it_has(tmp_path, small_disk):
    writer = record(tmp_path / 'out')
    written = []
    with pytest.raises(Sesa2Error, match=r'out_0\.mcap: cannot be written: File too large'):
        written.extend(fill(writer))
    writer.close()
    assert len(written) >= 10
    with open_recording(tmp_path / 'out') as recording:
        assert [m.log_ns + 1 for m in recording.messages()] == written
        assert 'cut short' in recording.problems[0]


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='this system has no /dev/full')
def test_a_disk_that_is_full_from_the_start(tmp_path):
    (tmp_path / 'out_0.mcap').symlink_to('/dev/full')
    writer = BagWriter(tmp_path, 'out')
    topic = writer.add_topic('/imu_1/data', TYPE)
    writer.write(topic, 1, b'')
    with pytest.raises(Sesa2Error, match='No space left on device'):
        writer.flush()
    writer.close()
    assert not (tmp_path / 'metadata.yaml').exists()


RECORDER = """
import sys, time
from sesa2.bags.writing import record
bag = record(sys.argv[1])
topic = bag.add_topic('/imu_1/data', 'sensor_msgs/msg/Imu')
while True:
    now = time.time_ns()
    bag.write(topic, now, b'x' * 324)
    print(now, flush=True)
    time.sleep(0.002)
"""


def test_a_killed_recorder_loses_less_than_a_second(tmp_path):
    root = Path(__file__).resolve().parents[2]
    process = subprocess.Popen(
        [sys.executable, '-c', RECORDER, str(tmp_path / 'out')],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, 'PYTHONPATH': str(root)},
    )
    written = []
    for line in process.stdout:
        written.append(int(line))
        if written[-1] - written[0] > 1_700_000_000 and process.poll() is None:
            process.kill()  # what it printed until it died is still to be read
    process.wait()
    assert not (tmp_path / 'out/metadata.yaml').exists()
    with open_recording(tmp_path / 'out') as recording:
        read = [m.log_ns for m in recording.messages()]
        problems = recording.problems
        topics = recording.topics
    assert read == written[: len(read)]
    assert written[-1] - read[-1] < 1_000_000_000
    assert topics['/imu_1/data'].type == TYPE
    assert len(problems) == 1
    assert 'cut short' in problems[0]
    assert f'{len(read)} messages over ' in problems[0]


def test_a_live_recording_is_handed_over_while_it_is_written(tmp_path, monkeypatch):
    now = 0.0
    monkeypatch.setattr('sesa2.bags.writing.time.monotonic', lambda: now)
    writer = record(tmp_path / 'out')
    topic = writer.add_topic('/imu_1/data', TYPE)
    for k in range(13):
        now = 0.11 * k
        writer.write(topic, START_NS + k, bytes(324))
    with open_recording(tmp_path / 'out') as recording:
        assert len(list(recording.messages())) == 11  # at 0.55 s and 1.1 s
    writer.close()


def test_metadata_and_channels_are_those_that_rosbags_writes(several, tmp_path):
    """Two writers of one content; the file's name and who wrote it differ."""
    with (
        AnyReader([several]) as reader,
        Rosbag2(tmp_path / 'theirs', version=9, storage_plugin=StoragePlugin.MCAP) as writer,
    ):
        for connection in reader.connections:
            theirs = writer.add_connection(
                connection.topic,
                connection.msgtype,
                typestore=typestore(),
                offered_qos_profiles=connection.ext.offered_qos_profiles,
            )
            for _, log_ns, data in reader.messages([connection]):
                writer.write(theirs, log_ns, data)
    described = []
    for folder in (several, tmp_path / 'theirs'):
        (file,) = folder.glob('*.mcap')
        information = yaml.safe_load((folder / 'metadata.yaml').read_text().replace(file.name, 'x.mcap'))
        del information['rosbag2_bagfile_information']['ros_distro']
        with file.open('rb') as stream:
            summary = make_reader(stream).get_summary()
        channels = {
            c.topic: (c.message_encoding, yaml.safe_load(c.metadata['offered_qos_profiles']))
            for c in summary.channels.values()
        }
        schemas = {s.name: (s.encoding, s.data) for s in summary.schemas.values()}
        described.append((information, channels, schemas))
    assert described[0] == described[1]
