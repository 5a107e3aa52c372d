import time

import numpy as np
import pytest
from scipy.signal import correlate
from scipy.spatial.transform import Rotation

from sesa2.evaluation.time_offset import MirroredTruthError, find_time_offset
from sesa2.evaluation.trajectory import EvaluationError, Trajectory


def shifted(trajectory, seconds):
    return Trajectory(trajectory.times + seconds, trajectory.positions, trajectory.names)


@pytest.mark.parametrize('offset', [0.0, 0.0123, -0.02, 7.31, -1.7e9, 1.7e9 + 0.4567])
@pytest.mark.parametrize(
    ('rate', 'truth_rate'), [(31.0, 100.0), (100.0, 31.0), (100.0, 100.0), (31.0, 240.0)]
)
def test_below_a_millisecond_between_any_clocks_and_rates(motion, offset, rate, truth_rate):
    found = find_time_offset(motion.record(rate, start=0.0071), shifted(motion.record(truth_rate), offset))
    assert abs(found.seconds - offset) < 5e-4
    assert found.correlation > 0.9999


def test_frames_do_not_matter(motion):
    truth = motion.record(100.0)
    turn = Rotation.from_euler('zyx', (2.5, 0.4, -1.0))
    moved = Trajectory(
        truth.times + 3.0,
        turn.apply(truth.positions.reshape(-1, 3).copy()).reshape(-1, 2, 3) + 5.0,
        truth.names,
    )
    assert abs(find_time_offset(motion.record(31.0), moved).seconds - 3.0) < 5e-4


@pytest.mark.parametrize(('start', 'stop'), [(0.0, 12.0), (40.0, 60.0), (20.0, 33.0)])
def test_one_recording_may_be_a_part_of_the_other(motion, start, stop):
    part = motion.record(31.0, start, stop)
    assert abs(find_time_offset(part, shifted(motion.record(100.0), -50.0)).seconds + 50.0) < 1e-3
    assert abs(find_time_offset(shifted(motion.record(100.0), 50.0), part).seconds + 50.0) < 1e-3


def test_they_may_overlap_by_a_third(motion):
    found = find_time_offset(motion.record(31.0, 0.0, 36.0), shifted(motion.record(100.0, 24.0, 60.0), 9.0))
    assert abs(found.seconds - 9.0) < 1e-3


@pytest.mark.parametrize('seed', range(5))
def test_noise_and_slow_errors(motion, seed):
    rng = np.random.default_rng(seed)
    clean = motion.record(31.0)
    slow = np.cumsum(rng.normal(0.0, 1.5e-3, clean.positions.shape), axis=0)  # up to some 50 mm in a minute
    noisy = Trajectory(clean.times, clean.positions + slow + rng.normal(0.0, 3e-3, slow.shape), clean.names)
    truth = motion.record(100.0)
    truth = Trajectory(
        truth.times, truth.positions + rng.normal(0.0, 3e-4, truth.positions.shape), truth.names
    )
    assert abs(find_time_offset(noisy, shifted(truth, -0.037)).seconds + 0.037) < 4e-3


def test_noise_does_not_draw_it_between_the_samples(motion):
    # both at 100 Hz: interpolating the noisy one halves its noise at half a sample, which must not look like agreement
    clean = motion.record(100.0)
    noise = np.random.default_rng(9).normal(0.0, 0.02, clean.positions.shape)
    noisy = Trajectory(clean.times, clean.positions + noise, clean.names)
    assert abs(find_time_offset(noisy, motion.record(100.0)).seconds) < 1.5e-3


def test_gaps_in_the_truth(motion):
    truth = motion.record(100.0)
    p = truth.positions.copy()
    p[1000:2500, 0] = np.nan
    p[4000:4300] = np.nan
    found = find_time_offset(motion.record(31.0), Trajectory(truth.times + 2.0, p, truth.names))
    assert abs(found.seconds - 2.0) < 5e-4


def test_agrees_with_scipy_on_the_grid(motion):
    truth, estimate = motion.record(20.0), motion.record(20.0, 13.0, 43.0)
    x, y = (t.positions[:, 1] - t.positions[:, 1].mean(axis=0) for t in (estimate, truth))
    lag = np.argmax(sum(correlate(y[:, c], x[:, c], mode='valid') for c in range(3)))
    found = find_time_offset(shifted(estimate, -13.0), truth)
    assert found.seconds == pytest.approx(lag / 20.0, abs=1e-3)


