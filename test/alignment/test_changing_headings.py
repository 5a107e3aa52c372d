"""Headings that change within a recording: found as such, and never made into a correction that does harm."""

import re

import numpy as np
import pytest
from moving_arm import measure, moving_arm, tip_error

from sesa2.alignment.self_calibration import self_calibrate
from sesa2.cli import main
from sesa2.configuration import files, validate
from sesa2.sensing.imu.mounting import Mounting
from sesa2.shape.models import create_model
from sesa2.shape.rotations import IDENTITY, from_rotation_vector, multiply

HARMLESS = 1.1  # times the error before, at most
N = 8
DISTURBANCES = {
    'of all in the second half': lambda u: 20.0 * (u > 0.5) * np.ones(N),
    'small, of all': lambda u: 8.0 * (u > 0.5) * np.ones(N),
    'of the outer half, in the first third': lambda u: 25.0 * (u < 0.33) * (np.arange(N) > 3),
    'of one': lambda u: 30.0 * (u > 0.5) * (np.arange(N) == 3),
    'along the arm, like a twist': lambda u: 30.0 * (u > 0.5) * np.arange(N) / (N - 1),
    'that comes and goes': lambda u: 20.0 * np.exp(-0.5 * ((u - 0.5) / 0.12) ** 2) * np.ones(N),
    'each by its own': lambda u: 12.0 * (u > 0.5) * np.sin(np.arange(N) * 2.3),
}


def disturbed(seed, degrees=None, **options):
    """A moving arm, what was measured on it, and true headings; `degrees` of the part of the recording, 0 to 1."""
    rng = np.random.default_rng(seed)
    motion = moving_arm(rng, **{'bend': 1.5, **options})
    q, errors = measure(rng, motion.links)
    psi = np.zeros(q.shape[:2])
    if degrees is not None:
        psi += np.deg2rad(degrees((np.arange(len(q)) / len(q))[:, None]))
    return motion, multiply(from_rotation_vector(psi[..., None] * [0.0, 0.0, 1.0]), q), errors.heading + psi


def calibrate(motion, q):
    n = q.shape[1]
    return self_calibrate(
        motion.stamps, q, np.ones(q.shape[:2], bool), motion.layout, motion.base, np.tile(IDENTITY, (n, 1)), np.zeros(n)
    )  # fmt: skip


@pytest.mark.parametrize('what', DISTURBANCES)
@pytest.mark.parametrize('seconds', [100.0, 20.0])
def test_a_disturbance_is_refused_or_does_no_harm(what, seconds):
    motion, q, _ = disturbed(200, DISTURBANCES[what], seconds=seconds)
    found = calibrate(motion, q)
    model = create_model('spline', motion.layout)
    links = Mounting(found.mountings, found.headings).link_orientations(q)
    if found.disturbance(range(1, N + 1)) is None:
        assert tip_error(model, links, motion) < HARMLESS * tip_error(model, q, motion)
    # Nor is it taken for a twist of the arm.
    assert np.rad2deg(found.twist) < 3.0


def test_the_change_is_found_and_the_sentence_names_it():
    motion, q, true = disturbed(201, DISTURBANCES['of one'])
    found = calibrate(motion, q)
    np.testing.assert_allclose(np.rad2deg(found.wander), np.rad2deg(true.std(axis=0)), atol=2.0)
    np.testing.assert_allclose(np.rad2deg(found.headings), np.rad2deg(true.mean(axis=0)), atol=2.0)
    sentence = found.disturbance((1, 2, 3, 7, 5, 6, 4, 8))
    assert re.match(r'headings changed within the recording: IMU 7 by 1[345]° rms about the mean, ', sentence)
    assert 'IMU 4' not in sentence
    assert re.search(r'about (4[4-9]|5[0-5]) s into it', sentence)


@pytest.mark.parametrize(
    'options',
    [{}, {'n_imu': 4}, {'n_imu': 2}, {'twist': 0.4}, {'seconds': 20.0}, {'seconds': 200.0},
     {'base': np.array([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)])}],
    ids=['plain', '4 IMUs', '2 IMUs', 'twisting', 'short', 'long', 'lying'],
)  # fmt: skip
def test_a_sound_recording_is_not_refused(options):
    for seed in (300, 301):
        motion, q, _ = disturbed(seed, **options)
        found = calibrate(motion, q)
        assert found.disturbance(range(1, q.shape[1] + 1)) is None
        assert found.misfit < 0.25


def test_the_command_writes_no_file_and_says_why(tmp_path, capsys):
    out = tmp_path / 'aligned.yaml'
    for what, code in ((None, 0), ('of one', 1)):
        motion, q, _ = disturbed(202, DISTURBANCES.get(what), seconds=40.0)
        (tmp_path / 'arm.yaml').write_text(
            files.dump(
                validate(
                    {
                        'arm': {'length': 0.66},
                        'imus': {
                            'ids': list(range(1, N + 1)),
                            'positions': [float(s) for s in motion.layout.imu_positions],
                            'enabled': [True] * N,
                        },
                    }
                )
            )
        )
        header = ','.join(['time_s', *(f'imu_{i}_{a}' for i in range(1, N + 1) for a in 'xyzw')])
        table = np.column_stack([motion.stamps, q.reshape(len(q), -1)])
        np.savetxt(tmp_path / 'in.csv', table, delimiter=',', header=header, comments='')
        arguments = [
            'align',
            str(tmp_path / 'in.csv'),
            '--config',
            str(tmp_path / 'arm.yaml'),
            '--out',
            str(out),
        ]
        assert main([*arguments, '--self']) == code
        said = capsys.readouterr()
        assert 'misfit 0.' in said.out
        assert out.exists() == (code == 0)
        out.unlink(missing_ok=True)
    assert 'error: headings changed within the recording: IMU 4 by 1' in said.err
    assert 'Nothing is written' in said.err
    assert 'Traceback' not in said.err
