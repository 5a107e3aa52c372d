"""Each wrong set-up of a trial ends in a sentence that names its cause, and a sound trial in none."""

import re

import numpy as np
import pytest
import wrong_trials as wrong
from wrong_trials import ARC_LENGTHS, NAMES, MadeTrial

from sesa2.evaluation.evaluate import evaluate
from sesa2.evaluation.imu_warnings import imu_warnings
from sesa2.evaluation.trajectory import EvaluationError, Trajectory

KINDS = ('none', 'translation', 'rigid', 'offsets', 'rigid+offsets')


@pytest.fixture(scope='session')
def whole(recordings):
    file = recordings / 'twin/trial_A_bno055_seed1.npz'
    if not file.is_file():
        pytest.skip(f'no {file}')
    with np.load(file) as data:
        q = data['q'].astype(float)[:, 1:, [1, 2, 3, 0]]
        truth = Trajectory(data['t100'][::3], data['M100'][::3].astype(float), NAMES)
        return MadeTrial(wrong.configured(), data['ti'], q, truth)


@pytest.fixture(scope='session')
def trial(whole):
    """Two minutes of the simulated trial."""
    return whole.seconds(60.0, 180.0)


def told(trial, register='none'):
    evaluation = evaluate(trial.estimates, trial.truth, ARC_LENGTHS, register=register)
    there, base = np.ones(trial.q.shape[:2], bool), np.broadcast_to(trial.c.base, (len(trial.t), 4))
    imus = imu_warnings(trial.c, trial.t - trial.t[0], trial.q, there, base, evaluation.similarity)
    return [*evaluation.warnings, *imus.warnings], evaluation


@pytest.mark.parametrize('register', KINDS)
def test_a_sound_trial_ends_in_no_warning(trial, register):
    warnings, evaluation = told(trial, register)
    assert warnings == []
    assert evaluation.similarity.scale == pytest.approx(1.0, abs=0.01)
    assert abs(evaluation.similarity.clock_rate) < 3e-4


SETUPS = [
    (wrong.clamp_leans, 'none', r"truth's frame is tilted by [78]\.\d° .*the clamp leans"),
    (wrong.clamp_leans, 'translation', r"truth's frame is tilted by [78]\.\d°"),
    (wrong.aligned_on_a_leaning_clamp, 'none', 'the clamp leans'),
    (wrong.aligned_on_a_leaning_clamp, 'rigid', r'All IMUs lean in their links, the same way by [789]°'),
    (wrong.truth_tilted, 'none', r"truth's frame is tilted by [45]\.\d° .*motion capture's axes are"),
    (wrong.truth_tilted, 'translation', r"truth's frame is tilted by [45]\.\d°"),
    (
        wrong.truth_moved,
        'none',
        r"truth is moved by (19|20|21) mm .*motion capture's origin is not at the clamp",
    ),
    (
        wrong.lengths_short,
        'none',
        r"truth is [45]\.\d % larger .*lengths .* too short, or motion capture's scale",
    ),
    (wrong.lengths_short, 'rigid', r'truth is [45]\.\d % larger'),
    (wrong.clock_fast, 'none', r"truth's clock runs 0\.[01]\d\d % fast"),
    (wrong.clock_fast, 'rigid', r"truth's clock runs 0\.[01]\d\d % fast"),
    (wrong.imu_loose, 'none', r'IMU 5 seems to be loose: after 50 % of the trial .* turned by (9|10|11)°'),
    (wrong.imu_loose, 'rigid', r'IMU 5 seems to be loose'),
    (
        wrong.imu_stuck,
        'none',
        r'IMU 4 was stuck: the same quaternion for [45]\.\d s in all, first at 8\.\d s',
    ),
    (wrong.imu_stuck, 'rigid', r'IMU 4 was stuck'),
    (wrong.imu_misplaced, 'none', r'IMU 4 seems to be about (3[5-9]|4[0-5]) mm farther from the base'),
    (wrong.imu_misplaced, 'rigid', r'IMU 4 seems to be about (3[5-9]|4[0-5]) mm farther from the base'),
    (wrong.base_moves, 'none', 'All markers go astray together, by (2[5-9]|3[01]) mm rms: the base moves'),
    (wrong.base_moves, 'rigid', 'the base moves'),
    (wrong.base_knocked, 'none', 'the base moves'),
    (wrong.base_knocked, 'rigid', 'the base moves'),
    (wrong.base_tilts, 'none', 'The base moves: the arm and all IMUs tilt by'),
    (wrong.conjugated, 'none', 'The quaternions are conjugated'),
    (wrong.conjugated, 'rigid', 'The quaternions are conjugated'),
]


@pytest.mark.parametrize(
    ('setup', 'register', 'sentence'), SETUPS, ids=[f'{f.__name__}-{r}' for f, r, _ in SETUPS]
)
def test_a_wrong_set_up_is_named(trial, setup, register, sentence):
    warnings, evaluation = told(setup(trial), register)
    assert any(re.search(sentence, w) for w in warnings), warnings
    assert set(evaluation.to_json()['warnings']) <= set(warnings)


@pytest.mark.parametrize('imu', [0, 1, 2, 3, 4, 5, 6])
def test_any_imu_may_be_loose(trial, imu):
    warnings, _ = told(wrong.imu_loose(trial, imu, axis='xyz'[imu % 3]))
    assert any(f'IMU {imu + 1} seems to be loose' in w for w in warnings), warnings


@pytest.mark.parametrize('imu', [0, 1, 2, 3, 4, 5])
def test_all_but_the_last_two_may_be_elsewhere(trial, imu):
    warnings, _ = told(wrong.imu_misplaced(trial, imu, 0.04))
    assert any(re.search(rf'IMU {imu + 1} seems to be about \d\d mm nearer to the base', w) for w in warnings)


def test_a_mirrored_truth_is_named(trial):
    with pytest.raises(EvaluationError, match=r'mirror image .* --register rigid scores it mirrored'):
        told(wrong.mirrored(trial))
    for register in ('rigid', 'rigid+offsets'):
        warnings, evaluation = told(wrong.mirrored(trial), register)
        assert warnings == [evaluation.warnings[0]]
        assert 'The truth is a mirror image of the estimate' in warnings[0]


def test_a_frame_that_differs_by_half_a_turn_is_not_blamed_on_the_imus(trial):
    half = trial.moved(trial.truth.positions * (-1.0, -1.0, 1.0))
    warnings, _ = told(half, 'rigid')
    assert not any('are conjugated:' in w for w in warnings)


def test_the_whole_trial_is_sound_and_its_clock_is_told(whole):
    assert told(whole)[0] == []
    warnings, evaluation = told(wrong.clock_fast(whole, -1e-3))
    assert len(warnings) == 1
    assert re.search(r"truth's clock runs 0\.\d+ % slow .*: 2\d\d ms", warnings[0])
    assert evaluation.to_json()['clock_rate'] == pytest.approx(-1e-3, abs=1e-4)


@pytest.mark.parametrize('register', ['none', 'rigid'])
def test_half_a_minute_and_a_bit_tells_a_clock(whole, register):
    warnings, _ = told(wrong.clock_fast(whole.seconds(60.0, 105.0)), register)
    assert any(re.search(r"truth's clock runs 0\.[01]\d\d % fast", w) for w in warnings), warnings
