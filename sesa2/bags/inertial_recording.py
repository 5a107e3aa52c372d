"""What gyroscopes and accelerometers measured in a recording, IMU by IMU."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sesa2.bags.reading import ImuRecording
from sesa2.bags.recording import open_recording
from sesa2.messages.imu_messages import read_imus
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS


class Inertial(NamedTuple):
    """Of one IMU.

    Attributes
    ----------
    times : (n,)
        s, from the first sample of the recording, increasing.
    angular_velocities, accelerations : (n, 3)
        in the sensor's axes, rad/s and m/s².
    """

    times: FloatArray
    angular_velocities: FloatArray
    accelerations: FloatArray


def read_inertial(
    source: str | Path | Mapping[int, Path], first_id: int | None = None
) -> dict[int, Inertial]:
    """Of each IMU that gives both; those that give one alone, or neither, are not in it.

    Raises
    ------
    Sesa2Error
        the recording is not readable, or has no IMU.
    """
    ids, stamps, values = [], [], []
    with open_recording(source, first_id) as recording:
        for block in ImuRecording(recording).blocks():
            read = read_imus(block.data)
            whole = read.has_inertial & np.isfinite(read.angular_velocities + read.accelerations).all(axis=1)
            ids.append(block.ids[whole])
            stamps.append(block.stamps_ns[whole])
            values.append(np.hstack([read.angular_velocities, read.accelerations])[whole])
    all_ids, stamps_ns = np.concatenate([[], *ids]).astype(int), np.concatenate([[], *stamps])
    numbers = np.vstack([np.zeros((0, 6)), *values])
    found = {}
    for imu in np.unique(all_ids).tolist():
        own = np.flatnonzero(all_ids == imu)
        _, first = np.unique(stamps_ns[own], return_index=True)
        rows = own[first]
        times = (stamps_ns[rows] - stamps_ns.min()) / NS
        found[imu] = Inertial(times, numbers[rows, :3], numbers[rows, 3:])
    return found
