"""`sesa2 magnets` on builds that are not as described: bags and CSV files of what they read."""

from dataclasses import replace

import numpy as np
import pytest
from paper_arm import NOISE

from sesa2.bags.writing import new_bag
from sesa2.cli import main
from sesa2.configuration import files
from sesa2.messages.field_messages import FIELD_TYPE, FieldMessages
from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings
from sesa2.sensing.magnetometry.ring_magnet import RingMagnet
from sesa2.shape.coordinate_fit import CoordinateFit
from sesa2.shape.rotations import from_rotation_vector, multiply

T0 = 1_700_000_000_000_000_000
EARTH = np.array([20e-6, -10e-6, 45e-6])
RATE = 40.0  # Hz


def predictor_of(name):
    return files.load_configuration(str(name)).create_model('magnetic').predictor


def built(predictor, rng, **ring):
    """As somebody builds it: nothing is quite as described, and there is the earth's field."""
    p, m = predictor, predictor.magnetometers
    n = len(p.names)
    magnets = tuple(
        replace(k, **{'remanence': k.remanence * (1 + 0.02 * rng.normal()), **ring})
        for k in p.magnets.magnets
    )
    sensors = replace(
        m,
        radii=m.radii + 0.2e-3 * rng.normal(size=n),
        axial_offsets=0.2e-3 * rng.normal(size=n),
        mountings=multiply(m.mountings, from_rotation_vector(0.01 * rng.normal(size=(n, 3)) * [1, 1, 0])),
        gains=1.0 + 0.01 * rng.normal(size=n),
        offsets=1e-6 * rng.normal(size=len(p.noise)),
    )
    positions = p.magnets.positions + 0.2e-3 * rng.normal(size=len(magnets))
    return MagneticReadings(
        p.limits, replace(p.magnets, magnets=magnets, positions=positions), sensors, EARTH
    )


def readings(real, shapes, rng):
    """Of z alone, (n, n_sensors)."""
    return real.predict(shapes).readings + NOISE * rng.normal(size=(len(shapes), len(real.noise)))


def write_csv(path, times, u, ids, unit='', factor=1.0):
    head = ','.join(['time_s', *(f'magnetometer_{i}{unit}' for i in ids)])
    np.savetxt(
        path, np.column_stack([times, factor * u]), delimiter=',', header=head, comments='', fmt='%.9g'
    )
    return path


def write_bag(path, times, u, ids):
    with new_bag(path) as bag:
        makers = {i: FieldMessages(f'magnetometer_{i}') for i in ids}
        topics = {i: bag.add_topic(f'/left/magnetometer_{i}/field', FIELD_TYPE) for i in ids}
        stamps = T0 + np.round(times * 1e9).astype(np.int64)
        for k, i in enumerate(ids):
            fields = np.full((len(times), 3), np.nan)
            fields[:, 2] = u[:, k]
            for stamp, data in zip(stamps.tolist(), makers[i].make_fields(stamps, fields), strict=True):
                bag.write(topics[i], stamp, data.tobytes())
    return path


def with_earth(tmp_path, name):
    """A shipped configuration that knows the earth's field."""
    c = files.load_configuration(name)
    path = tmp_path / f'{name}_earth.yaml'
    path.write_text(
        files.dump(replace(c, magnetometers=replace(c.magnetometers, earth_field=tuple(EARTH.tolist()))))
    )
    return path


def shape_errors(predictor, real, seed=9):
    """Median error of the bends of drawn shapes, rad."""
    rng = np.random.default_rng(seed)
    q = real.limits.draw(200, rng)
    found = CoordinateFit(predictor).fit(readings(real, q, rng)).coordinates
    return float(np.median(np.abs(found - q)[:, :2]))


@pytest.mark.parametrize('kind', ['bag', 'csv'])
def test_a_straight_pose(tmp_path, capsys, kind):
    config, rng = with_earth(tmp_path, 'magnetic_1'), np.random.default_rng(3)
    described = predictor_of(config)
    real = built(described, rng)
    times = np.arange(100) / RATE
    u = readings(real, np.tile(described.limits.kinematics.rest, (100, 1)), rng)
    write = write_bag if kind == 'bag' else write_csv
    source = write(tmp_path / f'straight{"" if kind == "bag" else ".csv"}', times, u, [1, 2, 3])
    out = tmp_path / 'out.yaml'
    assert main(['magnets', str(source), '--config', str(config), '--out', str(out), '--straight']) == 0
    said = capsys.readouterr()
    assert 'hardly told by these shapes: ' in said.out
    assert 'earth_field x' in said.out
    assert said.err == ''
    assert out.read_text().startswith('# Calibrated by sesa2 magnets:\n# 1 shapes, 3 readings: off by ')
    assert shape_errors(predictor_of(out), real) < 0.4 * shape_errors(described, real)


