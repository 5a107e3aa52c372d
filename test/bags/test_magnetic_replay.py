"""Bags of magnetic fields, made by other programs, replay to the shape that made the fields."""

from dataclasses import replace as replaced

import numpy as np
import pytest
from made_bags import T0
from magnetic_bag import (
    APART_NS,
    CONFIG,
    FIELD,
    PERIOD_NS,
    STORE,
    configuration,
    field_message,
    motion,
    of_z,
    readings,
    stamp_of,
    write_fields,
)
from paper_arm import PaperArm
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Writer

from sesa2.bags.estimate_arrays import read_estimate
from sesa2.bags.replay import replay
from sesa2.cli import main
from sesa2.errors import Sesa2Error

pytest.importorskip('magpylib', reason='magpylib is not installed')

N = 80
NOISE = 0.7e-6


def true_positions(q, s):
    """By scipy's rotations, (n, 3), m."""
    return PaperArm(3, 4)._pose(q, s)[0]


@pytest.fixture(scope='module')
def values():
    return readings(motion(N), noise=NOISE)


@pytest.fixture(scope='module')
def exact():
    return readings(motion(N))


def estimate_of(path, c, out):
    summary = replay(path, c, out)
    return summary, read_estimate(out).models['magnetic']


@pytest.mark.parametrize('kind', ['none', 'constant_velocity'])
def test_the_right_shape(tmp_path, values, kind):
    bag = write_fields(tmp_path / 'in', values)
    summary, found = estimate_of(bag, configuration(filter=kind), tmp_path / 'out')
    q = motion(N)
    assert summary.field_sweeps == N
    assert summary.sweeps == 0
    assert summary.warnings == []
    assert summary.duration == pytest.approx((N - 1) / 40.0)
    for k, s in enumerate((0.11, 0.22, 0.33)):
        off = np.linalg.norm(found.markers[:, k] - true_positions(q, s), axis=1)
        assert off.max() < 0.03 * s
        assert np.sqrt(np.mean(off**2)) < 0.01 * s
    np.testing.assert_allclose(found.tip, found.markers[:, 2], atol=1e-9)
    np.testing.assert_allclose(found.backbone[:, -1], found.tip, atol=1e-9)
    assert found.coordinate_names == tuple(
        f'segment_{k}_{name}' for k in (1, 2, 3) for name in ('bend_x', 'bend_y', 'length')
    )
    np.testing.assert_allclose(found.coordinates, q, atol=0.05)


def test_without_noise_it_is_exact_and_stamped_by_the_last_of_the_sweep(tmp_path, exact):
    bag = write_fields(tmp_path / 'in', exact)
    _, found = estimate_of(bag, configuration(filter='none'), tmp_path / 'out')
    np.testing.assert_allclose(found.coordinates, motion(N), atol=1e-4)
    # Lengths of the links are those of the segments, 21 a segment.
    np.testing.assert_allclose(
        found.link_lengths.reshape(N, 3, 21).sum(axis=-1), motion(N)[:, 2::3], atol=1e-4
    )
    stamps = read_estimate(tmp_path / 'out').stamps_ns
    assert stamps.tolist() == [stamp_of(k, 11) for k in range(N)]


def test_interpolated_to_the_first_of_the_sweep(tmp_path, exact):
    bag = write_fields(tmp_path / 'in', exact)
    c = replaced(configuration(filter='none'), time_alignment='interpolate')
    replay(bag, c, tmp_path / 'out')
    assert read_estimate(tmp_path / 'out').stamps_ns.tolist() == [stamp_of(k, 0) for k in range(N)]


def test_three_axes(tmp_path):
    arm = PaperArm(3, 4, axes='xyz')
    q = motion(10)
    fields = arm.simulate(q).reshape(10, 12, 3)
    bag = write_fields(tmp_path / 'in', fields, as_field=lambda xyz: xyz)
    c = configuration(filter='none')
    c = replaced(c, magnetometers=replaced(c.magnetometers, axes=('xyz',)))
    _, found = estimate_of(bag, c, tmp_path / 'out')
    np.testing.assert_allclose(found.coordinates, q, atol=1e-4)


def test_of_a_sensor_along_z_the_other_axes_do_not_count(tmp_path, exact):
    bag = write_fields(tmp_path / 'in', exact[:10], as_field=lambda z: (1.0, np.inf, z))
    _, found = estimate_of(bag, configuration(filter='none'), tmp_path / 'out')
    np.testing.assert_allclose(found.coordinates, motion(10), atol=1e-4)


def test_a_silent_magnetometer_is_done_without(tmp_path, exact):
    bag = write_fields(
        tmp_path / 'in', exact, change=lambda k, i, stamp, data: None if i == 6 and k >= 20 else data
    )
    summary, found = estimate_of(bag, configuration(filter='none'), tmp_path / 'out')
    assert summary.field_sweeps == N
    np.testing.assert_allclose(found.coordinates, motion(N), atol=1e-4)
    text = '\n'.join(summary.warnings)
    assert 'magnetometer 6: left out of 60 of 80 sweeps: silent' in text
    assert '60 of 80 sweeps lack a magnetometer' in text


def test_one_that_was_never_there_and_one_too_many(tmp_path, exact):
    ids = [1, 2, 3, 4, 5, 99, 7, 8, 9, 10, 11, 12]
    bag = write_fields(tmp_path / 'in', exact, ids=ids)
    summary, found = estimate_of(bag, configuration(filter='none'), tmp_path / 'out')
    np.testing.assert_allclose(found.coordinates, motion(N), atol=1e-4)
    assert 'magnetometer 6: no message' in summary.warnings
    assert 'magnetometer 99: 80 messages not used: not in magnetometers.ids' in summary.warnings


