"""`sesa2 align --accelerometers`: their bias, scale and misalignment from still poses, kept in the calibration file."""

import argparse

from sesa2.commands.arguments import load_config, warn
from sesa2.configuration.description import table
from sesa2.errors import Sesa2Error
from sesa2.sensing.imu.accelerometer_calibration import PoseFit


def align_accelerometers(options: argparse.Namespace) -> int:
    """Find the poses in a recording, fit, report, keep."""
    from sesa2.bags.inertial_recording import read_inertial
    from sesa2.bags.sensor_logs import assign_logs
    from sesa2.sensing.imu.accelerometer_calibration import calibrate_accelerometer
    from sesa2.sensing.imu.bno055.offsets import save_accelerometer
    from sesa2.sensing.imu.still_poses import still_poses

    c = load_config(options)
    file = c.calibration.file
    if not file:
        raise Sesa2Error('calibration.file is empty, expected the file in which the calibrations are kept')
    inertial = read_inertial(assign_logs(options.source, c.imus.all_ids), options.first_id)
    rows, problems = [], []
    for imu in c.imus.all_ids:
        if imu not in inertial:
            problems.append(f'IMU {imu}: no sample with angular velocity and acceleration')
            continue
        t, w, a = inertial[imu]
        chosen = (t >= options.start) & (t < options.start + options.duration)
        poses = still_poses(t[chosen], a[chosen], w[chosen])
        try:
            fit = calibrate_accelerometer([pose.acceleration for pose in poses], options.gravity)
        except Sesa2Error as error:
            problems.append(f'IMU {imu}: {error}')
            continue
        save_accelerometer(file, imu, fit.calibration)
        rows.append((imu, len(poses), *described(fit)))
    warn(problems)
    if not rows:
        raise Sesa2Error(
            'no accelerometer was calibrated: hold every IMU still for 2 s with each of its six sides up'
        )
    print('\n'.join(table(('IMU', 'poses', 'bias [m/s²]', 'scale', 'misalignment', 'left [m/s²]'), rows)))
    print(f'kept in {file}')
    return 0


def described(fit: PoseFit) -> tuple[str, str, str, str]:
    """Bias, scale, whether misalignment is in it, and what is left: for people."""
    bias = ' '.join(f'{value:+.3f}' for value in fit.calibration.bias)
    scale = ' '.join(f'{row[k]:.4f}' for k, row in enumerate(fit.calibration.matrix))
    return bias, scale, 'known' if fit.exact else 'not told: poses by hand', f'{fit.residual:.4f}'