def poses_of(tmp_path, name, n, seed):
    """Poses held for 1 s each with 0.5 s between, in which the arm moves; their file, the shapes and their times."""
    limits, rng = predictor_of(name).limits, np.random.default_rng(seed)
    held = limits.draw(n, rng)
    times = np.arange(int(1.5 * n * RATE)) / RATE
    k = np.minimum((times / 1.5).astype(int), n - 1)
    part = np.clip((times - 1.5 * k - 1.0) / 0.5, 0.0, 1.0)[:, None]
    shapes = held[k] + part * (held[np.minimum(k + 1, n - 1)] - held[k])
    names = limits.kinematics.coordinate_names
    lines = [', '.join(['start_s', 'end_s', *names])]
    lines += [', '.join(f'{v:.9g}' for v in (1.5 * i, 1.5 * i + 0.98, *q)) for i, q in enumerate(held)]
    path = tmp_path / 'poses.csv'
    path.write_text('# by hand\n' + '\n'.join(lines) + '\n')
    return path, shapes, times


def test_poses_by_hand(tmp_path, capsys):
    """Earth's field not known; in millitesla, as the column says."""
    rng, described = np.random.default_rng(4), predictor_of('magnetic_1')
    real = built(described, rng)
    poses, shapes, times = poses_of(tmp_path, 'magnetic_1', 20, 1)
    u = readings(real, shapes, rng)
    source = write_csv(tmp_path / 'log.csv', 77.7 + times, u, [1, 2, 3], ' [mT]', 1e3)
    out = tmp_path / 'out.yaml'
    arguments = ['magnets', str(source), '--config', 'magnetic_1', '--out', str(out), '--poses', str(poses)]
    assert main([*arguments, '--bend-error', '0', '--length-error', '0']) == 0
    assert '20 shapes, 60 readings: off by' in capsys.readouterr().out
    found = predictor_of(out)
    np.testing.assert_allclose(found.earth_field, EARTH, atol=6e-6)
    assert shape_errors(found, real) < 0.3 * shape_errors(described, real)  # the noise alone leaves a fifth


def truth_csv(path, c, shapes, times, offset=0.0, scale=1.0, noise=2e-4):
    """Markers of the configuration by scipy's rotations of arcs, as motion capture has them."""
    from paper_arm import PaperArm

    arm = PaperArm(len(c.segments.lengths))
    rng = np.random.default_rng(6)
    points = [
        arm._pose(shapes, s)[0] + noise * rng.normal(size=(len(shapes), 3)) for s in c.markers.positions
    ]
    head = ','.join(['time_s', *(f'{name}_{axis}' for name in c.markers.names for axis in 'xyz')])
    np.savetxt(
        path,
        np.column_stack([times + offset, *(scale * p for p in points)]),
        delimiter=',',
        header=head,
        comments='',
    )
    return path


def moving(limits, seconds, seed):
    """Smooth motion that does not repeat itself."""
    rng, times = np.random.default_rng(seed), np.arange(int(seconds * RATE)) / RATE
    q = np.tile(limits.kinematics.rest, (len(times), 1))
    for i, scale in enumerate(limits.scales):
        f, phase = rng.uniform(0.05, 0.4, 4), rng.uniform(0.0, 6.0, 4)
        wave = np.sin(2 * np.pi * f * times[:, None] + phase).mean(axis=1)
        q[:, i] += 0.8 * scale * wave if i % 3 < 2 else 0.4 * scale * (wave + 0.5)
    return times, limits.clip(q)


def test_motion_capture_of_another_clock(tmp_path, capsys):
    c, rng, described = (
        files.load_configuration('magnetic_3'),
        np.random.default_rng(5),
        predictor_of('magnetic_3'),
    )
    real = built(described, rng)
    times, shapes = moving(described.limits, 60.0, 2)
    source = write_csv(tmp_path / 'log.csv', times, readings(real, shapes, rng), range(1, 13))
    fine, dense = moving(described.limits, 60.0, 2)
    truth = truth_csv(tmp_path / 'truth.csv', c, dense, fine, offset=12.3456, scale=1e3)
    out = tmp_path / 'out.yaml'
    arguments = ['magnets', str(source), '--config', 'magnetic_3', '--out', str(out), '--truth', str(truth)]
    assert main(arguments) == 0
    said = capsys.readouterr()
    assert 'time offset +12.34' in said.err
    assert 'millimetres' in said.err
    found = predictor_of(out)
    np.testing.assert_allclose(found.earth_field, EARTH, atol=6e-6)
    assert shape_errors(found, real) < 0.2 * shape_errors(described, real)


