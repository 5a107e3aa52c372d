"""Virtual boards with the IMUs of a configuration, however these move."""

from pathlib import Path

import numpy as np

from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.link.clock import steady_ns
from sesa2.link.virtual.motion import Motion
from sesa2.link.virtual.virtual_arm import VirtualArm
from sesa2.link.virtual.virtual_board import VirtualBoard
from sesa2.sensing.imu.addresses import ids_by_board


def configured_boards(
    c: Configuration,
    motion: Motion,
    *,
    link: Path | None = None,
    epoch_ns: int | None = None,
    ahead: int = 16,
) -> list[VirtualBoard]:
    """As many virtual boards as the configuration's IMUs need, on one arm.

    Parameters
    ----------
    c
        its IMUs, mountings and headings; what the estimator corrects is what the board plays.
    motion
        of the IMUs in the order of `imus.all_ids`: that on the base last.
    link
        name to give the pseudo-terminal; of several, the others have this one with 2, 3, … after it.
    epoch_ns
        time of `sesa2.link.clock.steady_ns` at which the motion begins; by default now.
    ahead
        how many sweeps are measured at once; 1 where the motion is not known before.

    Raises
    ------
    LinkError
        a link's path is taken.
    """
    mountings, headings = c.mountings, c.headings
    if c.imus.base_id:
        mountings, headings = np.vstack([mountings, c.base_mounting]), np.append(headings, 0.0)
    arm = VirtualArm(c.imus.all_ids, motion, mount_orientations=mountings, headings=headings)
    count, epoch_ns = 1 + max(ids_by_board(arm.ids)), steady_ns() if epoch_ns is None else epoch_ns
    links = [link and link.with_name(f'{link.name}{k + 1 if k else ""}') for k in range(count)]
    boards: list[VirtualBoard] = []
    try:
        for number, own in enumerate(links):
            boards.append(VirtualBoard(arm, number=number, epoch_ns=epoch_ns, link=own, ahead=ahead))
    except Sesa2Error:
        for board in boards:
            board.close()
        raise
    return boards
