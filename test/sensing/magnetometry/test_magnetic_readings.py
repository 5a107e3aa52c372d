"""Predicted readings against magpylib on an independent chain, derivatives against differences."""

from dataclasses import replace

import numpy as np
import pytest
from paper_arm import EARTH, REAL, SIMULATED, PaperArm, flower, lemniscate
from scipy.spatial.transform import Rotation

from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings, MagnetPlaces
from sesa2.sensing.magnetometry.ring_magnet import HIGHEST_ORDER, RingMagnet
from sesa2.shape.arm import GeometryError
from sesa2.shape.kinematics import create_kinematics
from sesa2.shape.kinematics.coordinate_limits import CoordinateLimits

ARMS = {
    'one segment': PaperArm(1),
    'three': PaperArm(3),
    'simulated magnet': PaperArm(3, magnet=SIMULATED),
    'tilted': PaperArm(3, tilt=np.deg2rad(10.0)),
    'three axes': PaperArm(2, 1, axes='xyz', tilt=0.2),
    'earth': PaperArm(2, earth=(30e-6, -20e-6, 50e-6)),
    'affine': PaperArm(1, kinematics='affine'),
}
every_arm = pytest.mark.parametrize('arm', ARMS.values(), ids=ARMS)


def shapes(arm, n=40):
    return flower(n) if arm.family == 'affine' else lemniscate(len(arm.lengths), n)


@every_arm
def test_against_magpylib(arm):
    q = shapes(arm)
    theirs = arm.simulate(q)
    ours = arm.predictor.predict(q).readings
    assert ours.shape == theirs.shape
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=2e-5 * np.abs(theirs).max())


def test_a_straight_arm_is_one_of_many():
    arm = ARMS['three']
    rest = arm.limits.kinematics.rest
    theirs = arm.simulate(rest[None])[0]
    prediction = arm.predictor.predict(rest)
    np.testing.assert_allclose(prediction.readings, theirs, rtol=0.0, atol=1e-8)
    batch = arm.predictor.predict(np.stack([rest, rest]).reshape(1, 2, -1))
    np.testing.assert_allclose(batch.readings[0, 1], prediction.readings, rtol=1e-12)
    np.testing.assert_allclose(batch.jacobian[0, 1], prediction.jacobian, rtol=1e-9, atol=1e-15)
    # Sensors look towards the base: the magnet's field, which points to the tip there, is negative.
    assert (prediction.readings < -0.5e-3).all()


@every_arm
def test_jacobian_against_differences(arm):
    base = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_quat()
    q = np.concatenate([arm.limits.draw(20, np.random.default_rng(2)), arm.limits.kinematics.rest[None]])
    scales = arm.limits.scales
    J = arm.predictor.predict(q, base).jacobian * scales
    moved = np.zeros_like(J)
    for i, scale in enumerate(scales):
        for step, weight in zip((-3, -2, -1, 1, 2, 3), np.array([-1, 9, -45, 45, -9, 1]) / 60.0, strict=True):
            there = q + 1e-3 * scale * step * np.eye(len(scales))[i]
            moved[..., i] += weight / 1e-3 * arm.predictor.predict(there, base).readings
    np.testing.assert_allclose(J, moved, rtol=0.0, atol=1e-8 * np.abs(J).max())


def test_fields_of_magnets_add():
    arm = ARMS['three']
    q = shapes(arm)
    whole = arm.predictor
    parts = [
        MagneticReadings(arm.limits, MagnetPlaces((REAL,), s), whole.magnetometers).predict(q)
        for s in np.split(arm.magnet_s, 3)
    ]
    for i in (0, 1):
        together = sum(part[i] for part in parts)
        np.testing.assert_allclose(whole.predict(q)[i], together, rtol=0, atol=2e-5 * np.abs(together).max())


def test_the_base_turns_in_the_earths_field():
    arm = ARMS['earth']
    q = shapes(arm)
    bases = Rotation.random(len(q), rng=np.random.default_rng(4)).as_quat()
    ours = arm.predictor.predict(q, bases).readings
    np.testing.assert_allclose(ours, arm.simulate(q, bases), rtol=0.0, atol=2e-8)
    assert np.abs(ours - arm.predictor.predict(q).readings).max() > EARTH / 2