def test_a_magnet_that_nobody_knows(tmp_path, capsys):
    """Described as 12 mm wide and 1.45 T, it is 15 mm and 1.1 T."""
    rng, described = np.random.default_rng(7), predictor_of('magnetic_1')
    real = built(described, rng, outer_diameter=0.015, remanence=1.1)
    poses, shapes, times = poses_of(tmp_path, 'magnetic_1', 40, 2)
    source = write_csv(tmp_path / 'log.csv', times, readings(real, shapes, rng), [1, 2, 3])
    out = tmp_path / 'out.yaml'
    arguments = ['magnets', str(source), '--config', 'magnetic_1', '--out', str(out), '--poses', str(poses)]
    assert main([*arguments, '--fit-magnet', '--bend-error', '0', '--length-error', '0']) == 0
    assert 'magnet: moments ' in capsys.readouterr().out
    found = predictor_of(out)
    assert shape_errors(found, real) < 0.01
    first = RingMagnet(0.006, 0.015, 0.006, 1.1).moments(1)[0]
    assert found.magnets.magnets[0].moments(1)[0] == pytest.approx(first, rel=0.05)


def drifting(u):
    return u + 30e-6 * np.linspace(0.0, 1.0, len(u))[:, None]


@pytest.mark.parametrize(
    ('change', 'said'),
    [
        (drifting, 'magnetometer 1: the readings scatter by'),
        (lambda u: u[:5], 'magnetometer 1: 5 readings, expected at least 10'),
        (lambda u: 1e3 * u, 'they seem to be in mT, expected tesla'),
        (lambda u: 1e4 * u, 'they seem to be in gauss, expected tesla'),
        (lambda u: 1e6 * u, 'they seem to be in µT, expected tesla'),
        (lambda u: -u, 'poles or sensors are the other way round'),
        (
            lambda u: 4.0 * u,
            'times what the magnets give, expected about 1: other magnets (diameters, not radii',
        ),
        (lambda u: 0.0 * u, 'times what the magnets give, expected about 1'),
    ],
)
def test_readings_that_cannot_be(tmp_path, capsys, change, said):
    rng, described = np.random.default_rng(3), predictor_of('magnetic_1')
    u = change(readings(described, np.tile(described.limits.kinematics.rest, (100, 1)), rng))
    source = write_csv(tmp_path / 'log.csv', np.arange(len(u)) / RATE, u, [1, 2, 3])
    out = tmp_path / 'out.yaml'
    assert main(['magnets', str(source), '--config', 'magnetic_1', '--out', str(out), '--straight']) == 1
    error = capsys.readouterr().err
    assert said in error
    assert 'Traceback' not in error
    assert not out.exists()


@pytest.mark.parametrize(
    ('columns', 'said'),
    [
        (
            't,a,b\n0,1,2\n',
            '1 columns of time and 0 of magnetometers; expected topics magnetometer_<id>/field',
        ),
        ('time_s,magnetometer_7\n0,1\n1,1\n', 'no reading of the magnetometers 1, 2, 3; it has those of 7'),
        ('time_s,magnetometer_1_z,magnetometer_1\n0,1,2\n', 'magnetometer_1 is there a second time'),
        ('time_s,magnetometer_1\n0,x\n', 'log.csv'),
    ],
)
def test_files_that_cannot_be(tmp_path, capsys, columns, said):
    source = tmp_path / 'log.csv'
    source.write_text(columns)
    out = str(tmp_path / 'out.yaml')
    assert main(['magnets', str(source), '--config', 'magnetic_1', '--out', out, '--straight']) == 1
    error = capsys.readouterr().err
    assert said in error
    assert 'Traceback' not in error


