import re
from dataclasses import replace

import numpy as np
import pytest
from twin_recording import write_twin_recording
from wrong_trials import MadeTrial, configured, imu_misplaced

from sesa2.bags.replay import replay
from sesa2.cli import main
from sesa2.configuration import validate
from sesa2.evaluation.bag_evaluation import evaluate_bag, in_one_frame
from sesa2.evaluation.trajectory import Trajectory


def test_an_imu_on_the_base_leaves_the_way_between_the_frames_unknown():
    c = validate({'arm': {'length': 0.4}, 'imus': {'ids': [1], 'positions': [0.2], 'base_id': 8}})
    c = replace(c, arm=replace(c.arm, base_orientation=(1.0, 0.0, 0.0, 0.0)))
    truth = Trajectory([0.0, 1.0], np.ones((2, 1, 3)), ('A',))
    same, told = in_one_frame(truth, 'world', c, 'base_link', 'none')
    assert same is truth
    assert 'the way from one to the other is not known' in told[0]


def test_a_bag_is_evaluated_from_python(cases):
    """Without a command; the figures are those that the simulated trial's own truth gives."""
    evaluation = evaluate_bag(cases / '00-common/est10', cases / '00-common/trial10', register='rigid')
    medians = [error.median_mm for error in evaluation.models['pcc'].values()]
    assert list(evaluation.models['pcc']) == ['M1', 'M2']
    assert medians == pytest.approx([18.4, 18.9], abs=0.5)
    assert evaluation.pose is not None


@pytest.fixture(scope='module')
def replayed(recordings, tmp_path_factory):
    """A minute of the simulated trial: its estimates with all that was measured, and its truth."""
    file = recordings / 'twin/trial_A_bno055_seed1.npz'
    if not file.is_file():
        pytest.skip(f'no {file}')
    folder = tmp_path_factory.mktemp('replayed')
    write_twin_recording(file, folder / 'trial', seconds=60.0)
    with np.load(file) as data:
        seen = data['t100'] < 60.0
        times, markers = data['t100'][seen][::4], data['M100'][seen][::4].reshape(-1, 6)
    head = 'time_s,M1_x,M1_y,M1_z,M2_x,M2_y,M2_z'
    np.savetxt(
        folder / 'truth.csv', np.column_stack([times, markers]), delimiter=',', header=head, comments=''
    )
    replay(folder / 'trial', configured(models=('spline',)), folder / 'sound')
    return folder


def test_a_sound_bag_ends_in_no_warning(replayed, capsys):
    arguments = ['evaluate', str(replayed / 'sound'), '--truth', str(replayed / 'truth.csv')]
    for register in ('none', 'rigid', 'rigid+offsets'):
        assert main([*arguments, '--register', register]) == 0
        printed = capsys.readouterr()
        assert printed.err == ''
    assert re.search(
        r'registration rigid\+offsets: rotation by \d\.\d\d° about \(.*\), translation .* mm, markers beside the axis',
        printed.out,
    )
    assert re.search(
        r'not applied: scale [01]\.\d{4} ± 0\.\d{4}, clock rate [+-]\d+ ± \d+ ppm would fit best', printed.out
    )


def test_what_the_imus_in_a_bag_tell_is_told(replayed, tmp_path):
    """One IMU is configured elsewhere; replay and evaluation are right about everything else."""
    c = imu_misplaced(MadeTrial(configured(models=('spline',)), None, None, None)).c
    replay(replayed / 'trial', c, tmp_path / 'wrong')
    evaluation = evaluate_bag(tmp_path / 'wrong', replayed / 'truth.csv')
    assert any('IMU 4 seems to be about' in w for w in evaluation.warnings)
    assert not any('go astray together' in w for w in evaluation.warnings)  # the cause is known
    assert evaluation.to_json()['warnings'] == list(evaluation.warnings)


def test_a_bag_without_imus_is_evaluated_by_its_markers(replayed, tmp_path):
    c = configured(models=('spline',))
    replay(replayed / 'trial', replace(c, record=replace(c.record, imu=False)), tmp_path / 'bare')
    assert evaluate_bag(tmp_path / 'bare', replayed / 'truth.csv').warnings == ()
