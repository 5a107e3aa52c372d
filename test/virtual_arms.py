"""Arms for a virtual board, as a configuration describes them."""

import numpy as np

from sesa2.link.virtual.motion import ArmMotion
from sesa2.link.virtual.virtual_arm import VirtualArm


def halted(q):
    """A motion that stays at q_WL, shape (n_imu, 4)."""
    return lambda times: np.broadcast_to(q, (*np.shape(times), *np.shape(q)))


def plausible(configuration, t):
    """q_WL of the IMUs, shape (n_imu, 4), at a time of the thesis's motions, s."""
    return ArmMotion(configuration.imus.positions, configuration.base)(np.array(t))


def arm_of(configuration, motion=None, **options):
    """The arm with the configuration's IMUs; moving as in the thesis where no motion is given."""
    c = configuration
    return VirtualArm(
        c.imus.ids,
        motion or ArmMotion(c.imus.positions, c.base),
        mount_orientations=c.mountings,
        headings=c.headings,
        **options,
    )
