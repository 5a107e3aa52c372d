import json
import re
import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.evaluation.evaluate import evaluate
from sesa2.evaluation.trajectory import EvaluationError, Trajectory

ARC_LENGTHS = {'M1': 0.36, 'M2': 0.60}
TURN = Rotation.from_euler('z', 11.0, degrees=True)
SHIFT = np.array([0.3, -0.2, 1.0])


def changed(trajectory, positions, offset=0.0):
    return Trajectory(trajectory.times + offset, positions, trajectory.names)


def in_another_frame(trajectory, offset=0.0):
    p = TURN.apply(trajectory.positions.reshape(-1, 3).copy()).reshape(trajectory.positions.shape) + SHIFT
    return changed(trajectory, p, offset)


@pytest.fixture
def estimate(motion):
    return motion.record(31.0)


@pytest.fixture
def truth(motion):
    return motion.record(100.0)


def test_json_is_what_the_design_fixes(estimate, truth):
    got = evaluate({'pcc': estimate, 'rigid': estimate}, truth, ARC_LENGTHS, register='rigid').to_json()
    again = json.loads(json.dumps(got, allow_nan=False))
    assert again == got
    assert list(got) == [
        'models',
        'time_offset_s',
        'scale',
        'clock_rate',
        'clock_rate_std',
        'warnings',
        'registration',
    ]
    assert list(got['models']) == ['pcc', 'rigid']
    assert list(got['models']['pcc']) == ['M1', 'M2']
    assert list(got['models']['pcc']['M1']) == ['median_mm', 'q3_mm', 'rmse_mm', 'median_pct', 'q3_pct', 'n']
    assert list(got['registration']) == ['kind', 'translation_m', 'rotation_xyzw', 'fitted_on_s']


def test_without_registration_everything_is_scored(estimate, truth):
    got = evaluate({'pcc': estimate}, truth, ARC_LENGTHS, time_offset=0.0).to_json()
    assert got['registration'] == {
        'kind': 'none',
        'translation_m': [0.0, 0.0, 0.0],
        'rotation_xyzw': [0.0, 0.0, 0.0, 1.0],
        'fitted_on_s': None,
    }
    inside = (truth.times <= estimate.times[-1]).sum()
    assert got['models']['pcc']['M1']['n'] == inside
    assert got['models']['pcc']['M2']['median_mm'] < 0.2  # what interpolating 31 Hz linearly leaves


def test_known_errors_are_measured(estimate, truth):
    off = estimate.positions + np.array([[0.003, 0.004, 0.0], [0.0, 0.0, 0.012]])
    errors = evaluate({'pcc': changed(estimate, off)}, truth, ARC_LENGTHS, time_offset=0.0).models['pcc']
    assert errors['M1'].median_mm == pytest.approx(5.0, abs=0.05)
    assert errors['M2'].rmse_mm == pytest.approx(12.0, abs=0.05)
    assert errors['M2'].median_pct == pytest.approx(2.0, abs=0.01)


def test_the_signs_of_offset_and_registration(estimate, truth):
    got = evaluate(
        {'pcc': estimate}, in_another_frame(truth, 100.0), ARC_LENGTHS, register='rigid', fit_fraction=0.3
    )
    assert got.time_offset.seconds == pytest.approx(100.0, abs=1e-3)
    assert (Rotation.from_quat(got.registration.rotation) * TURN.inv()).magnitude() < 1e-3
    np.testing.assert_allclose(got.registration.translation, SHIFT, atol=1e-3)
    assert got.models['pcc']['M2'].q3_mm < 1.0
    start, end = got.registration.fitted_on
    assert start == pytest.approx(100.0, abs=0.011)
    assert end == pytest.approx(100.0 + 0.3 * estimate.duration, abs=0.03)
    assert got.models['pcc']['M1'].times[0] > end
    assert got.models['pcc']['M1'].n == pytest.approx(0.7 * len(truth.times), abs=5)


def test_what_was_fitted_is_not_scored(estimate, truth):
    # the markers slip after the part that was fitted: the fit cannot hide it
    slip = np.clip((truth.times - 31.0) / 2.0, 0.0, 1.0)[:, None, None] * (0.03, 0.0, 0.0)
    p = truth.positions + slip
    got = evaluate({'pcc': estimate}, changed(truth, p), ARC_LENGTHS, register='translation', time_offset=0.0)
    assert got.models['pcc']['M1'].median_mm == pytest.approx(30.0, abs=0.2)


