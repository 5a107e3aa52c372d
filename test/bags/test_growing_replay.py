"""A replay of an arm that grows: what comes out, what ends without lengths, and that it can be replayed again."""

import json
import subprocess
import sys

import numpy as np
import pytest
from growing_arm import IDS, MS, VALUES, length_message, lengths_at, orientations_at, write_growing
from made_bags import T0
from rosbags.highlevel import AnyReader

from sesa2.bags.recorded_sweeps import read_sweeps
from sesa2.bags.replay import replay
from sesa2.bags.trial_bag import START_NS, MeasuredLengths, write_trial
from sesa2.configuration import files, validate
from sesa2.errors import Sesa2Error
from sesa2.estimation.estimator import Estimator
from sesa2.estimation.sweeps import Sweep
from sesa2.twin.trial import Trial

SWEEPS = np.arange(0.0, 4000.0, 10.0)
SAMPLES = np.arange(-16.0, 4016.0, 8.0)


@pytest.fixture(scope='module')
def c():
    return validate(VALUES)


def read(path):
    """By an independent reader: stamps and messages of each topic."""
    found = {}
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(data, connection.msgtype))
    return found


def stamps_of(messages):
    return np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in messages])


def tips(messages):
    return np.array([[m.pose.position.x, m.pose.position.y, m.pose.position.z] for m in messages])


def test_results_are_those_of_the_lengths_at_each_sweep(c, tmp_path):
    bag = write_growing(tmp_path / 'bag', SWEEPS, SAMPLES)
    summary = replay(bag, c, tmp_path / 'out')
    assert summary.sweeps == len(SWEEPS)
    assert not summary.warnings
    found = read(tmp_path / 'out')
    recorded = read_sweeps(bag, c)
    t = (recorded.stamps_ns - T0) / MS
    lengths = np.stack([np.interp(t, SAMPLES, column) for column in lengths_at(SAMPLES).T], axis=-1)
    estimator = Estimator(c)
    expected = estimator.estimate(
        [
            Sweep(int(stamp), q, measured, None, own)
            for stamp, q, measured, own in zip(
                recorded.stamps_ns, recorded.orientations, recorded.measured, lengths, strict=True
            )
        ]
    )
    for model in c.models:
        np.testing.assert_array_equal(stamps_of(found[f'/{model}/tip']), recorded.stamps_ns)
        np.testing.assert_allclose(
            tips(found[f'/{model}/tip']), expected.models[model].ends[:, -1], atol=1e-9
        )
    # Of an arm that is straight for once, the tip is as far away as the two segments are long.
    straight = np.argmin(np.abs(np.sin(t / 900.0)))
    length = lengths[straight, 0] + lengths[straight, 1:].mean()
    assert np.linalg.norm(tips(found['/rigid/tip'])[straight]) == pytest.approx(length, rel=0.02)


def test_the_out_bag_can_be_replayed_and_says_the_same(c, tmp_path):
    bag = write_growing(tmp_path / 'bag', SWEEPS, SAMPLES)
    replay(bag, c, tmp_path / 'out')
    replay(tmp_path / 'out', c, tmp_path / 'again')
    first, again = read(tmp_path / 'out'), read(tmp_path / 'again')
    assert len(first['/backbone_lengths']) == len(SAMPLES)
    assert first['/backbone_lengths'][7].name == list(VALUES['lengths']['names'])
    for topic in ('/pcc/tip', '/rigid/tip'):
        np.testing.assert_array_equal(stamps_of(first[topic]), stamps_of(again[topic]))
        np.testing.assert_array_equal(tips(first[topic]), tips(again[topic]))


def test_where_lengths_are_gone_results_are_gone_and_the_rest_is_as_it_was(c, tmp_path):
    there = [t for t in SAMPLES if not 1000.0 < t < 2600.0]
    summary = replay(write_growing(tmp_path / 'bag', SWEEPS, there), c, tmp_path / 'out')
    stamps = (stamps_of(read(tmp_path / 'out')['/pcc/tip']) - T0) / MS
    gone = (stamps > 1200.0) & (stamps < 2600.0)
    assert not gone.any()
    assert len(stamps) == summary.sweeps == len(SWEEPS) - 140
    assert summary.without_lengths == 140
    told = '\n'.join(summary.warnings)
    assert '140 sweeps without a result' in told
    assert 'axis: 140 sweeps had no length of it within lengths.timeout: no result of them' in told


def test_without_the_topic_it_ends_with_a_sentence(c, tmp_path):
    bag = write_growing(tmp_path / 'bag', SWEEPS, SAMPLES, name='/lengths')
    with pytest.raises(Sesa2Error, match='no measured length in it, expected a topic /backbone_lengths'):
        replay(bag, c, tmp_path / 'out')
    file = tmp_path / 'c.yaml'
    file.write_text(files.dump(c))
    run = cli('replay', bag, '--config', file, '--out', tmp_path / 'out')
    assert run.returncode == 1
    assert 'no measured length in it' in run.stderr
    assert 'Traceback' not in run.stderr
    assert not (tmp_path / 'out').exists()


