"""Fusion on the host: against motions whose orientation is known, scipy, and itself one by one."""

import sys
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, RotationSpline

from sesa2.errors import Sesa2Error
from sesa2.sensing.imu import host_fusion
from sesa2.sensing.imu.host_fusion import HostFusion

NS = 10**9
UP = np.array([0.0, 0.0, 9.81])
NORTH = np.array([0.0, 20e-6, -43e-6])  # of W: x east, y north, z up
needs_vqf = pytest.mark.skipif(find_spec('vqf') is None, reason='vqf is not installed (extra raw)')


def motion(seconds=60.0, rate=100.0, *, seed=0, bias=0.5, jitter=0.0):
    """An IMU that turns to and fro about a slanting start: stamps, q_WS, angular velocity, acceleration, field."""
    rng = np.random.default_rng(seed)
    knots = np.arange(0.0, seconds + 3.0, 1.5)
    away = Rotation.from_rotvec(rng.normal(0.0, 0.35, (len(knots), 3)))
    spline = RotationSpline(knots, Rotation.from_euler('xyz', [20, -35, 70], degrees=True) * away)
    t = np.arange(round(seconds * rate)) / rate
    if jitter:
        t = np.maximum(t + rng.uniform(-jitter, jitter, len(t)) / rate, 0.0)
    q = spline(t)
    gyr = spline(t, 1)  # scipy's rates are in the axes of the body
    gyr = gyr + np.deg2rad(bias) * np.array([1.0, -1.0, 1.0]) / np.sqrt(3) + rng.normal(0, 1e-3, gyr.shape)
    acc = q.inv().apply(UP) + rng.normal(0.0, 0.03, (len(t), 3))
    mag = q.inv().apply(NORTH) + rng.normal(0.0, 3e-7, (len(t), 3))
    return np.round(t * NS).astype(np.int64) + 1_700_000_000 * NS, q, gyr, acc, mag


def angles(got, truth, *, heading=True):
    """Errors, rad; of the inclination alone without the heading."""
    error = Rotation.from_quat(np.where(np.isnan(got), 1.0, got)) * truth.inv()
    if heading:
        return error.magnitude()
    return np.arccos(np.clip(error.apply([0.0, 0.0, 1.0])[:, 2], -1.0, 1.0))


def fuse(stamps, gyr, acc, mag=None):
    fusion = HostFusion(magnetometer=mag is not None)
    out = np.full((len(stamps), 4), np.nan)
    for k in range(len(stamps)):
        if mag is not None:
            fusion.add_field(int(stamps[k]), mag[k])
        q = fusion.add(int(stamps[k]), gyr[k], acc[k])
        if q is not None:
            out[k] = q
    return fusion, out


@needs_vqf
@pytest.mark.parametrize('rate', [25.0, 60.0, 100.0, 400.0])
def test_six_axes_keep_the_inclination_and_nearly_the_heading(rate):
    stamps, truth, gyr, acc, _ = motion(rate=rate)
    _, got = fuse(stamps, gyr, acc)
    settled = stamps - stamps[0] > 20 * NS
    assert np.rad2deg(angles(got, truth, heading=False)[settled]).max() < 1.5
    # But for the heading of the start, which nobody told it.
    start = truth[0] * Rotation.from_quat(got[0]).inv()
    assert np.rad2deg(np.linalg.norm(start.as_rotvec()[:2])) < 1.0
    turned = Rotation.from_rotvec([0.0, 0.0, start.as_rotvec()[2]]) * Rotation.from_quat(got)
    assert np.rad2deg(angles(turned.as_quat(), truth)).max() < 20.0


@needs_vqf
def test_nine_axes_know_north():
    stamps, truth, gyr, acc, mag = motion()
    fusion, got = fuse(stamps, gyr, acc, mag)
    assert fusion.refused == {host_fusion.NO_FIELD_YET: 1}
    settled = stamps - stamps[0] > 20 * NS
    assert np.rad2deg(angles(got, truth)[settled]).max() < 3.5