def test_a_worse_model_beside_it_changes_nothing(estimate, truth):
    rng = np.random.default_rng(0)
    good = changed(estimate, estimate.positions + rng.normal(0.0, 1e-3, estimate.positions.shape))
    bad = changed(estimate, estimate.positions + 0.05 + rng.normal(0.0, 0.02, estimate.positions.shape))
    alone = evaluate({'good': good}, truth, ARC_LENGTHS, register='rigid')
    both = evaluate({'bad': bad, 'good': good}, truth, ARC_LENGTHS, register='rigid')
    assert both.time_offset_from == both.registration_from == 'good'
    assert both.to_json()['models']['good'] == alone.to_json()['models']['good']
    assert both.models['bad']['M2'].median_mm > 50.0


def test_markers_are_matched_by_name(estimate, truth):
    exchanged = Trajectory(truth.times, truth.positions[:, ::-1], ('M2', 'M1'))
    assert evaluate({'pcc': estimate}, exchanged, ARC_LENGTHS).models['pcc']['M1'].median_mm < 0.2


def test_one_marker_is_enough(estimate, truth):
    got = evaluate({'pcc': estimate}, in_another_frame(truth), {'M2': 0.6}, register='rigid')
    assert got.models['pcc']['M2'].q3_mm < 1.0


def test_gaps_are_neither_scored_nor_bridged(estimate, truth):
    keep = (estimate.times < 20.0) | (estimate.times > 25.0)
    p = truth.positions.copy()
    p[3000:3300, 0] = np.nan
    broken = Trajectory(estimate.times[keep], estimate.positions[keep], estimate.names)
    got = evaluate({'pcc': broken}, changed(truth, p), ARC_LENGTHS, time_offset=0.0)
    times = got.models['pcc']['M1'].times
    assert not ((times > 20.01) & (times < 24.99)).any()
    assert not ((times >= 30.0) & (times < 33.0)).any()
    assert got.models['pcc']['M2'].n - got.models['pcc']['M1'].n == 300
    assert 'M1 was not seen (or left out) in 300 of 6000 samples of the truth.' in got.warnings
    before, after = estimate.times[estimate.times < 20.0][-1], estimate.times[estimate.times > 25.0][0]
    lost = ((truth.times > before) & (truth.times < after)).sum()
    assert f'pcc has gaps: no estimate of M2 for {lost} of 6000 samples.' in got.warnings


def test_what_was_wrong_with_the_truth_is_said(estimate, truth):
    p = 1e3 * truth.positions
    p[100:150] = p[100:150, ::-1]
    p[700, 1] += 400.0
    got = evaluate({'pcc': estimate}, changed(truth, p), ARC_LENGTHS)
    assert got.models['pcc']['M2'].rmse_mm < 0.5
    assert 'The truth is in millimetres; it was converted to metres.' in got.warnings
    assert (
        'Markers had changed places in the truth; left out: 50 samples of M1, 50 samples of M2.'
        in got.warnings
    )
    assert 'Markers jumped in the truth; left out: 1 samples of M2.' in got.warnings


def test_an_exchange_after_a_gap_is_not_scored(estimate, truth):
    p = truth.positions.copy()
    p[3000:3150] = np.nan
    p[3150:5000] = p[3150:5000, ::-1]
    got = evaluate({'pcc': estimate}, in_another_frame(changed(truth, p)), ARC_LENGTHS, register='rigid')
    assert got.models['pcc']['M1'].n < 1100
    assert got.models['pcc']['M1'].rmse_mm < 0.5
    assert (
        'Markers had changed places in the truth; left out: 1850 samples of M1, 1850 samples of M2.'
        in got.warnings
    )


def test_markers_whose_names_are_exchanged_are_told(estimate, truth):
    got = evaluate({'pcc': estimate}, changed(truth, truth.positions[:, ::-1]), ARC_LENGTHS, time_offset=0.0)
    assert (
        'M1 and M2 seem to be exchanged in all of the truth: with their names exchanged it fits much better.'
        in got.warnings
    )


@pytest.mark.parametrize('time_offset', [None, 0.0])
@pytest.mark.parametrize(('register', 'told'), [('none', True), ('translation', True), ('rigid', False)])
def test_frames_that_differ_are_told(estimate, truth, register, told, time_offset):
    flipped = changed(truth, truth.positions * (-1.0, 1.0, -1.0))
    got = evaluate({'pcc': estimate}, flipped, ARC_LENGTHS, register=register, time_offset=time_offset)
    told_of = [
        w for w in got.warnings if re.search(r'--register rigid the median error would be 0\.\d mm', w)
    ]
    assert len(told_of) == told


