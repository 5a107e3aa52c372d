"""Errors of sensors learnt from known points, and scored on others."""

from dataclasses import replace

import numpy as np
import pytest
import slipping_arm as arm
from scipy.spatial.transform import Rotation

from sesa2.bags.recorded_sweeps import RecordedSweeps
from sesa2.bags.writing import new_bag
from sesa2.cli import main
from sesa2.configuration import files, validate
from sesa2.errors import Sesa2Error
from sesa2.evaluation.known_points import learn_from_points
from sesa2.evaluation.measured_instants import MeasuredInstants, at_truth, shape_at
from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.messages.imu_messages import TYPE, ImuMessages


def held_out(c, racks=True):
    """Median error of the tip on poses that nothing was learnt from, m."""
    made = arm.made(300, 99, racks=racks, noise=0.0)
    p, _ = shape_at(c, 'pcc_delta', MeasuredInstants.of(made.sweeps, c), np.array([arm.REST]))
    return float(np.median(np.linalg.norm(p - made.truth.positions, axis=-1)))


def changed(truth, change):
    return Trajectory(truth.times, change(truth.positions), truth.names)


@pytest.mark.parametrize('seed', range(4))
def test_ten_points_tell_a_slipping_arm(seed):
    c, made = arm.configuration(), arm.made(10, seed)
    learnt = learn_from_points(c, made.sweeps, made.truth)
    assert (learnt.points, learnt.instants) == (10, 10)
    assert learnt.after < 0.3 * learnt.before
    assert held_out(c) > 0.010
    assert held_out(learnt.configuration) < 0.0015
    told = {u.name: (v, s) for u, v, s in learnt.told}
    # The model's `heading` takes the heading off by itself: the points tell nothing of it, and it is left alone.
    assert [u.name for u, _ in learnt.untold] == ['IMU 1: heading']
    assert learnt.configuration.imus.headings == (0.0,)
    true = {
        'IMU 1: mounting about x': arm.MOUNT[0],
        'IMU 1: mounting about y': arm.MOUNT[1],
        'affine curvature': arm.AFFINE,
        'slip by bend': arm.SLIP[0],
        'slip by stretch': arm.SLIP[1],
        'slip always': arm.SLIP[2],
    }
    for name, value in true.items():
        got, std = told[name]
        assert abs(got - value) < 3.5 * std, name
        assert 0.0 < std < 0.12


@pytest.mark.parametrize('seed', range(2))
def test_a_length_on_the_axis_has_a_scale_and_an_offset(seed):
    c, made = arm.configuration(racks=False), arm.made(10, seed, racks=False)
    learnt = learn_from_points(c, made.sweeps, made.truth)
    assert held_out(c, racks=False) > 0.006
    assert held_out(learnt.configuration, racks=False) < 0.0015
    (scale,), (offset,) = learnt.configuration.lengths.scales, learnt.configuration.lengths.offsets
    told = {u.name: s for u, _, s in learnt.told}
    assert abs(scale - 1.04) < 3.5 * told['string: scale']
    assert abs(offset + 0.005) < 3.5 * told['string: offset']
    assert learnt.configuration.options['pcc_delta'].slip == (0.0, 0.0, 0.0)


def test_an_imu_on_the_base_is_learnt_as_well():
    c = arm.configuration()
    c = replace(c, imus=replace(c.imus, base_id=8))
    askew = np.deg2rad([2.0, -1.5, 0.0])
    made = arm.made(25, 6, base_mount=askew)
    learnt = learn_from_points(c, made.sweeps, made.truth)
    told = {u.name: (v, s) for u, v, s in learnt.told}
    for axis, value in zip('xy', askew, strict=False):
        got, std = told[f'IMU 8: mounting about {axis}']
        assert abs(got - value) < 3.5 * std
    left = Rotation.from_quat(learnt.configuration.base_mounting).inv() * Rotation.from_rotvec(askew)
    assert np.rad2deg(np.linalg.norm(left.as_rotvec()[:2])) < 0.8
    other = arm.made(200, 7, base_mount=askew, noise=0.0)
    # The sweeps were read with the configuration that is corrected.
    whole = MeasuredInstants.of(other.sweeps, c)
    off = [
        np.median(
            np.linalg.norm(
                shape_at(k, 'pcc_delta', whole, np.array([arm.REST]))[0] - other.truth.positions, axis=-1
            )
        )
        for k in (c, learnt.configuration)
    ]
    assert off[1] < 0.2 * off[0]


