"""`sesa2 twin`: the errors that are asked for are those that the simulated sensors make."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from sesa2.cli import main
from sesa2.configuration import files, validate
from sesa2.sensing.imu.error_model import Bno055Errors
from sesa2.twin.trial import Trial

# Times of correlation cannot be 0; without a size they mean nothing.
NONE = [
    argument
    for field in fields(Bno055Errors)
    if not field.name.endswith('_time')
    for argument in ('--error', f'{field.name}=0')
]


@pytest.fixture
def twin(tmp_path):
    """Simulates a second of an arm with two IMUs; the arguments, and whether a trial was made."""
    config, out = tmp_path / 'arm.yaml', tmp_path / 'trial'
    values = {'arm': {'length': 0.3}, 'imus': {'ids': [1, 4], 'positions': [0.15, 0.3]}}
    config.write_text(files.dump(validate(values)))

    def run(*arguments):
        code = main(['twin', '--config', str(config), '--out', str(out), '--seconds', '1', *arguments])
        return code, out

    return run


def off(trial):
    """Rotation vectors from the truth to what was measured, (n_sweeps, n_imu, 3), rad; no mountings are configured."""
    turns = []
    for i in range(2):
        true = Slerp(trial.times, Rotation.from_quat(trial.orientations[:, i]))(trial.stamps[:, i])
        turns.append((true.inv() * Rotation.from_quat(trial.measured[:, i])).as_rotvec())
    return np.stack(turns, axis=1)


def test_without_errors_the_sensors_say_the_truth(twin):
    pytest.importorskip('elastica', reason='the extra sim is not installed')
    code, out = twin(*NONE)
    assert code == 0
    trial = Trial.load(out / 'trial.npz')
    assert len(trial.stamps) > 80
    np.testing.assert_allclose(off(trial), 0.0, atol=1e-7)


def test_an_error_is_as_large_as_asked_for(twin):
    pytest.importorskip('elastica', reason='the extra sim is not installed')
    code, out = twin(*NONE, '--error', 'white=0.05')
    assert code == 0
    noise = off(Trial.load(out / 'trial.npz'))
    # Of n numbers the standard deviation is known to σ / √2n: four times that.
    assert noise.std() == pytest.approx(0.05, rel=4.0 / np.sqrt(2.0 * noise.size))
    assert abs(noise.mean()) < 4.0 * 0.05 / np.sqrt(noise.size)


@pytest.mark.parametrize('error', ['humidity=1', 'white', 'white=', 'white=-1', 'white=nan', 'white=much'])
def test_an_error_that_cannot_be_is_refused_before_anything_is_made(twin, error, capsys):
    code, out = twin('--error', error)
    assert code == 1
    said = capsys.readouterr().err
    assert f'--error {error}: expected SOURCE=VALUE' in said
    assert 'heading_wander, latency' in said
    assert not out.exists()


def test_a_trial_is_never_written_over(twin, capsys):
    _, out = twin('--error', 'humidity=1')
    out.mkdir()
    assert twin()[0] == 1
    assert f'{out}: exists already' in capsys.readouterr().err
    assert list(out.iterdir()) == []


@pytest.fixture
def growing(tmp_path, capsys):
    """Simulates an arm that grows, replays it and compares both; the errors that `evaluate` prints."""

    def run(change, *arguments):
        config = tmp_path / 'growing.yaml'
        c = files.load_configuration('tri_backbone')
        config.write_text(files.dump(replace(c, plant=replace(c.plant, **change))))
        trial, out = tmp_path / 'grown', tmp_path / 'estimate'
        given = ['--config', str(config), '--seconds', '20', '--seed', '2', *arguments]
        assert main(['twin', '--out', str(trial), *given]) == 0
        assert main(['replay', str(trial), '--config', str(config), '--out', str(out)]) == 0
        capsys.readouterr()
        assert main(['evaluate', str(out), '--truth', str(trial), '--time-offset', '0', '--json']) == 0
        return json.loads(capsys.readouterr().out)

    return run


def test_an_ideal_arm_that_grows_comes_back_to_the_last_digit(growing):
    """The plant's geometry, lengths and IMUs in a bag, and models that stretch, with nothing but a clock in common."""
    ideal = dict.fromkeys(('slip', 'affine', 'affine_spread', 'hollow', 'sag', 'encoder_step'), 0.0)
    told = growing(ideal, *NONE)
    assert all(marker['rmse_mm'] < 0.01 for model in told['models'].values() for marker in model.values())
    assert not [w for w in told['warnings'] if 'frame' in w]


def test_an_arm_that_slips_does_not(growing):
    told = growing({'slip': 0.85})
    assert 3.0 < told['models']['pcc_delta']['tip']['rmse_mm'] < 60.0


def test_an_arm_that_grows_has_no_hand_that_twists_it(tmp_path, capsys):
    out = tmp_path / 'trial'
    assert main(['twin', '--config', 'tri_backbone', '--out', str(out), '--twist', '0.1']) == 1
    assert '--twist: ' in capsys.readouterr().err
    assert not out.exists()