def test_errors_that_no_rotation_explains_are_not_blamed_on_the_frames(estimate, truth):
    off = np.random.default_rng(0).normal(0.0, 0.1, estimate.positions.shape)
    got = evaluate({'pcc': changed(estimate, estimate.positions + off)}, truth, ARC_LENGTHS, time_offset=0.0)
    assert got.models['pcc']['M2'].median_pct > 15.0
    assert got.warnings == ()


def test_figures_of_few_samples_are_warned_of(estimate, truth):
    got = evaluate(
        {'pcc': estimate}, truth, ARC_LENGTHS, register='rigid', fit_fraction=0.999, time_offset=0.0
    )
    n = got.models['pcc']['M1'].n
    assert 0 < n < 30
    told = f'Only {n} samples of M1 are scored with pcc, expected at least 30: its figures are chance.'
    assert told in got.warnings


def test_a_marker_that_is_seen_only_while_fitting_has_no_figures(estimate, truth):
    p = truth.positions.copy()
    p[2900:, 0] = np.nan
    got = evaluate({'pcc': estimate}, changed(truth, p), ARC_LENGTHS, register='translation').to_json()
    assert got['models']['pcc']['M1'] == dict.fromkeys(
        ('median_mm', 'q3_mm', 'rmse_mm', 'median_pct', 'q3_pct')
    ) | {'n': 0}


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        (
            {'time_offset': 500.0},
            r'no overlap in time: with the offset of \+500\.000 s .*500\.000 to 5.*truth from 0\.000 to',
        ),
        ({'time_offset': float('nan')}, 'time offset nan s, expected a finite'),
        ({'fit_fraction': 1.0}, 'fit fraction 1.0, expected a number between 0 and 1'),
        ({'arc_lengths': {'M1': 0.0}}, 'arc length of M1 is 0.0 m'),
        ({'arc_lengths': {'M3': 0.5}}, 'no marker M3; there are M1, M2'),
        ({'arc_lengths': {}}, 'nothing to evaluate'),
        ({'register': 'affine'}, "registration 'affine'"),
    ],
)
def test_refuses(estimate, truth, options, message):
    arguments = {'arc_lengths': ARC_LENGTHS} | options
    with pytest.raises(EvaluationError, match=message):
        evaluate({'pcc': estimate}, truth, **arguments)


def test_refuses_an_estimate_with_holes(estimate, truth):
    p = estimate.positions.copy()
    p[7, 1] = np.nan
    with pytest.raises(
        EvaluationError, match=r'pcc: 1 estimated marker positions are NaN, the first M2 0\.226 s after'
    ):
        evaluate({'pcc': changed(estimate, p)}, truth, ARC_LENGTHS)


def test_refuses_to_score_nothing(estimate, truth):
    p = np.full_like(truth.positions, np.nan)
    p[3000:3002] = truth.positions[3000:3002]
    message = 'nothing is left to score after the first 50 % .* Register by none, which scores all'
    with pytest.raises(EvaluationError, match=message):
        evaluate({'pcc': estimate}, changed(truth, p), ARC_LENGTHS, register='translation', time_offset=0.0)


def test_one_still_marker_cannot_be_registered_rigidly(truth):
    still = changed(truth, np.full_like(truth.positions, 0.1)).select(('M1',))
    with pytest.raises(EvaluationError, match='lie on a point'):
        evaluate({'pcc': still}, truth, {'M1': 0.36}, register='rigid', time_offset=0.0)


def test_the_simulated_trial(twin):
    estimate, truth = twin
    began = time.perf_counter()
    got = evaluate({'tangents': estimate}, truth, ARC_LENGTHS, register='rigid')
    assert time.perf_counter() - began < 5.0  # some 0.3 s; the room is for a loaded machine
    raw = evaluate({'tangents': estimate}, truth, ARC_LENGTHS)
    inside = (truth.times > 0.1) & (truth.times < 249.9)
    for m, name in enumerate(ARC_LENGTHS):
        delayed = [
            np.interp(truth.times[inside] + 0.020, estimate.times, c) for c in estimate.positions[:, m].T
        ]
        expected = np.median(np.linalg.norm(np.transpose(delayed) - truth.positions[inside, m], axis=1))
        assert raw.models['tangents'][name].median_mm == pytest.approx(1e3 * expected, rel=0.01)
    assert got.models['tangents']['M2'].median_pct < raw.models['tangents']['M2'].median_pct
    assert got.registration.angle < 0.05
    assert raw.warnings == ()


