"""The accelerometers' calibrations that a configuration's calibration file keeps, for fusion on the host."""

from sesa2.configuration.records import Configuration
from sesa2.sensing.imu.accelerometer_calibration import KeptAccelerometers
from sesa2.sensing.imu.bno055.offsets import load_accelerometers, offsets_are_there


def keep_accelerometers(c: Configuration) -> KeptAccelerometers:
    """Those of the IMUs that are used, where the host fuses and a file is named; a file that is not there is a problem.

    Raises
    ------
    OffsetsError
        the file is no calibration file.
    """
    path = c.calibration.file
    if c.imus.fusion == 'none' or not path or c.run.mode == 'calibrate':
        return KeptAccelerometers({})
    if not offsets_are_there(path):
        return KeptAccelerometers(
            {}, (f'calibration file {path} is not there: the accelerometers are used as they are',)
        )
    return KeptAccelerometers(load_accelerometers(path, c.imus.used_ids))
