"""Bags of any driver's topics, of one arm among several in a namespace, and of ids that are counted otherwise."""

from dataclasses import replace

import numpy as np
import pytest
from made_samples import START_NS, make_samples, write_samples

from sesa2.bags.definitions import STRING, string_message
from sesa2.bags.reading import ImuRecording, read_backbone, read_configuration, read_poses
from sesa2.bags.recorded_sweeps import read_sweeps
from sesa2.bags.recording import open_recording
from sesa2.bags.replay import replay
from sesa2.bags.writing import new_bag
from sesa2.configuration import files
from sesa2.errors import Sesa2Error
from sesa2.evaluation.bag_evaluation import evaluate_bag

NAMES = {'/imu_1/data': '/drv/a', '/imu_2/data': '/drv/b/data', '/imu_3/data': '/c'}


def named(configuration, *topics):
    return replace(configuration, imus=replace(configuration.imus, topics=topics))


def write(path, made, called=lambda topic: topic, also=()):
    with new_bag(path) as writer:
        write_samples(writer, [m._replace(topic=called(m.topic)) for m in made])
        for topic, text in also:
            writer.write(writer.add_topic(topic, STRING), START_NS, string_message(text))
    return path


def ids(path, configuration=None):
    with open_recording(path) as recording:
        imus = ImuRecording(recording, configuration)
        return imus.namespace, imus.counts


@pytest.fixture
def made():
    return make_samples(20)


