"""Self-calibration on arms whose errors are known: found within the stated uncertainty, or said not to be."""

import numpy as np
import pytest
from moving_arm import measure, moving_arm, rms_degrees, tip_error
from scipy.spatial.transform import Rotation

from sesa2.alignment.self_calibration import CalibrationError, self_calibrate
from sesa2.sensing.imu.mounting import Mounting
from sesa2.shape.arm import Arm
from sesa2.shape.layout import Layout
from sesa2.shape.models import create_model
from sesa2.shape.rotations import IDENTITY, from_rotation_vector, multiply, normalize


def calibrate(motion, q, measured=None, mountings=None, headings=None, **options):
    n = q.shape[1]
    return self_calibrate(
        motion.stamps,
        q,
        np.ones(q.shape[:2], bool) if measured is None else measured,
        motion.layout,
        motion.base,
        np.tile(IDENTITY, (n, 1)) if mountings is None else mountings,
        np.zeros(n) if headings is None else headings,
        **options,
    )


def corrected(calibration, q):
    return Mounting(calibration.mountings, calibration.headings).link_orientations(q)


def off(calibration, errors):
    """What is left of the errors, (n_imu, 4), rad."""
    put_in = np.column_stack([errors.mounting, errors.heading.mean(axis=0)])
    return calibration.corrections - put_in


def test_constant_errors_are_found():
    rng = np.random.default_rng(1)
    motion = moving_arm(rng)
    q, errors = measure(rng, motion.links, mounting=2.0, heading=10.0, drift=0.0, tilt=0.0)
    found = calibrate(motion, q)
    left = np.rad2deg(off(found, errors))
    assert np.sqrt(np.mean(left[:, :3] ** 2)) < 0.9
    assert np.sqrt(np.mean(left[:, 3] ** 2)) < 0.9
    assert (np.abs(off(found, errors)) < 3.5 * found.std).all()
    assert rms_degrees(corrected(found, q), motion.links) < 0.2 * rms_degrees(q, motion.links)
    assert found.told.mean() > 0.85


@pytest.mark.parametrize(
    'base', [IDENTITY, np.array([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)])], ids=['upright', 'lying']
)
def test_chips_that_start_with_any_heading(base):
    rng = np.random.default_rng(9)
    motion = moving_arm(rng, base=base)
    q, _ = measure(rng, motion.links)
    started = rng.uniform(-np.pi, np.pi, q.shape[1])
    nearby, anywhere = (
        calibrate(motion, Mounting(np.tile(IDENTITY, (q.shape[1], 1)), -psi).link_orientations(q))
        for psi in (0.0 * started, started)
    )
    turned = Rotation.from_euler('z', (anywhere.headings - nearby.headings - started)[:, None])
    assert np.rad2deg(turned.magnitude().max()) < 1.0
    assert (np.abs(anywhere.headings) <= np.pi).all()
    assert anywhere.misfit < 0.3


def test_exchanged_imus_fit_no_smooth_shape():
    rng = np.random.default_rng(1)
    for bend in (1.2, 2.5):
        motion = moving_arm(rng, bend=bend)
        q, _ = measure(rng, motion.links)
        assert calibrate(motion, q).misfit < 0.2
        q[:, [2, 5]] = q[:, [5, 2]]
        if bend < 2.0:
            assert calibrate(motion, q).misfit > 0.4
        else:
            with pytest.raises(
                CalibrationError, match=r'agrees with these IMUs \(misfit .*are two exchanged'
            ):
                calibrate(motion, q)


@pytest.mark.parametrize(
    ('n_imu', 'bend', 'n_modes'), [(16, 4.0, 6), (16, 6.0, 8), (8, 4.0, 6), (16, 1.2, 3), (4, 2.5, 3)]
)
def test_a_long_thin_arm_fits_however_much_it_bends(n_imu, bend, n_modes):
    """And with exchanged IMUs it does not."""
    rng = np.random.default_rng(1)
    sizes = 0.8 ** np.arange(n_modes)
    motion = moving_arm(rng, n_imu=n_imu, seconds=60.0, bend=bend, length=3.0, sizes=sizes)
    q, _ = measure(rng, motion.links)
    assert calibrate(motion, q).misfit < 0.25
    a, b = n_imu // 3, n_imu // 2 + 1
    q[:, [a, b]] = q[:, [b, a]]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('sesa2.alignment.self_calibration._NO_FIT', np.inf)
        assert calibrate(motion, q).misfit > 0.3


def test_an_arm_without_errors_stays_as_it_is():
    rng = np.random.default_rng(2)
    motion = moving_arm(rng)
    found = calibrate(motion, motion.links)
    assert np.rad2deg(np.abs(found.corrections).max()) < 0.1


@pytest.mark.parametrize(
    'options',
    [
        {},
        {'n_imu': 4},
        {'n_imu': 2},
        {'base': np.array([1.0, 0.2, 0.0, 0.1]) / np.sqrt(1.05)},
        {'base': np.array([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)])},
        {'length': 0.2, 'seconds': 60.0},
        {'twist': 0.3},
    ],
    ids=['plain', '4 IMUs', '2 IMUs', 'hanging', 'lying', 'short', 'twisting'],
)
def test_the_uncertainty_is_the_error_that_one_meets(options):
    """Root mean square of error over stated uncertainty, over four trials and all parameters."""
    ratios = []
    for seed in range(4):
        rng = np.random.default_rng(40 + seed)
        motion = moving_arm(rng, **options)
        q, errors = measure(rng, motion.links)
        found = calibrate(motion, q)
        ratios.append(off(found, errors) / found.std)
    rms = np.sqrt(np.mean(np.square(ratios), axis=(0, 1)))
    assert (rms > 0.3).all(), rms
    assert (rms < 1.5).all(), rms