def test_gains_and_offsets():
    plain = ARMS['three axes'].predictor
    m = plain.magnetometers
    gains, offsets = np.array([1.1, 0.9]), 1e-6 * np.arange(1.0, 7.0)
    changed = MagneticReadings(plain.limits, plain.magnets, replace(m, gains=gains, offsets=offsets))
    q = shapes(ARMS['three axes'])
    before, after = plain.predict(q), changed.predict(q)
    np.testing.assert_allclose(after.readings, np.repeat(gains, 3) * before.readings + offsets, rtol=1e-12)
    np.testing.assert_allclose(after.jacobian, np.repeat(gains, 3)[:, None] * before.jacobian, rtol=1e-12)


def test_the_order_follows_the_nearest_distance():
    far = ARMS['one segment'].predictor
    assert 0.044 < far.nearest().min() < 0.055
    assert far.order in (5, 7)
    k = create_kinematics('pcc', [0.11])
    close = MagneticReadings(
        CoordinateLimits(k, 1.6, (0.95, 1.1)),
        MagnetPlaces((REAL,), np.array([0.095])),
        far.magnetometers,
    )
    assert close.nearest().min() < 0.02
    assert close.order > far.order
    assert close.order <= HIGHEST_ORDER


def test_measured_fields_become_readings():
    one, three = ARMS['three'].predictor, ARMS['three axes'].predictor
    measured = np.arange(18.0).reshape(2, 3, 3)
    assert three.readings_of(measured[:, :2]).tolist() == [[0, 1, 2, 3, 4, 5], [9, 10, 11, 12, 13, 14]]
    assert one.readings_of(measured).tolist() == [[2, 5, 8], [11, 14, 17]]
    assert three.sensor_of.tolist() == [0, 0, 0, 1, 1, 1]
    assert one.names[:2] == ('magnetometer_1', 'magnetometer_2')


def test_no_magnets_no_readings():
    p = ARMS['three'].predictor
    with pytest.raises(GeometryError, match='0 magnets and 9 magnetometers, expected at least one each'):
        MagneticReadings(p.limits, MagnetPlaces((), np.zeros(0)), p.magnetometers)


def test_a_magnet_the_other_way_round():
    p = ARMS['one segment'].predictor
    turned = MagneticReadings(
        p.limits, MagnetPlaces((RingMagnet(0.006, 0.012, 0.006, -1.45),), np.array([0.055])), p.magnetometers
    )
    q = p.limits.kinematics.rest
    np.testing.assert_allclose(turned.predict(q).readings, -p.predict(q).readings)


def test_sensors_of_one_and_of_three_axes_on_one_arm():
    three = ARMS['three axes'].predictor
    m = three.magnetometers
    mixed = MagneticReadings(
        three.limits,
        three.magnets,
        replace(m, axes=('z', 'xyz'), gains=np.array([1.0, 2.0]), offsets=np.zeros(4)),
    )
    q = shapes(ARMS['three axes'])
    rows, gains = [2, 3, 4, 5], np.array([1.0, 2.0, 2.0, 2.0])
    np.testing.assert_allclose(mixed.predict(q).readings, gains * three.predict(q).readings[:, rows])
    np.testing.assert_allclose(mixed.predict(q).jacobian, gains[:, None] * three.predict(q).jacobian[:, rows])
    assert mixed.sensor_of.tolist() == [0, 1, 1, 1]
    assert mixed.readings_of([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]).tolist() == [2, 3, 4, 5]


def test_axes_that_cannot_be():
    with pytest.raises(GeometryError, match="'xy', expected z or xyz"):
        replace(ARMS['three axes'].predictor.magnetometers, axes=('xy', 'z'))


def test_a_sensor_beyond_the_tip():
    """116 mm along an arm of 110, as in the paper's experiment: on a rigid plate, 6 mm beyond the tip."""
    arm = PaperArm(1)
    beyond = MagneticReadings(
        arm.limits,
        arm.predictor.magnets,
        replace(arm.predictor.magnetometers, axial_offsets=np.full(3, 0.006)),
    )
    at_rest = beyond.predict(arm.limits.kinematics.rest).readings
    on_axis = replace(arm.predictor.magnetometers, axial_offsets=np.full(3, 0.006), radii=np.zeros(3))
    on_axis = (
        MagneticReadings(arm.limits, arm.predictor.magnets, on_axis)
        .predict(arm.limits.kinematics.rest)
        .readings
    )
    n = np.arange(1, 14, 2)
    expected = -np.sum(REAL.moments(13) * (n + 1) / 0.061 ** (n + 2.0))
    np.testing.assert_allclose(on_axis, expected, rtol=2e-5)
    assert (np.abs(at_rest) < np.abs(expected)).all()