@pytest.mark.parametrize('register', ['none', 'translation'])
def test_one_sample_is_never_scored(estimate, truth, register):
    p = np.full_like(truth.positions, np.nan)
    p[2000:2002, 0] = truth.positions[2000:2002, 0]
    p[4000, 0] = truth.positions[4000, 0]
    one = changed(truth, p)
    if register == 'none':
        p[2000:2002] = np.nan
        with pytest.raises(
            EvaluationError, match=r'nothing can be scored: .* 1 samples in common, expected at least 2'
        ):
            evaluate({'pcc': estimate}, changed(truth, p), {'M1': 0.36}, time_offset=0.0)
    else:
        with pytest.raises(EvaluationError, match=r'nothing is left to score .* Lower the fit fraction'):
            evaluate({'pcc': estimate}, one, {'M1': 0.36}, register=register, time_offset=0.0)
        # what was advised is not refused
        lower = evaluate(
            {'pcc': estimate}, one, {'M1': 0.36}, register=register, time_offset=0.0, fit_fraction=1e-6
        )
        assert lower.models['pcc']['M1'].n == 2


def test_a_marker_with_one_sample_has_no_figures(estimate, truth):
    p = truth.positions.copy()
    p[1:, 0] = np.nan
    got = evaluate({'pcc': estimate}, changed(truth, p), ARC_LENGTHS, time_offset=0.0)
    assert got.models['pcc']['M1'].n == 0
    assert 'pcc has nothing to score at M1.' in got.warnings


def test_a_registration_that_makes_it_worse_is_told(estimate, truth):
    # until the middle, what was seen is turned; out of sight in between, or it would have jumped
    p = truth.positions.copy()
    early = truth.times < 29.0
    p[(truth.times >= 29.0) & (truth.times < 31.0)] = np.nan
    p[early] = Rotation.from_euler('x', 20.0, degrees=True).apply(p[early].reshape(-1, 3)).reshape(-1, 2, 3)
    got = evaluate({'pcc': estimate}, changed(truth, p), ARC_LENGTHS, register='rigid', time_offset=0.0)
    [told] = [w for w in got.warnings if 'makes it worse' in w]
    assert re.search(r'--register rigid makes it worse: .* \d+\.\d mm, with --register none 0\.\d mm', told)


def test_a_rotation_that_cannot_be_fitted_is_not_advised(estimate, truth):
    """In the first half the markers stay on a line; on everything a rotation could be fitted."""
    still = np.array([[[0.0, 0.0, 0.36], [0.0, 0.0, 0.6]]])
    p, q = truth.positions.copy(), estimate.positions.copy()
    p[truth.times < 31.0] = still
    q[estimate.times < 31.0] = still
    flipped = changed(truth, p * (-1.0, 1.0, -1.0))
    with pytest.raises(EvaluationError, match='rigid registration cannot be found'):
        evaluate({'pcc': changed(estimate, q)}, flipped, ARC_LENGTHS, register='rigid', time_offset=0.0)
    got = evaluate({'pcc': changed(estimate, q)}, flipped, ARC_LENGTHS, time_offset=0.0)
    assert not any('--register rigid' in w for w in got.warnings)


def test_a_small_shift_of_a_good_estimate_is_told(estimate, truth):
    got = evaluate({'pcc': estimate}, changed(truth, truth.positions + 0.005), ARC_LENGTHS, time_offset=0.0)
    assert any('with --register translation the median error would be 0.' in w for w in got.warnings)


def test_scale_and_clock_rate_are_told_and_not_applied(estimate, truth):
    grown = Trajectory(100.0 + 1.002 * truth.times, 1.03 * truth.positions, truth.names)
    got = evaluate({'pcc': estimate}, in_another_frame(grown), ARC_LENGTHS, register='rigid').to_json()
    assert got['scale'] == pytest.approx(1.03, abs=1e-3)
    assert got['clock_rate'] == pytest.approx(2e-3, rel=0.02)
    assert got['models']['pcc']['M2']['median_mm'] > 3.0
    assert any('3.0 % larger' in w for w in got['warnings'])
    assert any('0.200 % fast' in w for w in got['warnings'])
