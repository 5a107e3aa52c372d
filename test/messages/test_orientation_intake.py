"""What stands between the IMUs' messages and the sweeps: one by one and many at once, and what is refused."""

from importlib.util import find_spec

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from sesa2.configuration import validate
from sesa2.errors import Sesa2Error
from sesa2.messages.field_messages import FIELD_TYPE, FieldMessages, read_field
from sesa2.messages.imu_messages import TYPE, ImuMessages, read_imu
from sesa2.messages.orientation_intake import ALL_ZERO, NO_ORIENTATION, NOTHING_TO_FUSE, OrientationIntake
from sesa2.sensing.imu.accelerometer_calibration import AccelerometerCalibration, KeptAccelerometers

needs_vqf = pytest.mark.skipif(find_spec('vqf') is None, reason='vqf is not installed (extra raw)')
T0 = 1_700_000_000_000_000_000


def raw(n=200, seed=0):
    rng = np.random.default_rng(seed)
    stamps = T0 + 10_000_000 * np.arange(n)
    gyr, acc = rng.normal(0, 0.2, (n, 3)), rng.normal([0, 0, 9.8], 0.5, (n, 3))
    return [row.tobytes() for row in ImuMessages('imu_1').make_raw(stamps, gyr, acc)], stamps, gyr, acc


def test_rosbags_reads_what_is_made():
    store = get_typestore(Stores.ROS2_JAZZY)
    [data, *_], stamps, gyr, acc = raw()
    message = store.deserialize_cdr(data, TYPE)
    assert message.orientation_covariance[0] == -1.0
    assert message.angular_velocity_covariance[0] == message.linear_acceleration_covariance[0] == 0.0
    v, a = message.angular_velocity, message.linear_acceleration
    np.testing.assert_array_equal([[v.x, v.y, v.z], [a.x, a.y, a.z]], [gyr[0], acc[0]])
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamps[0]
    field = FieldMessages('imu_1').make_fields(stamps[:1], gyr[:1])[0].tobytes()
    message = store.deserialize_cdr(field, FIELD_TYPE)
    np.testing.assert_array_equal([message.magnetic_field.x, message.magnetic_field.z], gyr[0, [0, 2]])
    big = bytes(store.serialize_cdr(message, FIELD_TYPE, little_endian=False))
    for one in (field, big):
        stamp, got = read_field(one)
        assert stamp == stamps[0]
        np.testing.assert_array_equal(got, gyr[0])
    with pytest.raises(Sesa2Error, match='MagneticField message of 20 bytes'):
        read_field(field[:20])


def test_what_says_that_it_has_no_orientation_is_never_a_rotation():
    data, *_ = raw(3)
    q = np.array([0.0, 0.6, 0.0, 0.8])
    data.insert(1, ImuMessages('imu_1').make(T0, q))
    assert read_imu(data[0])[1:] == (0.0, 0.0, 0.0, 0.0)
    one, many = OrientationIntake('none', [1]), OrientationIntake('none', [1])
    singly = [one.take(1, d) for d in data]
    assert [s is None for s in singly] == [True, False, True, True]
    assert singly[1][1:] == tuple(q)
    taken = many.take_many(np.ones(4, int), data)
    np.testing.assert_array_equal(taken.usable, [False, True, False, False])
    for intake in (one, many):
        assert intake.refused == {1: {NO_ORIENTATION: 3}}
        [reason] = intake.reasons
        assert reason.startswith('3 samples not used: the driver says that it gives no orientation')
        assert 'imus.fusion: 6d' in reason


def test_where_nothing_can_be_fused_no_fusion_is_advised():
    values = ImuMessages('imu_1')
    data = values.make_raw(np.array([T0]), np.zeros((1, 3)), np.zeros((1, 3)))[0].tobytes()
    intake = OrientationIntake('none', [1])
    assert intake.take(1, data) is None
    assert '6d' not in intake.why(1)
    assert 'without angular velocity and acceleration' in intake.why(1)


@needs_vqf
def test_one_by_one_and_many_at_once_are_the_same():
    data, *_ = raw()
    data[50] = ImuMessages('imu_1').make(T0 + 500_000_000, np.array([0, 0, 0, 1.0]))  # not raw
    one, many = OrientationIntake('6d', [1]), OrientationIntake('6d', [1])
    singly = [one.take(1, d) for d in data]
    ids = np.ones(len(data), int)
    parts = [many.take_many(ids[a:b], data[a:b]) for a, b in ((0, 30), (30, 31), (31, 200))]
    got = np.concatenate([p.orientations[p.usable] for p in parts])
    np.testing.assert_array_equal(got, [s[1:] for s in singly if s])
    assert one.refused == many.refused == {1: {NOTHING_TO_FUSE: 1}}