@pytest.mark.parametrize(
    ('lines', 'said'),
    [
        ('start_s,end_s\n0,1\n', 'no column segment_1_bend_x'),
        ('', 'no pose, expected start_s'),
        (
            'start_s,end_s,segment_1_bend_x,segment_1_bend_y,segment_1_length\n0,1,30,0,0.11\n',
            'rad and m, not degrees',
        ),
        (
            'start_s,end_s,segment_1_bend_x,segment_1_bend_y,segment_1_length\n1,0,0,0,0.11\n',
            'pose 1 is from 1 to 0 s',
        ),
        (
            'start_s,end_s,segment_1_bend_x,segment_1_bend_y,segment_1_length\n0,1,0,0\n',
            'a field that is no number',
        ),
        (
            'start_s,end_s,segment_1_bend_x,segment_1_bend_y,segment_1_length\n8,9,0,0,0.11\n',
            'magnetometer 1: 0 readings, expected at least 10',
        ),
    ],
)
def test_poses_that_cannot_be(tmp_path, capsys, lines, said):
    rng, described = np.random.default_rng(3), predictor_of('magnetic_1')
    u = readings(described, np.tile(described.limits.kinematics.rest, (100, 1)), rng)
    source = write_csv(tmp_path / 'log.csv', np.arange(100) / RATE, u, [1, 2, 3])
    poses, out = tmp_path / 'poses.csv', tmp_path / 'out.yaml'
    poses.write_text(lines)
    arguments = ['magnets', str(source), '--config', 'magnetic_1', '--out', str(out), '--poses', str(poses)]
    assert main(arguments) == 1
    error = capsys.readouterr().err
    assert said in error
    assert 'Traceback' not in error
    assert not out.exists()


def test_shapes_that_are_others_than_they_are_said_to_be(tmp_path, capsys):
    """Half of the poses are given another's shape."""
    rng, described = np.random.default_rng(4), predictor_of('magnetic_1')
    poses, shapes, times = poses_of(tmp_path, 'magnetic_1', 10, 1)
    lines = poses.read_text().splitlines()
    ends = [line.split(', ', 2)[2] for line in lines[2:]]
    moved = [
        ', '.join(line.split(', ', 2)[:2]) + ', ' + end
        for line, end in zip(lines[2:], ends[::-1], strict=True)
    ]
    poses.write_text('\n'.join([*lines[:2], *moved]) + '\n')
    source = write_csv(tmp_path / 'log.csv', times, readings(described, shapes, rng), [1, 2, 3])
    out = tmp_path / 'out.yaml'
    arguments = ['magnets', str(source), '--config', 'magnetic_1', '--out', str(out), '--poses', str(poses)]
    assert main(arguments) == 1
    assert 'times what is expected: the shapes, or what the magnets' in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (['--config', 'prototype3_8', '--straight'], 'has no magnetometers'),
        (['--config', 'magnetic_1', '--straight', '--fit-magnet'], '--fit-magnet needs several shapes'),
    ],
)
def test_what_does_not_go_together(tmp_path, capsys, arguments, said):
    assert main(['magnets', 'x', '--out', str(tmp_path / 'out.yaml'), *arguments]) == 1
    assert said in capsys.readouterr().err


def test_those_that_are_masked_stay_as_they_were(tmp_path):
    c = files.load_configuration('magnetic_3')
    config = tmp_path / 'masked.yaml'
    section = replace(c.magnetometers, masked=(2, 5, 9), earth_field=tuple(EARTH.tolist()))
    config.write_text(files.dump(replace(c, magnetometers=section)))
    described, rng = predictor_of(config), np.random.default_rng(8)
    real = built(described, rng)
    rest = np.tile(described.limits.kinematics.rest, (50, 1))
    source = write_csv(
        tmp_path / 'log.csv', np.arange(50) / RATE, readings(real, rest, rng), described.magnetometers.ids
    )
    out = tmp_path / 'out.yaml'
    assert main(['magnets', str(source), '--config', str(config), '--out', str(out), '--straight']) == 0
    after = files.load_configuration(str(out)).magnetometers
    assert [after.gains[i] for i in (1, 4, 8)] == [1.0] * 3
    assert [after.radii[i] for i in (1, 4, 8)] == [0.013] * 3
    assert after.gains[0] != 1.0
    assert after.masked == (2, 5, 9)


def test_on_a_base_that_lies_the_earth_is_in_the_world(tmp_path):
    lying = from_rotation_vector(np.array([0.4, 1.2, 0.1]))
    c, rng = files.load_configuration('magnetic_1'), np.random.default_rng(4)
    c = replace(c, arm=replace(c.arm, base_orientation=tuple(lying.tolist())))
    config = tmp_path / 'lying.yaml'
    config.write_text(files.dump(c))
    described = predictor_of(config)
    real = MagneticReadings(described.limits, described.magnets, described.magnetometers, EARTH)
    poses, shapes, times = poses_of(tmp_path, config, 20, 1)
    u = real.predict(shapes, lying).readings + NOISE * rng.normal(size=(len(shapes), 3))
    source, out = write_csv(tmp_path / 'log.csv', times, u, [1, 2, 3]), tmp_path / 'out.yaml'
    arguments = ['magnets', str(source), '--config', str(config), '--out', str(out), '--poses', str(poses)]
    assert main([*arguments, '--bend-error', '0', '--length-error', '0']) == 0
    np.testing.assert_allclose(predictor_of(out).earth_field, EARTH, atol=6e-6)
