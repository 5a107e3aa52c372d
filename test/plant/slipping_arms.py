"""Simulated arms for tests."""

from dataclasses import replace

import numpy as np

from sesa2.plant.plant_options import PlantOptions
from sesa2.plant.simulated_arm import Plant
from sesa2.sensing.lengths import BackboneLengths

THIRDS = [0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0]
IDEAL = PlantOptions(
    slip=0.0,
    affine=0.0,
    affine_spread=0.0,
    hollow=0.0,
    sag=0.0,
    lag=0.0,
    rate=1e3,
    encoder_step=0.0,
    mounting_twist=0.0,
    imu_errors=0.0,
    length_noise=0.0,
)


def tripods(m):
    ends = [k + 1 for k in range(m) for _ in range(3)]
    return BackboneLengths(m, 3 * m, ends, ends, THIRDS * m, [0.03])


def arm(options=IDEAL, m=1, backbones=None, seed=0, **rest):
    """Of segments of 160 mm that begin at 120 mm."""
    options = replace(options, seed=seed, home=(0.12,), travel=(0.05, 0.34))
    rest = {'imu_positions': 0.16 * np.arange(1, m + 1), 'base_imu': True, **rest}
    return Plant(options, segment_lengths=[0.16] * m, backbones=backbones or tripods(m), **rest)


def drive(plant, command, seconds, dt=0.02):
    for _ in range(round(seconds / dt)):
        plant.step(command, dt)


def command_of(plant, q):
    """Lengths of the racks by geometry; q per segment bend_x, bend_y, length."""
    each = np.reshape(q, (-1, 3))
    return plant.racks.backbones(each[:, 2], each[:, :2])
