"""Fusion on the host over a simulated trial, with and without iron nearby: `python bench/host_fusion.py TRIAL`.

TRIAL is the folder that `sesa2 twin` wrote. What gyroscopes, accelerometers and magnetometers of its arm would have
said is computed from the true motion, goes through `imus.fusion: 6d` and `9d`, and is held against the truth: the
error of the inclination and of the orientation, rms, headings taken from the first 3 s, and that of `spline` at the
markers, median in % of arc length. The last line is what `spline` makes of the true orientations.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from sesa2.bags.reading import ImuRecording
from sesa2.bags.recording import open_recording
from sesa2.bags.trial_bag import START_NS, TRIAL_FILE
from sesa2.bags.writing import new_bag
from sesa2.configuration import files
from sesa2.messages.field_messages import FIELD_TYPE, FieldMessages
from sesa2.messages.imu_messages import TYPE, ImuMessages
from sesa2.messages.orientation_intake import OrientationIntake
from sesa2.shape.measured import Measured
from sesa2.shape.rotations import conjugate, multiply, rotate
from sesa2.twin.trial import Trial

RATE = 100.0  # Hz
BIAS, GYRO_NOISE, ACCELERATION_NOISE, FIELD_NOISE = np.deg2rad(0.5), 2e-3, 0.04, 4e-7
EARTH = np.array([0.0, 20e-6, -44e-6])  # T, in W
IRON = 0.5  # A m², a magnet's moment beside the arm: up to 6 µT at 0.25 m


def sensors(trial, c, iron, seed):
    """Stamps (n,), q_WS (n, m, 4), angular velocity, acceleration and field (n, m, 3) of the trial's arm."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.02, trial.times[-1] - 0.02, 1.0 / RATE)
    q_WL, before, after = (trial.motion(t + dt) for dt in (0.0, -0.005, 0.005))
    q_WS = multiply(q_WL, c.mountings)
    turn = Rotation.from_quat(conjugate(before).reshape(-1, 4)) * Rotation.from_quat(after.reshape(-1, 4))
    rates = rotate(conjugate(c.mountings), turn.as_rotvec().reshape(*q_WL.shape[:2], 3) / 0.01)
    # Where the IMUs are: arcs through the true orientations.
    model = c.create_model('pcc_exact')

    def places(at):
        return model.fit(Measured(trial.motion(at), c.base)).positions(c.imus.positions)

    p0, p1, p2 = (places(t + dt) for dt in (-0.02, 0.0, 0.02))
    acceleration = (p0 - 2.0 * p1 + p2) / 0.02**2 + [0.0, 0.0, 9.80665]
    field = np.broadcast_to(EARTH, p1.shape)
    if iron:
        away = p1 - (rotate(c.base, np.array([0.25, 0.1, 0.45])))
        r = np.linalg.norm(away, axis=-1, keepdims=True)
        u, moment = away / r, np.array([1.0, 1.0, 0.0]) * IRON / np.sqrt(2)
        field = field + 1e-7 * (3.0 * u * (u @ moment)[..., None] - moment) / r**3
    to_sensor = conjugate(q_WS)
    gyr = rates + BIAS * rng.choice([-1.0, 1.0], (1, *rates.shape[1:])) / np.sqrt(3)
    return (
        t,
        q_WS,
        gyr + rng.normal(0.0, GYRO_NOISE, rates.shape),
        rotate(to_sensor, acceleration) + rng.normal(0.0, ACCELERATION_NOISE, rates.shape),
        rotate(to_sensor, field) + rng.normal(0.0, FIELD_NOISE, rates.shape),
    )