def test_an_arm_that_does_not_move_tells_nothing():
    made = arm.made(12, 3)
    straight = np.argsort(np.linalg.norm(made.truth.positions[:, 0, :2], axis=-1))[:1]
    sweeps = made.sweeps.chosen(np.repeat(straight, 6))._replace(stamps_ns=made.sweeps.stamps_ns[:6])
    truth = Trajectory(made.truth.times[:6], np.repeat(made.truth.positions[straight], 6, axis=0), ('tip',))
    truth = changed(truth, lambda p: p + 1e-3 * np.random.default_rng(0).normal(size=p.shape))
    with pytest.raises(Sesa2Error, match='correlation'):
        learn_from_points(arm.configuration(), sweeps, truth)


def test_what_a_few_alike_points_do_not_tell_is_said_and_left():
    made = arm.made(1000, 1)
    flat = np.flatnonzero(np.abs(made.truth.positions[:, 0, :2]).max(axis=-1) < 0.02)[:8]
    truth = Trajectory(made.truth.times[flat], made.truth.positions[flat], ('tip',))
    c = arm.configuration()
    learnt = learn_from_points(c, made.sweeps, truth)
    untold = {u.name for u, _ in learnt.untold}
    assert {'slip by bend', 'IMU 1: heading'} <= untold
    slip = learnt.configuration.options['pcc_delta'].slip
    assert slip[0] == 0.0
    assert slip[2] != 0.0
    for u, std in learnt.untold:
        assert std > 0.7 * u.expected
    assert held_out(learnt.configuration) < held_out(c)


def test_a_wrong_point_among_ten_is_told_and_hardly_counts():
    made = arm.made(10, 5)
    p = made.truth.positions.copy()
    p[4, 0] += [0.0, 0.05, 0.0]
    learnt = learn_from_points(arm.configuration(), made.sweeps, Trajectory(made.truth.times, p, ('tip',)))
    assert any('1 of 10 points disagree' in doubt for doubt in learnt.doubts)
    assert held_out(learnt.configuration) < 0.003


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (lambda p: p * [1.0, -1.0, 1.0], 'mirror image'),
        (lambda p: 100.0 * p, 'not in metres'),
        (lambda p: 3.2808 * p, 'not in metres|nothing that can be learnt explains'),
        (lambda p: p[..., [2, 0, 1]], 'seems turned by 12[0-9]°; --register rigid fits that'),
        (lambda p: p + np.array([0.3, 0.0, 0.0]), 'nothing that can be learnt explains the truth'),
        (lambda p: np.random.default_rng(3).permutation(p), 'does not move as the arm does|mirror'),
    ],
)
def test_a_wrong_truth_is_refused(change, message):
    made = arm.made(12, 2)
    with pytest.raises(EvaluationError, match=message):
        learn_from_points(arm.configuration(), made.sweeps, changed(made.truth, change))


def test_millimetres_are_converted_and_said():
    made = arm.made(12, 2)
    learnt = learn_from_points(arm.configuration(), made.sweeps, changed(made.truth, lambda p: 1e3 * p))
    assert any('millimetres' in note for note in learnt.notes)
    assert held_out(learnt.configuration) < 0.0015