def test_positions_get_better():
    raw, after = [], []
    for seed in range(4):
        rng = np.random.default_rng(60 + seed)
        motion = moving_arm(rng, bend=1.5)
        q, _ = measure(rng, motion.links, heading=4.0)
        model = create_model('spline', motion.layout)
        raw.append(tip_error(model, q, motion))
        after.append(tip_error(model, corrected(calibrate(motion, q), q), motion))
    assert np.mean(after) < 0.75 * np.mean(raw)


def test_an_arm_that_really_twists_is_recognised_and_hardly_harmed():
    raw, after = [], []
    for seed in range(4):
        rng = np.random.default_rng(80 + seed)
        motion = moving_arm(rng, twist=0.4)
        q, _ = measure(rng, motion.links)
        found = calibrate(motion, q)
        assert 0.15 < found.twist < 0.8
        model = create_model('spline', motion.layout)
        raw.append(tip_error(model, q, motion))
        after.append(tip_error(model, corrected(found, q), motion))
    assert np.mean(after) < 1.3 * np.mean(raw)


def test_grossly_wrong_headings_are_found():
    rng = np.random.default_rng(3)
    motion = moving_arm(rng, bend=1.5)
    q, _ = measure(rng, motion.links, heading=60.0)
    found = calibrate(motion, q)
    assert rms_degrees(q, motion.links) > 30.0
    assert rms_degrees(corrected(found, q), motion.links) < 4.0


def test_what_is_known_already_is_built_upon():
    """Sensors at any angle in their links, headings known to some degrees."""
    rng = np.random.default_rng(4)
    motion = moving_arm(rng, base=normalize([0.1, 0.2, 1.0, -0.3]))
    sideways, known = normalize(rng.normal(size=(8, 4))), rng.uniform(-3.0, 3.0, 8)
    q, _ = measure(rng, motion.links, drift=0.0, tilt=0.0)
    turn = from_rotation_vector(np.outer(known, [0.0, 0.0, 1.0]))
    found = calibrate(motion, multiply(turn, multiply(q, sideways)), None, sideways, known)
    plain = calibrate(motion, q)
    np.testing.assert_allclose(found.corrections, plain.corrections, atol=1e-6)
    np.testing.assert_allclose(found.headings, known + plain.headings, atol=1e-6)
    same = Rotation.from_quat(found.mountings).inv() * Rotation.from_quat(multiply(plain.mountings, sideways))
    assert same.magnitude().max() < 1e-6


def test_missing_samples_and_a_dead_imu():
    rng = np.random.default_rng(5)
    motion = moving_arm(rng)
    q, errors = measure(rng, motion.links, heading=8.0, drift=0.0)
    measured = rng.random(q.shape[:2]) > 0.2
    measured[:, 3] = False
    q[~measured] = np.nan
    found = calibrate(motion, q, measured)
    others = np.delete(np.arange(8), 3)
    assert np.rad2deg(np.sqrt(np.mean(off(found, errors)[others] ** 2))) < 1.2
    np.testing.assert_array_equal(found.corrections[3], 0.0)
    assert not found.told[3].any()
    assert 'IMU 4: the motion hardly tells mounting about x (±' in '\n'.join(found.untold(range(1, 9)))
    nan_only = calibrate(motion, q)  # says that all was measured
    np.testing.assert_array_equal(nan_only.corrections, found.corrections)


def test_damaged_samples_hardly_matter():
    rng = np.random.default_rng(6)
    motion = moving_arm(rng)
    q, _ = measure(rng, motion.links, heading=8.0)
    whole = calibrate(motion, q)
    damaged = rng.random(q.shape[:2]) < 0.01
    q[damaged] = normalize(rng.normal(size=(damaged.sum(), 4)))
    found = calibrate(motion, q)
    assert np.rad2deg(np.abs(found.corrections - whole.corrections).max()) < 1.2


def test_a_poor_motion_is_said_to_be():
    rng = np.random.default_rng(7)
    motion = moving_arm(rng, bend=0.3, seconds=30.0)
    q, errors = measure(rng, motion.links)
    found = calibrate(motion, q)
    assert not found.told[:, :2].any()
    assert len(found.untold(range(1, 9))) == 8
    assert (np.abs(off(found, errors)) < 4.0 * found.std).all()


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ({'seconds': 8.0}, r'has 8\.0 s of orientations, expected at least 10 s'),
        ({'bend': 0.005}, r'took \d+ shapes that differ by more than 5° somewhere, expected at least 20'),
    ],
)
def test_too_little_is_refused(options, message):
    rng = np.random.default_rng(8)
    motion = moving_arm(rng, **options)
    q, _ = measure(rng, motion.links)
    with pytest.raises(CalibrationError, match=message):
        calibrate(motion, q)


def test_nothing_measured_is_refused():
    with pytest.raises(CalibrationError, match=r'has 0\.0 s'):
        self_calibrate(
            np.arange(500.0),
            np.zeros((500, 1, 4)),
            np.zeros((500, 1), bool),
            Layout(Arm(0.5), (0.5,)),
            IDENTITY,
            np.array([IDENTITY]),
            np.zeros(1),
        )