def test_motion_that_repeats_itself_has_a_rival():
    def record(rate, seconds):
        t = np.arange(0.0, seconds, 1.0 / rate)
        phase = 2.0 * np.pi * t / 3.0
        swing = np.stack((np.sin(phase), np.cos(2.0 * phase), 0.3 * np.cos(phase)), axis=1)[:, None]
        noise = np.random.default_rng(int(rate)).normal(0.0, 0.002, swing.shape)
        return Trajectory(t, 0.2 * swing + noise, ('M1',))

    found = find_time_offset(record(31.0, 30.0), record(100.0, 60.0))
    assert found.rival is not None
    # half a period later it is the same motion, turned by 180°
    halves = (found.rival - found.seconds) / 1.5
    assert round(halves) != 0
    assert halves == pytest.approx(round(halves), abs=0.03)


def test_random_motion_has_none(motion):
    assert find_time_offset(motion.record(31.0), motion.record(100.0)).rival is None


@pytest.mark.parametrize('what', ['estimate', 'truth'])
def test_refuses_too_short(motion, what):
    pair = {'estimate': motion.record(31.0), 'truth': motion.record(100.0)}
    pair[what] = motion.record(50.0, 5.0, 6.0)
    with pytest.raises(
        EvaluationError, match=rf'{what} is too short.*50 samples in 0\.98 s, expected at least 20 in 2 s'
    ):
        find_time_offset(**pair)


@pytest.mark.parametrize('what', ['estimate', 'truth'])
def test_refuses_no_motion(motion, what):
    pair = {'estimate': motion.record(31.0), 'truth': motion.record(100.0)}
    rng = np.random.default_rng(0)
    still = pair[what].positions[:1] + rng.normal(0.0, 1e-3, pair[what].positions.shape)
    pair[what] = Trajectory(pair[what].times, still, pair[what].names)
    with pytest.raises(EvaluationError, match=rf'{what} does not move: 1\.7\d mm rms.*at least 5 mm'):
        find_time_offset(**pair)


def test_refuses_recordings_of_different_motions(motion):
    with pytest.raises(
        EvaluationError, match=r'no overlap in time.*Best correlation 0\.\d\d over .*Estimate: 28\.\d s from'
    ):
        find_time_offset(motion.record(31.0, 0.0, 28.0), motion.record(100.0, 31.0, 60.0))


def test_refuses_motion_at_different_times():
    # each moves for 1.5 s only, so that no overlap has two seconds of motion in both
    t = np.arange(0.0, 3.0, 0.02)
    p = np.zeros((len(t), 1, 3))
    p[:, 0, 0] = 0.02 * np.sin(t)
    p[len(t) // 2 :] = np.nan
    half = Trajectory(t, p, ('M1',))
    with pytest.raises(EvaluationError, match='no time offset lets estimate and truth overlap by 2 s'):
        find_time_offset(half, half)


def test_the_delay_of_the_simulated_trial(twin):
    estimate, truth = twin
    began = time.perf_counter()
    found = find_time_offset(estimate, truth)
    assert time.perf_counter() - began < 5.0  # some 0.15 s; the room is for a loaded machine
    assert abs(found.seconds + 0.020) < 2e-3
    assert found.rival is None


@pytest.mark.parametrize('turn', [(0.0, 0.0, 0.0), (2.5, 0.4, -1.0)])
def test_a_mirror_image_is_refused(motion, turn):
    truth = motion.record(100.0)
    swapped = Rotation.from_euler('zyx', turn).apply(truth.positions[..., [0, 2, 1]].reshape(-1, 3).copy())
    swapped = Trajectory(truth.times, swapped.reshape(truth.positions.shape), truth.names)
    with pytest.raises(MirroredTruthError, match='mirror image of the estimate') as refused:
        find_time_offset(motion.record(31.0), swapped)
    assert refused.value.mirrored > 0.999


@pytest.mark.parametrize('across', [0.0, 1e-3, 0.1])
def test_motion_in_a_plane_looks_the_same_mirrored_and_is_not_refused(motion, across):
    flat = np.array([1.0, 1.0, across])
    truth, estimate = motion.record(100.0), motion.record(31.0)
    truth = Trajectory(truth.times, truth.positions * flat, truth.names)
    estimate = Trajectory(estimate.times, estimate.positions * flat * (1, 1, -1), estimate.names)
    assert abs(find_time_offset(estimate, truth).seconds) < 5e-4