@pytest.mark.parametrize('register', ['translation', 'rigid'])
def test_frames_that_differ_are_fitted_besides(register):
    made = arm.made(20, 2)
    turn = Rotation.from_rotvec([0.3, -0.5, 1.2] if register == 'rigid' else [0.0, 0.0, 0.0])
    truth = changed(made.truth, lambda p: turn.apply(p[:, 0])[:, None] + [0.4, -1.0, 2.0])
    learnt = learn_from_points(arm.configuration(), made.sweeps, truth, register=register)
    assert learnt.after < 0.003
    # With the frames free the tilt of the IMU is hidden in them: judged as far as shapes go.
    assert held_out(learnt.configuration) < 0.008
    assert {u.name for u, _, _ in learnt.told} >= {'affine curvature', 'slip by stretch'}


def test_too_few_points_are_refused():
    made = arm.made(3, 2)
    with pytest.raises(EvaluationError, match='3 points to learn from, expected at least 4'):
        learn_from_points(arm.configuration(), made.sweeps, made.truth)


def test_instants_that_no_sweep_is_near_are_counted():
    made = arm.made(12, 2)
    times = made.truth.times + np.where(np.arange(12) < 2, 1.0, 0.0)
    truth = Trajectory(times, made.truth.positions, ('tip',))
    learnt = learn_from_points(arm.configuration(), made.sweeps, truth)
    assert learnt.instants == 10
    assert any(note.startswith('2 of 12 instants of the truth not used') for note in learnt.notes)


def test_lengths_that_are_not_recorded_are_refused():
    made = arm.made(10, 2)
    with pytest.raises(EvaluationError, match='no lengths of backbones'):
        learn_from_points(arm.configuration(), made.sweeps._replace(lengths=None), made.truth)


