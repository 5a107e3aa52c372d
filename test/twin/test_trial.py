"""Trials as files, and played back."""

from dataclasses import fields

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.shape.rotations import conjugate, multiply, to_rotation_vector
from sesa2.twin.trial import Trial, TrialError


@pytest.fixture
def trial():
    rng = np.random.default_rng(2)
    times = np.arange(50) * 0.005
    turn = Rotation.from_rotvec(times[:, None] * [1.0, 2.0, 0.5]).as_quat()
    arrays = {item.name: rng.normal(size=(4, 2)) for item in fields(Trial)}
    arrays |= {
        'times': times,
        'imu_positions': np.array([0.1, 0.2]),
        'orientations': np.stack([turn, -turn], axis=1),
        'marker_names': np.array(['M1', 'Höhe']),
        'sensor_ids': np.array([1, 2]),
    }
    return Trial(**arrays)


def test_what_is_saved_is_loaded(trial, tmp_path):
    trial.save(tmp_path / 'a.npz')
    again = Trial.load(tmp_path / 'a.npz')
    for item in fields(Trial):
        np.testing.assert_array_equal(getattr(again, item.name), getattr(trial, item.name))
        assert getattr(again, item.name).dtype == getattr(trial, item.name).dtype


def test_motion_is_the_truth_at_any_time(trial):
    at = np.array([-1.0, 0.0, 0.0123, 0.2, 9.0])
    played = trial.motion(at)
    true = Rotation.from_rotvec(np.clip(at, 0.0, 0.245)[:, None] * [1.0, 2.0, 0.5]).as_quat()[:, None]
    assert np.abs(to_rotation_vector(multiply(conjugate(true), played))).max() < 1e-12
    assert trial.motion(0.0123).shape == (2, 4)
    np.testing.assert_array_equal(trial.motion(0.0123), played[2])


def test_a_file_that_exists_is_left_alone(trial, tmp_path):
    path = tmp_path / 'a.npz'
    path.write_text('precious')
    with pytest.raises(TrialError, match='exists already'):
        trial.save(path)
    assert path.read_text() == 'precious'
    with pytest.raises(TrialError, match='No such file'):
        trial.save(tmp_path / 'missing' / 'a.npz')


def test_what_is_no_trial_is_refused(trial, tmp_path):
    with pytest.raises(TrialError, match='cannot be read: No such file'):
        Trial.load(tmp_path / 'none.npz')
    for name, content in (('text.npz', b'hello'), ('empty.npz', b'')):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(TrialError, match='cannot be read'):
            Trial.load(tmp_path / name)
    trial.save(tmp_path / 'a.npz')
    whole = (tmp_path / 'a.npz').read_bytes()
    (tmp_path / 'cut.npz').write_bytes(whole[: len(whole) // 2])
    with pytest.raises(TrialError, match='cannot be read'):
        Trial.load(tmp_path / 'cut.npz')
    np.savez(tmp_path / 'other.npz', times=trial.times)
    with pytest.raises(TrialError, match='lacks base, imu_positions, '):
        Trial.load(tmp_path / 'other.npz')
    np.save(tmp_path / 'single.npy', trial.times)
    with pytest.raises(TrialError, match=r'single\.npy cannot be read'):
        Trial.load(tmp_path / 'single.npy')