@needs_vqf
def test_imus_that_are_not_used_pass_and_are_not_counted():
    data, *_ = raw(3)
    taken = OrientationIntake('6d', [1]).take_many(np.array([9, 9, 9]), data)
    assert taken.usable.all()
    assert not taken.orientations.any()


@needs_vqf
def test_an_accelerometers_calibration_is_applied_before_fusion():
    n = 300
    calibration = AccelerometerCalibration((0.4, -0.3, 0.2), ((1.05, 0, 0), (0, 0.95, 0.02), (0, 0, 1.0)))
    up = np.array([2.0, 3.0, np.sqrt(9.81**2 - 13.0)])
    said = np.linalg.solve(calibration.matrix, up) + calibration.bias
    stamps = T0 + 10_000_000 * np.arange(n)
    messages = {
        name: [
            row.tobytes()
            for row in ImuMessages('imu_1').make_raw(stamps, np.zeros((n, 3)), np.tile(a, (n, 1)))
        ]
        for name, a in (('true', up), ('said', said))
    }
    kept = KeptAccelerometers({1: calibration})
    ids = np.ones(n, int)
    true = OrientationIntake('6d', [1]).take_many(ids, messages['true']).orientations
    corrected = OrientationIntake('6d', [1], kept).take_many(ids, messages['said']).orientations
    raw = OrientationIntake('6d', [1]).take_many(ids, messages['said']).orientations
    np.testing.assert_allclose(corrected, true, atol=1e-9)
    assert np.abs(raw[-1] - true[-1]).max() > 0.01
    one_by_one = OrientationIntake('6d', [1], kept)
    assert one_by_one.take(1, messages['said'][0])[1:] == pytest.approx(true[0].tolist())


def test_a_calibration_that_is_missing_is_told():
    assert OrientationIntake('none', [1], KeptAccelerometers({}, ('gone',))).doubts == ['gone']


def test_zeros_where_there_is_something_to_fuse_are_refused_with_the_remedy():
    _, stamps, gyr, acc = raw(5)
    data = [d.tobytes() for d in ImuMessages('imu_1').make_raw(stamps, gyr, acc, np.zeros((5, 4)))]
    q = np.tile([0.0, 0.0, 0.0, 0.0], (5, 1))
    glitches = [
        d.tobytes() for d in ImuMessages('imu_1').make_many(stamps, q)
    ]  # as a chip sends now and then
    one, many = OrientationIntake('none', [1]), OrientationIntake('none', [1])
    assert [one.take(1, d) is None for d in data + glitches] == [True] * 5 + [False] * 5
    np.testing.assert_array_equal(
        many.take_many(np.ones(10, int), data + glitches).usable, [False] * 5 + [True] * 5
    )
    for intake in (one, many):
        assert intake.refused == {1: {ALL_ZERO: 5}}
        assert 'imus.fusion: 6d' in intake.why(1)


@pytest.mark.parametrize('base', [(0.0, 0.0, 0.0, 1.0), (0.7071, 0.0, 0.0, 0.7071)])
def test_an_earth_frame_that_points_down_is_doubted_where_the_arm_lies(base):
    c = validate(
        {
            'arm': {'length': 0.3, 'base_orientation': list(base)},
            'imus': {'ids': [1], 'positions': [0.3]},
            'models': ['pcc'],
        }
    )
    _, stamps, gyr, _ = raw()
    turns = Rotation.from_rotvec(np.random.default_rng(1).uniform(-0.5, 0.5, (200, 3)))
    ned = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]]) * turns
    acc = turns.inv().apply([0.0, 0.0, 9.81])
    data = [d.tobytes() for d in ImuMessages('imu_1').make_raw(stamps, gyr, acc, ned.as_quat())]
    one, many = OrientationIntake.of(c), OrientationIntake.of(c)
    for d in data:
        assert one.take(1, d) is not None
    assert many.take_many(np.ones(200, int), data).usable.all()
    for intake in (one, many):
        doubts = [doubt for doubt in intake.doubts if 'IMU 1: turned by its orientation' in doubt]
        assert len(doubts) == (base[0] != 0.0)  # an upright arm shows it by its shape