@needs_vqf
def test_at_rest_the_bias_is_found():
    rng = np.random.default_rng(0)
    n, bias = 1000, np.deg2rad([0.5, -0.3, 0.4])
    fusion = HostFusion()
    fusion.add_many(
        10_000_000 * np.arange(n), bias + rng.normal(0, 2e-3, (n, 3)), UP + rng.normal(0, 0.04, (n, 3))
    )
    np.testing.assert_allclose(fusion.bias, bias, atol=np.deg2rad(0.03))


@needs_vqf
def test_degrees_for_radians_and_w_first_are_far_off():
    """What the figures above would look like."""
    stamps, truth, gyr, acc, _ = motion(20.0)
    slow = 0.02 * gyr
    _, got = fuse(stamps, np.rad2deg(slow), acc)
    assert np.rad2deg(angles(got, truth, heading=False)).max() > 3.0
    _, got = fuse(stamps, gyr, acc)
    assert np.rad2deg(angles(got[:, [3, 0, 1, 2]], truth, heading=False)).max() > 20.0


@needs_vqf
@pytest.mark.parametrize('magnetometer', [False, True])
def test_many_at_once_are_the_same_as_one_by_one(magnetometer):
    stamps, _, gyr, acc, mag = motion(20.0, jitter=0.3, seed=3)
    keep = np.ones(len(stamps), dtype=bool)
    keep[[40, 41, 300, *range(500, 530), *range(900, 1100)]] = False  # lost; two gaps, of 0.3 and 2 s
    stamps, gyr, acc, mag = stamps[keep], gyr[keep], acc[keep].copy(), mag[keep]
    stamps[700] -= 10**15  # a glitch
    stamps[1200:] -= 5 * NS  # a step back
    stamps[650] = stamps[649]
    acc[200, 1] = np.nan
    gyr = gyr.copy()
    gyr[210] = 100.0
    one, expected = fuse(stamps, gyr, acc, mag if magnetometer else None)
    many = HostFusion(magnetometer=magnetometer)
    got = []
    for begin, end in [(0, 5), (5, 6), (6, 731), (731, len(stamps))]:
        if magnetometer:
            for k in range(begin, end):
                many.add_field(int(stamps[k]), mag[k])
        got.append(many.add_many(stamps[begin:end], gyr[begin:end], acc[begin:end]))
    # The heading is put on by other arithmetic.
    np.testing.assert_allclose(np.concatenate(got), expected, rtol=0.0, atol=1e-14 if magnetometer else 0.0)
    assert np.allclose(many.bias, one.bias, rtol=0.0, atol=0.0)
    assert (many.refused, many.restarts) == (one.refused, one.restarts)
    assert one.restarts == 2
    assert one.refused[host_fusion.NOT_NEWER] == one.refused[host_fusion.TOO_FAST] == 1
    assert one.refused[host_fusion.NOT_FINITE] == 1
    assert one.refused[host_fusion.ANOTHER_TIME] == 2
    assert np.isfinite(expected[-100:]).all()


@needs_vqf
def test_regular_samples_and_fields_are_taken_together(monkeypatch):
    stamps, _, gyr, acc, mag = motion(10.0)
    _, expected = fuse(stamps, gyr, acc, mag)
    many = HostFusion(magnetometer=True)
    singly = []
    monkeypatch.setattr(many, 'add', lambda *a: (singly.append(a[0]), HostFusion.add(many, *a))[1])
    for k in range(len(stamps)):
        many.add_field(int(stamps[k]), mag[k])
    got = many.add_many(stamps, gyr, acc)
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-14)
    assert len(singly) < 20


@needs_vqf
def test_irregular_stamps_and_lost_samples_cost_little():
    stamps, truth, gyr, acc, mag = motion(jitter=0.4, seed=5)
    keep = np.random.default_rng(0).random(len(stamps)) > 0.1
    keep[:2] = True
    _, got = fuse(stamps[keep], gyr[keep], acc[keep], mag[keep])
    settled = (stamps[keep] - stamps[0]) > 20 * NS
    assert np.rad2deg(angles(got, truth[keep])[settled]).max() < 3.5