def write(path, ids, t, gyr, acc, mag):
    """The bag that drivers of such IMUs would have filled."""
    stamps = START_NS + np.round(t * 1e9).astype(np.int64)
    with new_bag(path) as bag:
        made = []
        for k, imu in enumerate(ids):
            own = stamps + 500_000 * k
            topic, beside = (
                bag.add_topic(f'/imu_{imu}/data', TYPE),
                bag.add_topic(f'/imu_{imu}/mag', FIELD_TYPE),
            )
            made += zip(
                own,
                [topic] * len(t),
                ImuMessages(f'imu_{imu}').make_raw(own, gyr[:, k], acc[:, k]),
                strict=True,
            )
            made += zip(
                own, [beside] * len(t), FieldMessages(f'imu_{imu}').make_fields(own, mag[:, k]), strict=True
            )
        for stamp, topic, row in sorted(made, key=lambda one: one[0]):
            bag.write(topic, int(stamp), row.tobytes())


def fused(path, ids, fusion, n):
    """What the intake makes of a bag, (n, m, 4); NaN where there is none."""
    intake = OrientationIntake(fusion, ids)
    out = np.full((n, len(ids), 4), np.nan)
    with open_recording(path) as recording:
        for block in ImuRecording(recording, intake=intake).blocks():
            k = np.searchsorted(ids, block.ids)
            row = np.round((block.stamps_ns - START_NS - 500_000 * k) / 1e9 * RATE).astype(int) - 2
            out[row, k] = block.orientations
    return out


def marker_errors(model, c, trial, t, q_WL):
    """Median error at each marker, % of arc length."""
    places = model.fit(Measured(q_WL, c.base)).positions(trial.marker_positions)
    n, m = len(t), len(trial.marker_positions)
    truth = [np.interp(t, trial.truth_times, one) for one in trial.markers.reshape(-1, 3 * m).T]
    off = np.linalg.norm(places - np.transpose(truth).reshape(n, m, 3), axis=-1)
    return np.median(off, axis=0) / trial.marker_positions * 100


def main():
    """Print the table."""
    folder = Path(sys.argv[1])
    trial = Trial.load(folder / TRIAL_FILE)
    with open_recording(folder) as recording:
        c = files.parse(ImuRecording(recording).configuration(), 'trial')
    ids = list(c.imus.ids)
    model = c.create_model('spline')
    print('fusion  iron  inclination  orientation  ' + '  '.join(f'{m} %' for m in c.markers.names))
    for fusion, iron in (('6d', False), ('6d', True), ('9d', False), ('9d', True)):
        t, q_WS, gyr, acc, mag = sensors(trial, c, iron, seed=1)
        with tempfile.TemporaryDirectory() as at:
            write(Path(at) / 'raw', ids, t, gyr, acc, mag)
            got = fused(Path(at) / 'raw', ids, fusion, len(t))
        good = np.isfinite(got).all(axis=(1, 2))
        t, q_WS, got = t[good], q_WS[good], got[good]
        error = Rotation.from_quat(got.reshape(-1, 4)) * Rotation.from_quat(q_WS.reshape(-1, 4)).inv()
        about_z = error.as_rotvec().reshape(*got.shape[:2], 3)[..., 2]
        heading = np.angle(np.exp(1j * about_z[t < t[0] + 3.0]).mean(axis=0))
        tilt = np.arccos(np.clip(error.apply([0.0, 0.0, 1.0])[:, 2], -1.0, 1.0))
        turn = Rotation.from_rotvec(np.tile(-heading[:, None] * [0.0, 0.0, 1.0], (len(t), 1)))
        left = (turn * error).magnitude()
        q_WL = multiply(
            (turn * Rotation.from_quat(got.reshape(-1, 4))).as_quat().reshape(got.shape),
            conjugate(c.mountings),
        )
        off = marker_errors(model, c, trial, t, q_WL)
        rms = [np.rad2deg(np.sqrt((v**2).mean())) for v in (tilt, left)]
        print(f'{fusion:6}  {"yes" if iron else "no":4}  {rms[0]:9.2f} °  {rms[1]:9.2f} °  '
              + '  '.join(f'{v:.2f}' for v in off))  # fmt: skip
    off = marker_errors(model, c, trial, t, trial.motion(t))
    print(f'truth{"":33}' + '  '.join(f'{v:.2f}' for v in off))


if __name__ == '__main__':
    main()
