"""An IMU without orientation that is held with each of its sides up in turn."""

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

RATE = 100.0
UP = np.vstack([v for axis in np.eye(3) for v in (axis, -axis)])
NOISE, GYRO_NOISE, GYRO_BIAS = 0.05, 0.01, np.array([0.05, -0.03, 0.02])


def recording(rng, held_s, turning_s=1.5):
    """An IMU that is held with each side up and turned to the next; times, accelerations, angular velocities, spans."""
    knots, at, spans, t = [], [], [], 0.0
    for up, s in zip(UP, held_s, strict=True):
        turn, _ = Rotation.align_vectors([[0, 0, 1]], [up])
        knots += [turn, turn]
        at += [t, t + s]
        spans.append((t, t + s))
        t += s + turning_s
    times = np.arange(0.0, at[-1], 1 / RATE)
    motion = Slerp(at, Rotation.concatenate(knots))
    into_sensor = motion(times).inv()
    after = motion(np.minimum(times + 1e-3, at[-1]))
    w = (into_sensor * after).as_rotvec() / 1e-3 + GYRO_BIAS
    a = into_sensor.apply([0, 0, 9.81])
    return times, a + rng.normal(0, NOISE, a.shape), w + rng.normal(0, GYRO_NOISE, w.shape), spans