@needs_vqf
def test_what_was_turned_in_a_short_gap_is_not_lost():
    """A rate that rises steadily: straight lines across the gap are right."""
    t = np.arange(300) / 100.0
    gyr, acc = np.zeros((300, 3)), np.tile(UP, (300, 1))
    gyr[:, 2] = 0.5 * t
    fusion, got = HostFusion(), None
    for k in range(300):
        if not 150 <= k < 190:
            got = fusion.add(round(t[k] * NS), gyr[k], acc[k])
    turned = Rotation.from_quat(got).as_rotvec()
    np.testing.assert_allclose(turned, [0.0, 0.0, 0.25 * t[-1] ** 2], atol=0.01)


@needs_vqf
def test_whether_the_field_comes_before_or_after_its_sample_is_the_same():
    stamps, _, gyr, acc, mag = motion(5.0, jitter=0.4)
    _, before = fuse(stamps, gyr, acc, mag)
    fusion, after = HostFusion(magnetometer=True), []
    for k in range(len(stamps)):
        after.append(fusion.add(int(stamps[k]), gyr[k], acc[k]))
        fusion.add_field(int(stamps[k]), mag[k])
    np.testing.assert_array_equal(np.array(after[1:]), before[1:])


@needs_vqf
def test_after_a_pause_the_inclination_is_right_at_once_and_the_heading_goes_on():
    stamps, truth, gyr, acc, _ = motion(90.0)
    gone = (stamps - stamps[0] > 40 * NS) & (stamps - stamps[0] < 47 * NS)
    k = int(np.argmax(gone))
    fusion, got = fuse(stamps[~gone], gyr[~gone], acc[~gone])
    assert fusion.restarts == 1
    assert np.rad2deg(angles(got, truth[~gone], heading=False)[k : k + 50]).max() < 3.0
    # In 6D the heading of before the pause is kept, but for what was turned in it.
    _, whole = fuse(stamps, gyr, acc)
    step = Rotation.from_quat(got[-1]) * Rotation.from_quat(whole[-1]).inv()
    assert np.rad2deg(step.magnitude()) < 60.0
    assert np.isfinite(got).all()


@needs_vqf
def test_a_heading_without_its_field_is_told():
    stamps, _, gyr, acc, mag = motion(5.0)
    fusion = HostFusion(magnetometer=True)
    for k in range(len(stamps)):
        if k < 200:
            fusion.add_field(int(stamps[k]), mag[k])
        fusion.add(int(stamps[k]), gyr[k], acc[k])
    assert 195 < fusion.without_field < 205
    assert any('drifts' in doubt for doubt in fusion.doubts)


@needs_vqf
def test_a_field_that_is_none_is_left_out():
    stamps, _, gyr, acc, mag = motion(2.0)
    fusion, plain = HostFusion(magnetometer=True), HostFusion(magnetometer=True)
    for k in range(len(stamps)):
        if k % 3:
            plain.add_field(int(stamps[k]), mag[k])
        fusion.add_field(int(stamps[k]), mag[k] if k % 3 else [np.full(3, np.nan), np.zeros(3)][k % 2])
        a, b = (one.add(int(stamps[k]), gyr[k], acc[k]) for one in (fusion, plain))
        assert (a is None) == (b is None)
        assert a is None or np.array_equal(a, b)


@needs_vqf
def test_gravity_in_g_is_named():
    stamps, _, gyr, acc, _ = motion(1.0)
    assert fuse(stamps, gyr, acc)[0].doubts == []
    [doubt] = fuse(stamps, gyr, acc / 9.80665)[0].doubts
    assert 'is it in g?' in doubt


def test_without_vqf_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, 'vqf', None)
    with pytest.raises(Sesa2Error, match=r"pip install 'sesa2\[raw\]'"):
        HostFusion()