@pytest.mark.parametrize(
    ('wrong', 'said'),
    [
        (5e-3, 'saturated: beyond magnetometers.range'),
        (0.0, 'silent, or zero to the last bit'),
        (30e-6, 'jumping: not what the others'),
    ],
)
def test_one_that_lies_is_found_and_named(tmp_path, values, wrong, said):
    lying = values.copy()
    lying[40:, 5] = lying[40:, 5] + wrong if wrong == 30e-6 else wrong
    bag = write_fields(tmp_path / 'in', lying)
    summary, found = estimate_of(bag, configuration(), tmp_path / 'out')
    [line] = [line for line in summary.warnings if 'magnetometer' in line]
    assert line == f'magnetometer 6: left out of 40 of 80 sweeps: {line.rpartition("sweeps: ")[2]}'
    assert said in line
    np.testing.assert_allclose(found.coordinates, motion(N), atol=0.04)


def test_sweeps_that_nothing_explains_are_counted_and_not_written(tmp_path, values):
    dead = values.copy()
    dead[30:40] = 0.0
    bag = write_fields(tmp_path / 'in', dead)
    summary, found = estimate_of(bag, configuration(filter='none'), tmp_path / 'out')
    assert summary.field_sweeps == N - 10
    assert np.isfinite(found.markers).all()
    assert len(found.tip) == N - 10
    assert any('magnetic: 10 of 80 sweeps without a result' in line for line in summary.warnings)


def test_damaged_unstamped_and_not_a_number(tmp_path, exact):
    def change(k, i, stamp, data):
        if i == 2 and k == 7:
            return data[:40]
        if i == 3:
            return field_message(0, of_z(exact[k, 2]))
        return field_message(stamp, of_z(np.nan)) if i == 4 and k == 9 else data

    bag = write_fields(tmp_path / 'in', exact, change=change)
    summary = replay(bag, configuration(filter='none'), tmp_path / 'out')
    found = read_estimate(tmp_path / 'out')
    k = (found.stamps_ns - T0) // PERIOD_NS
    assert len(k) >= N - 2
    np.testing.assert_allclose(found.models['magnetic'].coordinates, motion(N)[k], atol=1e-4)
    text = '\n'.join(summary.warnings)
    assert 'magnetometer 2: 1 messages not used: damaged' in text
    assert 'magnetometer 3: 80 messages have no stamp (0)' in text
    assert '1 fields not used: not a number' in text


def test_a_bag_that_was_looped(tmp_path, exact):
    with Writer(tmp_path / 'in', version=9) as bag:
        topics = {
            i: bag.add_connection(f'/magnetometer_{i}/field', FIELD, typestore=STORE) for i in range(1, 13)
        }
        log_ns = T0
        for _ in range(2):
            for k, row in enumerate(exact):
                for place, value in enumerate(row):
                    log_ns += APART_NS
                    data = field_message(stamp_of(k, place), of_z(value))
                    bag.write(topics[place + 1], log_ns, data)
    summary = replay(tmp_path / 'in', configuration(), tmp_path / 'out')
    assert summary.resets == 1
    assert summary.field_sweeps == 2 * N
    assert summary.duration == pytest.approx(2 * (N - 1) / 40.0)


def test_of_a_namespace_and_as_it_was_recorded(tmp_path, exact):
    bag = write_fields(tmp_path / 'in', exact[:10], namespace='/left/')
    replay(bag, configuration(), tmp_path / 'out')
    with AnyReader([tmp_path / 'out']) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        assert next(reader.messages())[0].topic == '/left/configuration'
        stamps = [
            (m[1], STORE.deserialize_cdr(m[2], FIELD).magnetic_field.z)
            for m in reader.messages([c for c in reader.connections if c.topic.endswith('_12/field')])
        ]
    assert counts['/left/magnetic/coordinates'] == counts['/left/magnetometer_1/field'] == 10
    assert [z for _, z in stamps] == exact[:10, 11].tolist()
    # Its own output replays to itself.
    replay(tmp_path / 'out', configuration(), tmp_path / 'again')
    a, b = (read_estimate(tmp_path / name).models['magnetic'] for name in ('out', 'again'))
    np.testing.assert_array_equal(a.coordinates, b.coordinates)


def test_two_arms_in_one_bag_are_refused(tmp_path, exact):
    with Writer(tmp_path / 'in', version=9) as bag:
        for arm in ('left', 'right'):
            topic = bag.add_connection(f'/{arm}/magnetometer_1/field', FIELD, typestore=STORE)
            bag.write(topic, T0, field_message(T0, of_z(1e-4)))
    with pytest.raises(Sesa2Error, match='namespaces /left/ and /right/'):
        replay(tmp_path / 'in', configuration(), tmp_path / 'out')


def test_the_command_and_a_bag_without_fields(tmp_path, exact, capsys):
    bag = write_fields(tmp_path / 'in', exact)
    assert main(['replay', str(bag), '--config', str(CONFIG), '--out', str(tmp_path / 'out')]) == 0
    assert '80 sweeps of 2.0 s' in capsys.readouterr().out
    with Writer(tmp_path / 'none', version=9) as writer:
        topic = writer.add_connection('/imu_1/mag', FIELD, typestore=STORE)
        writer.write(topic, T0, field_message(T0, of_z(1e-4)))
    arguments = ['replay', str(tmp_path / 'none'), '--config', str(CONFIG), '--out', str(tmp_path / 'never')]
    assert main(arguments) == 1
    said = capsys.readouterr().err
    assert 'no message of a magnetometer, expected topics magnetometer_1/field' in said
    assert 'Traceback' not in said
    assert not (tmp_path / 'never').exists()