def test_lengths_that_never_come_in_time_end_with_a_sentence(c, tmp_path):
    """As of a clock that is a minute behind."""
    also = [(t, length_message(t - 60_000.0)) for t in SAMPLES]
    bag = write_growing(tmp_path / 'bag', SWEEPS, [], also=also)
    with pytest.raises(Sesa2Error, match='no result in 800 samples') as caught:
        replay(bag, c, tmp_path / 'out')
    assert 'axis: its stamps are 60.00 s behind those of the IMUs: separate clocks?' in str(caught.value)


def test_models_that_are_chosen_and_no_samples_recorded(c, tmp_path):
    values = {**VALUES, 'record': {'imu': False}}
    bag = write_growing(tmp_path / 'bag', SWEEPS, SAMPLES)
    replay(bag, validate(values), tmp_path / 'out', models=['rigid'])
    topics = set(read(tmp_path / 'out'))
    assert '/backbone_lengths' not in topics
    assert '/rigid/tip' in topics


def test_messages_of_another_time_do_not_tear_the_bag(c, tmp_path):
    also = [(1500.2, length_message(1e6)), (1600.2, length_message(-1e6))]
    bag = write_growing(tmp_path / 'bag', SWEEPS, SAMPLES, also=also)
    summary = replay(bag, c, tmp_path / 'out')
    assert summary.sweeps == len(SWEEPS)
    with AnyReader([tmp_path / 'out']) as reader:
        assert reader.duration < 4.1e9
        times = [t for _, t, _ in reader.messages()]
    assert times == sorted(times)
    assert len(read(tmp_path / 'out')['/backbone_lengths']) == len(SAMPLES) + 2


def cli(*arguments):
    return subprocess.run(
        [sys.executable, '-m', 'sesa2.cli', *map(str, arguments)], capture_output=True, text=True, check=False
    )


def test_its_results_are_exported_and_evaluated(c, tmp_path):
    """Against itself: another bag of the same models is the truth."""
    replay(write_growing(tmp_path / 'bag', SWEEPS, SAMPLES), c, tmp_path / 'out')
    run = cli('export', tmp_path / 'out', '--out', tmp_path / 'a.npz', '--models', 'pcc')
    assert run.returncode == 0, run.stderr
    truth = ('--truth', tmp_path / 'out', '--truth-topic', '/rigid/markers', '--register', 'none', '--json')
    run = cli('evaluate', tmp_path / 'out', *truth)
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert found['models']['rigid']['M1']['rmse_mm'] < 1e-3
    assert not any('lengths' in line for line in found['warnings'])


def test_a_loop_gives_each_round_the_same(c, tmp_path):
    also = [(r * 4000.0 + t + 0.5, length_message(t)) for r in range(2) for t in SAMPLES[2:-2]]
    bag = write_growing(tmp_path / 'bag', SWEEPS, [], also=also, rounds=2)
    summary = replay(bag, c, tmp_path / 'out')
    assert (summary.sweeps, summary.resets) == (2 * len(SWEEPS), 1)
    found = sorted(
        read(tmp_path / 'out')['/pcc/tip'], key=lambda m: (m.header.stamp.sec, m.header.stamp.nanosec)
    )
    np.testing.assert_array_equal(stamps_of(found[::2]), stamps_of(found[1::2]))
    np.testing.assert_allclose(tips(found[::2]), tips(found[1::2]), atol=1e-12)


def test_a_trial_with_lengths(c, tmp_path):
    t = SWEEPS / 1e3
    q = np.stack([orientations_at(ms) for ms in SWEEPS])
    nothing = {name: np.zeros(0) for name in ('backbone_times', 'backbone_positions', 'backbone', 'energies')}
    trial = Trial(
        base=np.array([0.0, 0.0, 0.0, 1.0]),
        times=t,
        imu_positions=np.array([0.15, 0.3]),
        orientations=q,
        sensor_ids=np.array(IDS),
        stamps=np.stack([t, t + 1e-3], axis=-1),
        measured=q,
        mountings=np.zeros((2, 3)),
        headings=np.zeros((len(t), 2)),
        truth_times=t,
        marker_names=np.array(['M1']),
        marker_positions=np.array([0.3]),
        markers=np.zeros((len(t), 1, 3)),
        **nothing,
    )
    times = np.arange(0.0, 4.016, 0.008)
    write_trial(trial, c, tmp_path / 'trial', MeasuredLengths(times, lengths_at(1e3 * times)))
    sweeps = read_sweeps(tmp_path / 'trial', c)
    at = (sweeps.stamps_ns - START_NS) / 1e9
    expected = [np.interp(at, times, column) for column in lengths_at(1e3 * times).T]
    np.testing.assert_allclose(sweeps.lengths, np.stack(expected, axis=-1), atol=1e-9)
    assert replay(tmp_path / 'trial', c, tmp_path / 'out').sweeps == len(t)