def test_topics_by_their_names_give_what_topics_by_id_give(tmp_path, made, configuration):
    plain = write(tmp_path / 'plain', made)
    driver = write(tmp_path / 'driver', made, NAMES.get)
    c = named(configuration, *NAMES.values())
    assert ids(driver, c) == ('/', {1: 20, 2: 20, 3: 20})
    replay(plain, configuration, tmp_path / 'one')
    summary = replay(driver, c, tmp_path / 'other')
    assert summary.warnings == []
    assert {n for n in summary.messages if n in NAMES.values()} == set(NAMES.values())  # recorded so
    for model in configuration.models:
        one, other = (read_poses(tmp_path / n, f'{model}/markers') for n in ('one', 'other'))
        np.testing.assert_allclose(one.positions, other.positions, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(one.times_s, other.times_s)
    np.testing.assert_array_equal(
        read_sweeps(plain, configuration).orientations, read_sweeps(driver, c).orientations
    )
    # What was written so is read so again.
    assert ids(tmp_path / 'other', c) == ('/', {1: 20, 2: 20, 3: 20})


def test_other_names_mean_other_imus(tmp_path, made, configuration):
    driver = write(tmp_path / 'driver', made, NAMES.get)
    a, b, c = NAMES.values()
    right = read_sweeps(driver, named(configuration, a, b, c)).orientations
    turned = read_sweeps(driver, named(configuration, b, c, a)).orientations
    np.testing.assert_array_equal(turned, right[:, [1, 2, 0]])


@pytest.mark.parametrize('namespace', ['/left/', '/lab/left/'])
def test_relative_names_are_in_whichever_namespace(tmp_path, made, configuration, namespace):
    names = {t: f'{namespace}{n.lstrip("/")}' for t, n in NAMES.items()}
    driver = write(tmp_path / 'driver', made, names.get)
    c = named(configuration, 'drv/a', 'drv/b/data', 'c')
    assert ids(driver, c) == (namespace, {1: 20, 2: 20, 3: 20})
    assert all(t.startswith(namespace) for t in replay(driver, c, tmp_path / 'out').messages)


def test_absolute_names_in_a_bag_of_a_namespaced_run(tmp_path, made, configuration):
    bag = write(tmp_path / 'bag', made, NAMES.get, [('/left/configuration', 'x')])
    assert ids(bag, named(configuration, *NAMES.values()))[0] == '/left/'
    messages = replay(bag, named(configuration, *NAMES.values()), tmp_path / 'out').messages
    assert {'/left/pcc/tip', '/left/configuration', '/drv/a'} <= set(messages)


def test_relative_names_of_two_arms(tmp_path, made, configuration):
    with new_bag(tmp_path / 'bag') as writer:
        for arm in ('left', 'right'):
            write_samples(writer, [m._replace(topic=f'/{arm}{NAMES[m.topic]}') for m in made])
    with pytest.raises(Sesa2Error, match='namespaces /left/ and /right/, expected those of one arm'):
        ids(tmp_path / 'bag', named(configuration, 'drv/a', 'drv/b/data', 'c'))
    # Absolute ones say which.
    c = named(configuration, *(f'/right{n}' for n in NAMES.values()))
    assert ids(tmp_path / 'bag', c) == ('/', {1: 20, 2: 20, 3: 20})


def test_where_none_of_the_names_is_there_ids_do(tmp_path, made, configuration):
    plain = write(tmp_path / 'plain', made)
    assert ids(plain, named(configuration, *NAMES.values())) == ('/', {1: 20, 2: 20, 3: 20})


def test_names_that_are_not_there_are_told_with_those_that_are(tmp_path, made, configuration):
    driver = write(tmp_path / 'driver', made, NAMES.get)
    for c in (configuration, named(configuration, '/x', '/y', '/z')):
        with pytest.raises(Sesa2Error, match='no message of an IMU') as raised:
            replay(driver, c, tmp_path / 'out')
        assert '/drv/a (sensor_msgs/msg/Imu, 20)' in str(raised.value)
        assert 'imus.topics says which is whose' in str(raised.value)
    assert not (tmp_path / 'out').exists()


def test_imus_without_a_message_are_named(tmp_path, made, configuration):
    bag = write(tmp_path / 'bag', [m for m in made if m.topic != '/imu_2/data'])
    summary = replay(bag, configuration, tmp_path / 'out')
    assert 'IMU 2: no message' in summary.warnings
    assert any('IMU 2: no message' in p for p in read_sweeps(bag, configuration).problems)


def test_ids_that_are_counted_otherwise_are_refused(tmp_path, made, configuration):
    bag = write(tmp_path / 'bag', made)
    c = replace(configuration, imus=replace(configuration.imus, ids=(2, 4, 6)))
    for use in (lambda: replay(bag, c, tmp_path / 'out'), lambda: read_sweeps(bag, c)):
        with pytest.raises(
            Sesa2Error, match=r'no message of the IMUs 4, 6; it has topics of 1, 2, 3: say in'
        ):
            use()
    assert not (tmp_path / 'out').exists()
    # Those that were not there, switched off, are no doubt any more.
    alone = replace(c, imus=replace(c.imus, enabled=(True, False, False)))
    summary = replay(bag, alone, tmp_path / 'out')
    assert summary.sweeps == 20
    assert summary.unknown == {1: 20, 3: 20}


# Results in a namespace


def test_a_namespaced_bag_is_evaluated_as_any_other(tmp_path, made, configuration):
    plain, left = (
        write(tmp_path / 'plain', made),
        write(tmp_path / 'left', make_samples(20, namespace='/left/')),
    )
    for source in (plain, left):
        replay(source, configuration, tmp_path / f'{source.name}_out')
    one, other = tmp_path / 'plain_out', tmp_path / 'left_out'
    assert read_configuration(other) == files.dump(configuration)
    np.testing.assert_allclose(
        read_backbone(one, 'pcc/shape', 3), read_backbone(other, 'pcc/shape', 3), rtol=0, atol=1e-12
    )
    poses = read_poses(other, 'pcc/markers')
    np.testing.assert_allclose(poses.positions, read_poses(one, 'pcc/markers').positions, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        poses.positions, read_poses(other, '/left/pcc/markers').positions, rtol=0, atol=1e-12
    )
    truth = tmp_path / 'truth.csv'
    heads = ','.join(f'{m}_{axis}' for m in configuration.markers.names for axis in 'xyz')
    rows = np.column_stack([poses.times_s, poses.positions.reshape(20, -1)])
    truth.write_text(
        f'time_s,{heads}\n' + '\n'.join(','.join(f'{v!r}' for v in row) for row in rows.tolist())
    )
    for estimate in (one, other):
        evaluation = evaluate_bag(estimate, truth, models=['pcc'], time_offset=0.0)
        assert max(e.median_mm for e in evaluation.models['pcc'].values()) < 1e-6


def test_the_results_of_two_arms_are_told_apart_and_refused(tmp_path, configuration):
    text = string_message(files.dump(configuration))
    with new_bag(tmp_path / 'both') as writer:
        for arm in ('left', 'right'):
            writer.write(writer.add_topic(f'/{arm}/configuration', STRING), START_NS, text)
            writer.add_topic(f'/{arm}/pcc/markers', 'geometry_msgs/msg/PoseArray')
    for read in (read_configuration, lambda path: read_poses(path, 'pcc/markers')):
        with pytest.raises(
            Sesa2Error, match=r'/left/\S+ and /right/\S+ are in it, expected the topics of one arm'
        ):
            read(tmp_path / 'both')


# As other systems write them


@pytest.mark.parametrize(
    ('bag', 'topic'),
    [
        ('imu2', '/imu{}/data'),
        ('arm_imu_2', '/arm/imu_{}'),
        ('raw', 'imu_{}/data_raw'),
        ('raw', '/arm/imu_{}/data_raw'),
    ],
)
def test_drivers_that_call_their_topics_otherwise(tmp_path, cases, bag, topic):
    c = replace(files.load(files.find('prototype3_4')), models=('pcc',))
    c = named(c, *(topic.format(i) for i in c.imus.ids))
    summary = replay(cases / '06-topic-names' / bag, c, tmp_path / 'out')
    assert (summary.sweeps, summary.partial, summary.warnings) == (60, 0, [])
    found = read_poses(tmp_path / 'out', 'pcc/markers')
    known = read_poses(cases / '00-common/est10', 'pcc/markers')
    at = np.searchsorted(known.times_s, found.times_s - 1e-4)
    print(
        np.abs(known.times_s[at] - found.times_s).max(), np.abs(known.positions[at] - found.positions).max()
    )
    assert np.abs(known.positions[at] - found.positions).max() < 1e-3


def test_topics_that_are_counted_from_zero(tmp_path, cases):
    c = files.load(files.find('prototype3_4'))
    with pytest.raises(Sesa2Error, match=r'no message of the IMUs 4, 6, 8; it has topics of 0, 1, 2, 3'):
        replay(cases / '07-ids-from-zero/bag', c, tmp_path / 'out')
    c = named(c, *(f'imu_{k}/data' for k in range(4)))
    assert replay(cases / '07-ids-from-zero/bag', c, tmp_path / 'out').partial == 0
