"""Builds that are not as described, calibrated from known shapes; readings are those of the real build, with noise."""

from dataclasses import replace

import numpy as np
import pytest
from paper_arm import NOISE, PaperArm, errors, lemniscate

from sesa2.sensing.magnetometry.build_parameters import BuildErrors, BuildParameters
from sesa2.sensing.magnetometry.magnet_calibration import calibrate_magnets
from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings
from sesa2.shape.arm import GeometryError
from sesa2.shape.coordinate_fit import CoordinateFit
from sesa2.shape.rotations import from_rotation_vector, multiply

FIELD = np.array([20e-6, -10e-6, 45e-6])


def built(arm, rng):
    """The arm as somebody builds it: ± 3 %, 0.3 mm, 1°, 1 %, 2 µT, none of it by the code under test."""
    p = arm.predictor
    n, m = len(p.names), p.magnetometers

    def within(size, *shape):
        return size * rng.uniform(-1.0, 1.0, shape)

    magnets = replace(
        p.magnets,
        magnets=tuple(
            replace(k, remanence=k.remanence * (1 + within(0.03).item())) for k in p.magnets.magnets
        ),
        positions=p.magnets.positions + within(0.3e-3, len(p.magnets.magnets)),
    )
    sensors = replace(
        m,
        radii=m.radii + within(0.3e-3, n),
        azimuths=m.azimuths + within(0.3e-3 / 0.013, n),
        axial_offsets=within(0.3e-3, n),
        mountings=multiply(m.mountings, from_rotation_vector(within(np.deg2rad(1.0), n, 3) * [1, 1, 0])),
        gains=1.0 + within(0.01, n),
        offsets=within(2e-6, n),
    )
    return MagneticReadings(p.limits, magnets, sensors, FIELD)


def read(predictor, q, rng):
    return predictor.predict(q).readings + NOISE * rng.normal(size=(len(q), len(predictor.noise)))


def motion_errors(predictor, real, rng):
    """Worst bend and elongation on the paper's motion, per cent."""
    q = lemniscate(len(real.limits.kinematics.segment_lengths), 200)
    e = errors(CoordinateFit(predictor).fit(read(real, q, rng)).coordinates, q).reshape(-1, 3)
    return e[:, :2].max(), e[:, 2].max()


@pytest.mark.parametrize(('segments', 'most'), [(1, 1.2), (3, 3.5)])
def test_one_straight_pose(segments, most):
    """In the middle of five builds."""
    arm, rng = PaperArm(segments), np.random.default_rng(0)
    described = MagneticReadings(arm.limits, arm.predictor.magnets, arm.predictor.magnetometers, FIELD)
    straight = np.tile(arm.limits.kinematics.rest, (50, 1))
    before, after = [], []
    for _ in range(5):
        real = built(arm, rng)
        c = calibrate_magnets(described, straight, read(real, straight, rng), before=BuildErrors(earth=0.0))
        before.append(motion_errors(described, real, rng))
        after.append(motion_errors(c.predictor, real, rng))
    assert (np.median(after, axis=0) < 0.4 * np.median(before, axis=0)).all()
    assert np.median(after, axis=0)[0] < most


@pytest.mark.parametrize('segments', [1, 3])
def test_a_hundred_poses_come_near_the_noise(segments):
    arm, rng = PaperArm(segments), np.random.default_rng(1)
    real = built(arm, rng)
    q = arm.limits.draw(100, rng)
    known = np.tile([0.05e-3 / 0.022, 0.05e-3 / 0.022, 0.1e-3], segments)  # of motion capture
    c = calibrate_magnets(
        arm.predictor, q + known * rng.normal(size=q.shape), read(real, q, rng), coordinate_errors=known
    )
    floor, after = motion_errors(real, real, rng), motion_errors(c.predictor, real, rng)
    assert after[0] < 1.2 * floor[0]
    assert after[1] < 1.5 * floor[1]
    assert 0.85 < c.residual < 1.2
    # The earth's field was not known at all; what is found is as good as it says.
    earth = [i for i, name in enumerate(c.names) if name.startswith('earth')]
    assert (np.abs(c.changes[earth] - FIELD) < 4.0 * c.deviations[earth]).all()
    assert (c.told[earth] > 0.9).all()


def test_one_shape_does_not_tell_strength_from_gain():
    arm, rng = PaperArm(1), np.random.default_rng(2)
    straight = np.tile(arm.limits.kinematics.rest, (200, 1))
    c = calibrate_magnets(arm.predictor, straight, read(built(arm, rng), straight, rng))
    told = dict(zip(c.names, c.told, strict=True))
    assert told['magnetometer_1 gain'] < 0.1
    assert told['magnetometer_1 offset 0'] < 0.1
    assert told['magnet_1 strength'] < 0.7


def test_a_build_as_described_stays_so():
    arm, rng = PaperArm(2, 1, axes='xyz'), np.random.default_rng(3)
    q = arm.limits.draw(60, rng)
    c = calibrate_magnets(arm.predictor, q, read(arm.predictor, q, rng))
    assert (np.abs(c.changes) < 4.5 * c.deviations).all()
    assert 0.85 < c.residual < 1.15
    assert len(c.names) == len(c.changes) == 2 * 2 + 2 * 6 + 6 + 3


def test_readings_that_are_not_there():
    arm, rng = PaperArm(1), np.random.default_rng(4)
    q = arm.limits.draw(80, rng)
    u = read(built(arm, rng), q, rng)
    u[::3, 1] = np.nan
    assert 0.8 < calibrate_magnets(arm.predictor, q, u).residual < 1.2
    with pytest.raises(GeometryError, match='no reading is a number'):
        calibrate_magnets(arm.predictor, q, np.nan * u)
    with pytest.raises(GeometryError, match=r'readings of shape \(5, 3\) for 80 shapes, expected \(80, 3\)'):
        calibrate_magnets(arm.predictor, q, u[:5])


def test_a_sensor_that_is_moved_is_not_turned():
    """What it reads of the earth's field alone stays."""
    arm = PaperArm(1, 2, axes='xyz', earth=FIELD, tilt=0.3)
    bench = BuildParameters(arm.predictor, BuildErrors())
    theta = np.zeros(len(bench.names))
    theta[[bench.names.index(f'magnetometer_{i} position {a}') for i in (1, 2) for a in 'xyz']] = 3e-3
    rest = arm.limits.kinematics.rest

    def of_the_earth(p):
        there = p.predict(rest).readings
        return (
            there
            - MagneticReadings(p.limits, p.magnets, p.magnetometers, order=p.order).predict(rest).readings
        )

    moved = bench.changed(theta)
    np.testing.assert_allclose(of_the_earth(moved), of_the_earth(arm.predictor), rtol=0.0, atol=1e-15)
    steps = moved.distances(rest) - arm.predictor.distances(rest)
    assert (np.abs(steps) > 1e-3).any()


@pytest.mark.parametrize('axes', ['z', 'xyz'])
def test_a_build_reads_as_magpylib_says(axes):
    arm, rng = PaperArm(2, axes=axes), np.random.default_rng(4)
    build = BuildParameters(arm.predictor, BuildErrors())
    real = build.changed(3.0 * build.deviations * rng.normal(size=len(build.names)))
    q = arm.limits.draw(20, rng)
    np.testing.assert_allclose(real.predict(q).readings, arm.simulate_build(real, q), atol=1e-10)
