"""Commands over recordings, end to end: align, evaluate, view, budget and twin, as a user calls them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sesa2.bags.definitions import POSE_ARRAY
from sesa2.bags.reading import read_poses
from sesa2.bags.writing import new_bag
from sesa2.cli import main
from sesa2.configuration import files, validate
from sesa2.evaluation.bag_evaluation import evaluate_bag
from sesa2.messages.cdr import CdrLayout
from sesa2.messages.imu_messages import TYPE, ImuMessages
from sesa2.sensing.imu.error_model import SOURCES
from sesa2.shape.rotations import IDENTITY, from_rotation_vector, multiply, rotate
from sesa2.system.virtual_source import make_virtual_boards
from sesa2.twin.trial import Trial

START_NS = 1_700_000_000 * 10**9
IDS = [1, 2, 3, 4]
TILT = np.deg2rad([[2.0, 0.0, 0.0], [0.0, -1.5, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])


@pytest.fixture
def config(tmp_path):
    c = validate(
        {
            'arm': {'length': 0.4},
            'imus': {'ids': IDS, 'positions': [0.1, 0.2, 0.3, 0.4]},
            'markers': {'names': ['A', 'B'], 'positions': [0.2, 0.4]},
            'models': ['pcc', 'spline'],
            'links': 8,
        }
    )
    path = tmp_path / 'arm.yaml'
    path.write_text(files.dump(c))
    return path


def bending(t):
    """An arm that swings in two planes at unrelated rates: q_WL (n, 4, 4) at times t (n,)."""
    part = np.arange(1, 5) / 4.0
    bend = np.stack([0.9 * np.sin(1.3 * t), 1.1 * np.sin(0.7 * t + 1.0), 0.0 * t], axis=-1)
    return from_rotation_vector(bend[:, None, :] * part[:, None])


def recording(path, t, q_WS):
    """A bag of what four IMUs measured at times t, s."""
    with new_bag(path) as bag:
        topics = [bag.add_topic(f'/imu_{i}/data', TYPE) for i in IDS]
        for k, now in enumerate(t):
            for n, i in enumerate(IDS):
                stamp = START_NS + round(now * 1e9) + n * 500_000
                bag.write(topics[n], stamp, ImuMessages(f'imu_{i}').make(stamp, q_WS[k, n]))
    return path


def mounted(q_WL):
    return multiply(q_WL, from_rotation_vector(TILT))


def test_align_finds_the_mountings_in_a_straight_pose(tmp_path, config, capsys):
    t = np.arange(200) / 50.0
    bag = recording(tmp_path / 'pose', t, mounted(np.tile(IDENTITY, (len(t), 4, 1))))
    out = tmp_path / 'aligned.yaml'
    assert main(['align', str(bag), '--config', str(config), '--out', str(out)]) == 0
    assert 'IMU' in capsys.readouterr().out
    found = files.load(out).mountings
    np.testing.assert_allclose(found, from_rotation_vector(TILT), atol=1e-6)
    assert main(['align', str(bag), '--config', str(config), '--out', str(out)]) == 1
    assert 'exists already' in capsys.readouterr().err


def test_align_warns_of_mountings_far_from_those_configured(tmp_path, config, capsys):
    t = np.arange(200) / 50.0
    lying = multiply(
        np.tile([0.5**0.5, 0.0, 0.0, 0.5**0.5], (len(t), 4, 1)), from_rotation_vector([0.01, 0.0, 0.0])
    )
    bag, out = recording(tmp_path / 'pose', t, lying), tmp_path / 'aligned.yaml'
    assert main(['align', str(bag), '--config', str(config), '--out', str(out)]) == 0
    told = capsys.readouterr().err
    assert 'tilted far from those configured (IMU' in told
    assert 'arm.base_orientation' in told


def test_align_refuses_what_goes_nowhere_before_it_works(tmp_path, config, capsys):
    t = np.arange(200) / 50.0
    bag = recording(tmp_path / 'pose', t, np.tile(IDENTITY, (len(t), 4, 1)))
    for out, told in (
        (tmp_path / 'no/such/a.yaml', 'cannot be written'),
        (tmp_path / 'b.yaml', '--headings is for'),
    ):
        options = ['--self', '--headings'] if 'headings' in told else []
        assert main(['align', str(bag), *options, '--config', str(config), '--out', str(out)]) == 1
        assert told in capsys.readouterr().err


def test_align_refuses_an_arm_that_moved_and_writes_nothing(tmp_path, config, capsys):
    t = np.arange(500) / 50.0
    bag = recording(tmp_path / 'moved', t, bending(t))
    out = tmp_path / 'aligned.yaml'
    assert main(['align', str(bag), '--config', str(config), '--out', str(out)]) == 1
    assert 'the arm moved' in capsys.readouterr().err
    assert not out.exists()


def test_self_calibration_makes_the_mountings_better(tmp_path, config, capsys):
    t = np.arange(3000) / 50.0
    bag = recording(tmp_path / 'motion', t, mounted(bending(t)))
    out = tmp_path / 'calibrated.yaml'
    assert main(['align', str(bag), '--self', '--config', str(config), '--out', str(out)]) == 0
    assert '±' in capsys.readouterr().out
    left = multiply(files.load(out).mountings, from_rotation_vector(-TILT))
    assert np.linalg.norm(left[:, :2]) < 0.9 * np.linalg.norm(np.sin(TILT / 2))


def test_orientations_in_a_csv_give_what_a_bag_gives(tmp_path, config):
    t = np.arange(100) / 50.0
    q = mounted(bending(t))
    columns = [f'imu_{i}_{axis}' for i in IDS for axis in 'wxyz']
    lines = [','.join(['note', 'time_s', *columns])]
    for now, row in zip(t, q[..., [3, 0, 1, 2]], strict=True):
        lines.append(f'x,{START_NS * 1e-9 + now:.3f},' + ','.join(f'{v:.12f}' for v in row.ravel()))
    lines[50] = lines[50].rsplit(',', 4)[0] + ',,,nan,'  # the last IMU has not measured
    csv = tmp_path / 'frames.csv'
    csv.write_text('\n'.join(lines))
    bag = recording(tmp_path / 'bag', t, q)
    for source in (csv, bag):
        out = tmp_path / f'{source.stem}_estimate'
        assert main(['replay', str(source), '--config', str(config), '--out', str(out)]) == 0
    ours, theirs = (read_poses(tmp_path / f'{name}_estimate', 'pcc/markers') for name in ('frames', 'bag'))
    row = np.round((ours.times_s - START_NS * 1e-9) * 50.0).astype(int)
    assert len(row) == len(t) - 1  # the samples of a sweep that is not whole are dropped
    assert len(theirs.times_s) == len(t)
    np.testing.assert_allclose(ours.positions, theirs.positions[row], atol=1e-9)


def test_evaluate_finds_offset_and_frame_and_prints_what_the_design_says(tmp_path, config, capsys):
    t = np.arange(1500) / 50.0
    bag, estimate = recording(tmp_path / 'motion', t, bending(t)), tmp_path / 'estimate'
    assert main(['replay', str(bag), '--config', str(config), '--out', str(estimate)]) == 0
    poses = read_poses(estimate, 'pcc/markers')
    turn, shift = from_rotation_vector([0.0, 0.0, 0.4]), np.array([0.3, -0.1, 1.0])
    truth = tmp_path / 'mocap.csv'
    rows = rotate(turn, poses.positions) + shift
    lines = ['time_s,A_x,A_y,A_z,B_x,B_y,B_z']
    seconds = poses.times_s - poses.times_s[0] + 5.25
    lines += [','.join(f'{v:.7f}' for v in (s, *row.ravel())) for s, row in zip(seconds, rows, strict=True)]
    truth.write_text('\n'.join(lines))
    capsys.readouterr()
    arguments = [str(estimate), '--truth', str(truth), '--register', 'rigid']
    assert (
        main(['evaluate', *arguments, '--models', 'pcc', '--json', '--report', str(tmp_path / 'report')]) == 0
    )
    printed = capsys.readouterr()
    figures = json.loads(printed.out)
    assert 'report: ' in printed.err
    assert set(figures) == {
        'models',
        'time_offset_s',
        'scale',
        'clock_rate',
        'clock_rate_std',
        'warnings',
        'registration',
    }
    assert set(figures['models']['pcc']['A']) == {
        'median_mm',
        'q3_mm',
        'rmse_mm',
        'median_pct',
        'q3_pct',
        'n',
    }
    assert figures['models']['pcc']['B']['median_mm'] < 0.2
    np.testing.assert_allclose(figures['time_offset_s'], 5.25 - poses.times_s[0], atol=1e-3)
    np.testing.assert_allclose(figures['registration']['translation_m'], shift, atol=1e-3)
    assert (tmp_path / 'report/index.html').exists()
    evaluation = evaluate_bag(estimate, truth, models=['pcc'], register='rigid')
    assert evaluation.to_json() == figures
    np.testing.assert_allclose(evaluation.pose.arc_lengths[[0, -1]], [0.0, 0.4])
    truth.write_text('time_s,A_x,A_y,B_x,B_y,B_z\n0.0,1,2,3,4,5\n')
    assert main(['evaluate', *arguments]) == 1
    assert 'no column A_z' in capsys.readouterr().err


@pytest.fixture
def turned_base(tmp_path, config):
    """Makes a bag of estimates in an output frame, of an arm whose base lies on its side."""
    base = from_rotation_vector([0.0, 0.5 * np.pi, 0.0])
    t = np.arange(500) / 50.0
    bag = recording(tmp_path / 'motion', t, multiply(base, bending(t)))

    def estimate(frame='base'):
        c = files.load(config)
        c = replace(
            c,
            models=('pcc',),
            arm=replace(c.arm, base_orientation=tuple(base.tolist()), output_frame=frame),
        )
        path, out = tmp_path / f'{frame}.yaml', tmp_path / frame / 'estimate'
        path.write_text(files.dump(c))
        out.parent.mkdir()
        assert main(['replay', str(bag), '--config', str(path), '--out', str(out)]) == 0
        return out

    return estimate


def truth_bag(path, frame, poses):
    """Markers as a bag of truth in that frame."""
    stamps = np.round(poses.times_s * 1e9).astype(np.int64)
    seven = np.zeros((*poses.positions.shape[:2], 7))
    seven[..., :3], seven[..., 6] = poses.positions, 1.0
    with new_bag(path) as bag:
        topic = bag.add_topic('/truth/markers', POSE_ARRAY)
        layout = CdrLayout().header(frame).uint32(2).doubles(14).template()
        for stamp, row in zip(stamps, layout.make(stamps, seven.reshape(len(stamps), -1)), strict=True):
            bag.write(topic, int(stamp), row.tobytes())
    return path


@pytest.mark.parametrize(
    ('estimated_in', 'true_in', 'other'), [('base', 'world', 'world'), ('world', 'base_link', 'base')]
)
def test_a_truth_in_the_other_frame_is_turned_by_the_base(
    tmp_path, turned_base, capsys, estimated_in, true_in, other
):
    truth = truth_bag(tmp_path / 'truth', true_in, read_poses(turned_base(other), 'pcc/markers'))
    estimate = turned_base(estimated_in)
    capsys.readouterr()
    assert main(['evaluate', str(estimate), '--truth', str(truth), '--time-offset', '0', '--json']) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)['models']['pcc']['B']['median_mm'] < 0.01
    assert f'The truth is in frame {true_in}' in printed.err
    assert 'was turned by arm.base_orientation' in printed.err


def test_a_truth_in_a_frame_that_is_not_known_is_warned_of(tmp_path, turned_base, capsys):
    estimate = turned_base()
    truth = truth_bag(tmp_path / 'truth', 'laboratory', read_poses(estimate, 'pcc/markers'))
    arguments = ['evaluate', str(estimate), '--truth', str(truth), '--time-offset', '0']
    capsys.readouterr()
    assert main(arguments) == 0
    assert 'in frame laboratory, the estimate in base_link: the way' in capsys.readouterr().err
    assert main([*arguments, '--register', 'rigid']) == 0
    assert 'laboratory' not in capsys.readouterr().err


def test_bags_of_one_name_are_told_apart(tmp_path, turned_base, capsys, monkeypatch):
    one, other = turned_base('base'), turned_base('world')
    truth = tmp_path / 'TRUTH.CSV'
    poses = read_poses(one, 'pcc/markers')
    rows = np.column_stack([poses.times_s, poses.positions[:, 0]])
    truth.write_text('time_s,A_x,A_y,A_z\n' + '\n'.join(','.join(f'{v:.6f}' for v in row) for row in rows))
    arguments = ['--truth', str(truth), '--time-offset', '0']
    capsys.readouterr()
    assert main(['evaluate', str(one), str(other), *arguments, '--json']) == 0
    printed = capsys.readouterr()
    assert list(json.loads(printed.out)) == ['base/estimate', 'world/estimate']
    assert list(json.loads(printed.out)['base/estimate']['models']['pcc']) == ['A']
    assert 'base/estimate: TRUTH.CSV: B is not in it and is not evaluated; there are A' in printed.err
    monkeypatch.chdir(one)
    assert main(['evaluate', '.', *arguments]) == 0
    assert capsys.readouterr().out.startswith('estimate: time offset +0.0 ms')
    assert main(['evaluate', '.', str(one), *arguments]) == 1
    assert 'given 2 times' in capsys.readouterr().err


def test_a_time_offset_is_auto_or_a_number(capsys):
    with pytest.raises(SystemExit):
        main(['evaluate', 'bag', '--truth', 'x.csv', '--time-offset', 'abc'])
    assert "got 'abc', expected auto or a number of seconds" in capsys.readouterr().err


def test_offsets_between_clocks_are_in_seconds_and_what_was_not_scored_is_a_dash(
    tmp_path, turned_base, capsys
):
    estimate = turned_base()
    poses = read_poses(estimate, 'pcc/markers')
    rows = np.column_stack([poses.times_s - START_NS / 1e9, poses.positions.reshape(-1, 6)]).astype(str)
    rows[len(rows) // 4 :, 4:] = ''
    truth = tmp_path / 'truth.csv'
    header = 'time_s,A_x,A_y,A_z,B_x,B_y,B_z'
    truth.write_text('\n'.join([header, *(','.join(row) for row in rows)]))
    capsys.readouterr()
    arguments = ['--truth', str(truth), '--time-offset=-1.7e9', '--register', 'translation']
    assert main(['evaluate', str(estimate), *arguments]) == 0
    printed = capsys.readouterr()
    assert 'time offset -1700000000.0000 s' in printed.out
    assert printed.out.splitlines()[-1].split() == ['pcc', 'B', '–', '–', '–', '0']
    assert 'pcc has nothing to score at B.' in printed.err


def test_evaluate_refuses_a_bag_without_a_configuration(tmp_path, capsys):
    bag = recording(tmp_path / 'motion', np.arange(5) / 50.0, bending(np.arange(5) / 50.0))
    assert main(['evaluate', str(bag), '--truth', str(tmp_path / 'none.csv')]) == 1
    assert 'has no topic configuration' in capsys.readouterr().err


def test_view_writes_one_page(tmp_path, config, capsys):
    pytest.importorskip('viser', reason='the extra viewer is not installed')
    t = np.arange(100) / 50.0
    bag, estimate, page = (
        recording(tmp_path / 'motion', t, bending(t)),
        tmp_path / 'estimate',
        tmp_path / 'arm.html',
    )
    assert main(['replay', str(bag), '--config', str(config), '--out', str(estimate)]) == 0
    assert main(['view', str(estimate), '--html', str(page)]) == 0
    assert page.read_text().lstrip().lower().startswith('<!doctype html')
    assert main(['view', str(bag), '--html', str(tmp_path / 'other.html')]) == 1
    assert main(['view', str(estimate), '--html', str(page)]) == 1
    assert 'exists already' in capsys.readouterr().err


def test_budget_names_every_source(config, capsys):
    assert main(['budget', '--config', str(config), '--samples', '200']) == 0
    printed = capsys.readouterr().out
    for source in ('mounting', 'heading', 'latency'):
        assert source in printed
    assert main(['budget', '--config', str(config), '--samples', '200', '--json']) == 0
    json.loads(capsys.readouterr().out)


def test_a_twin_is_replayed_and_evaluated_against_its_own_truth(tmp_path, config, capsys):
    pytest.importorskip('elastica', reason='the extra sim is not installed')
    trial, estimate = tmp_path / 'trial', tmp_path / 'estimate'
    twin = ['twin', '--config', str(config), '--seconds', '6', '--seed', '3']
    perfect = [f'{source}=0' for sources in SOURCES.values() for source in sources]

    def medians(out, estimate, offset, *errors):
        """Median distances of the spline from the truth, in per cent of the arc length."""
        assert main([*twin, '--out', str(out), *(a for e in errors for a in ('--error', e))]) == 0
        assert main(['replay', str(out), '--config', str(config), '--out', str(estimate)]) == 0
        capsys.readouterr()
        assert main(['evaluate', str(estimate), '--truth', str(out), '--time-offset', offset, '--json']) == 0
        figures = json.loads(capsys.readouterr().out)['models']['spline']
        return np.array([figures[name]['median_pct'] for name in 'AB'])

    # Four perfect IMUs leave what a spline through them cannot know: 0.7 % of this motion.
    exact = medians(tmp_path / 'perfect', tmp_path / 'exact', '0', *perfect)
    assert (exact < 1.2).all()
    usual = medians(trial, estimate, '-0.02')
    assert (usual > 1.2 * exact).all()
    assert (usual < 5.0).all()
    # The truth is that of its time: seen a second late it is another.
    assert main(['evaluate', str(estimate), '--truth', str(trial), '--time-offset', '1', '--json']) == 0
    late = json.loads(capsys.readouterr().out)['models']['spline']
    assert late['B']['median_pct'] > 2.0 * usual[1]
    c = files.load(config)
    [board] = make_virtual_boards(replace(c, run=replace(c.run, trial=str(trial))))
    with board:
        np.testing.assert_allclose(
            board.truth(np.array([3.0]))[0], Trial.load(trial / 'trial.npz').motion(3.0)
        )
    assert main([*twin, '--out', str(trial)]) == 1
    assert 'exists already' in capsys.readouterr().err
