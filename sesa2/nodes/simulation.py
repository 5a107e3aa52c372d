"""The virtual board that belongs to a configuration."""

from pathlib import Path

from sesa2.configuration import Configuration
from sesa2.link.virtual.arm import Arm
from sesa2.link.virtual.board import VirtualBoard
from sesa2.link.virtual.motion import ArmMotion


def make_virtual_board(c: Configuration, link: Path | None = None) -> VirtualBoard:
    """A virtual board with the configuration's IMUs, on a plausible arm that moves.

    Parameters
    ----------
    c
        its IMUs, mountings and headings; what the estimator corrects is what the board plays.
    link
        name to give the pseudo-terminal.
    """
    motion = ArmMotion(c.imus.positions, c.base)
    arm = Arm(c.imus.ids, motion, mount_orientations=c.mountings, headings=c.headings)
    return VirtualBoard(arm, link=link)