def test_an_arm_of_many_imus_is_learnt_from_motion_capture(recordings):
    """The simulated trial: ten points, and the first half of the motion capture; scored on the second half."""
    path = recordings / 'twin/trial_A_bno055_seed1.npz'
    if not path.exists():
        pytest.skip(f'no {path}')
    with np.load(path) as trial:
        times, q = trial['ti'] + 1e9, trial['q'][:, 1:, [1, 2, 3, 0]]
        t100, markers = trial['t100'] + 1e9, trial['M100']
    c = replace(files.load_configuration('prototype3_8'), models=('pcc', 'spline'))
    n = len(times)
    sweeps = RecordedSweeps(
        np.round(times * 1e9).astype(np.int64),
        q,
        np.ones(q.shape[:2], bool),
        np.tile(c.base, (n, 1)),
        None,
        [],
    )
    first = sweeps.chosen(np.arange(n) < n // 2)
    later = np.arange(12_600, len(t100), 10)
    later = Trajectory(t100[later], markers[later], ('M1', 'M2'))
    few = np.searchsorted(t100, 1e9 + np.linspace(5.0, 120.0, 10))

    def score(configuration, offset):
        whole = MeasuredInstants.of(sweeps, configuration)
        there = at_truth(whole, later, offset)
        p, _ = shape_at(configuration, 'spline', there, np.array([0.36, 0.60]))
        return 100.0 * np.median(np.linalg.norm(p - there.points, axis=-1), axis=0) / [0.36, 0.60]

    before = score(c, -0.02)
    for chosen, offset, better in ((few, -0.02, 0.9), (np.arange(0, 12_500, 4), None, 0.78)):
        truth = Trajectory(t100[chosen], markers[chosen], ('M1', 'M2'))
        learnt = learn_from_points(c, first, truth, time_offset=offset)
        assert learnt.model == 'spline'
        assert learnt.time_offset == pytest.approx(-0.02, abs=0.004)
        assert (score(learnt.configuration, learnt.time_offset) < better * before).all()
        assert len(learnt.told) >= 8


SEEN = {
    'arm': {'length': 0.3},
    'imus': {'ids': [1, 2], 'positions': [0.15, 0.3]},
    'markers': {'names': ['M1', 'tip'], 'positions': [0.15, 0.3]},
    'models': ['pcc_exact', 'rigid'],
}


@pytest.fixture
def trial(tmp_path):
    """A bag of two IMUs of which one is askew, and twelve points of a truth, in files."""
    rng = np.random.default_rng(4)
    askew = Rotation.from_rotvec(np.deg2rad([4.0, -3.0, 0.0]))
    maker = [ImuMessages('imu_1'), ImuMessages('imu_2')]
    lines = ['time_s,M1_x,M1_y,M1_z,tip_x,tip_y,tip_z']
    with new_bag(tmp_path / 'in') as bag:
        topics = [bag.add_topic(f'/imu_{i}/data', TYPE) for i in (1, 2)]
        for k in range(12):
            v = rng.uniform(-0.7, 0.7, (2, 2))
            first, second = (Rotation.from_rotvec([-y, x, 0.0]) for x, y in v)
            links = [first, first * second]
            ends = [arm.tips(b[None], np.array([0.15]), 0.0)[0] for b in v]
            points = [ends[0], ends[0] + first.apply(ends[1])]
            stamp = arm.T0_NS + 10**9 * k
            for i, link in enumerate([links[0] * askew, links[1]]):
                for late in range(0, 50, 10):
                    at = stamp + late * 10**6
                    bag.write(topics[i], at, maker[i].make(at, link.as_quat()))
            lines.append(','.join([f'{stamp / 1e9 + 0.02:.3f}', *(f'{x:.6f}' for x in np.ravel(points))]))
    (tmp_path / 'truth.csv').write_text('\n'.join(lines) + '\n')
    (tmp_path / 'c.yaml').write_text(files.dump(validate(SEEN)))
    return tmp_path


def test_the_command_writes_what_it_learnt_and_says_what_not(trial, capsys):
    arguments = ['align', trial / 'in', '--config', trial / 'c.yaml', '--truth', trial / 'truth.csv']
    assert main([str(a) for a in (*arguments, '--out', trial / 'c2.yaml')]) == 0
    printed = capsys.readouterr()
    assert 'by pcc_exact, median distance' in printed.out
    assert '±' in printed.out
    assert 'its clock is taken for that of the recording' in printed.err
    text = (trial / 'c2.yaml').read_text()
    assert text.startswith('# Learnt by sesa2 align --truth from truth.csv:\n#')
    assert '# not told by the points, left as it was' in text
    c = files.load(trial / 'c2.yaml')
    q = Rotation.from_quat(c.mountings)
    left = q[0].inv() * Rotation.from_rotvec(np.deg2rad([4.0, -3.0, 0.0]))
    assert np.rad2deg(left.magnitude()) < 0.4
    # That file may be the start of another alignment, which finds nothing more.
    again = ['align', trial / 'in', '--config', trial / 'c2.yaml', '--truth', trial / 'truth.csv']
    assert main([str(a) for a in (*again, '--out', trial / 'c3.yaml')]) == 0
    twice = Rotation.from_quat(files.load(trial / 'c3.yaml').mountings)
    assert np.rad2deg((twice * q.inv()).magnitude()).max() < 0.4


@pytest.mark.parametrize(
    ('more', 'message'),
    [
        (['--headings'], '--headings is for a straight pose'),
        (['--models', 'spline'], 'no model spline'),
        (['--marker', 'M1=nobody'], 'nobody'),
        (['--start', '100'], 'no sweep from 100 s on'),
        (['--time-offset', '60'], 'points to learn from'),
    ],
)
def test_the_command_refuses_and_writes_nothing(trial, capsys, more, message):
    arguments = ['align', trial / 'in', '--config', trial / 'c.yaml', '--truth', trial / 'truth.csv']
    assert main([str(a) for a in (*arguments, '--out', trial / 'c2.yaml', *more)]) == 1
    assert message in capsys.readouterr().err
    assert not (trial / 'c2.yaml').exists()
