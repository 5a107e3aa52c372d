"""The virtual boards that belong to a configuration."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from sesa2.bags.trial_bag import TRIAL_FILE
from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.link.clock import steady_ns
from sesa2.link.virtual.motion import ArmMotion, Motion
from sesa2.link.virtual.virtual_arm import VirtualArm
from sesa2.link.virtual.virtual_board import VirtualBoard
from sesa2.sensing.imu.addresses import ids_by_board
from sesa2.shape.rotations import FloatArray
from sesa2.twin.trial import Trial


def make_virtual_boards(c: Configuration, link: Path | None = None) -> list[VirtualBoard]:
    """As many virtual boards as the configuration's IMUs need, on one plausible arm that moves.

    Parameters
    ----------
    c
        its IMUs, mountings and headings; what the estimator corrects is what the board plays. With `run.trial`, the
        motion of that trial.
    link
        name to give the pseudo-terminal; of several, the others have this one with 2, 3, … after it.
    """
    ids, positions, mountings, headings = c.imus.ids, c.imus.positions, c.mountings, c.headings
    if c.imus.base_id:  # a chip on the clamp too, the first
        ids, positions = (c.imus.base_id, *ids), (0.0, *positions)
        mountings = np.vstack([c.base_mounting, mountings])
        headings = np.concatenate([[0.0], headings])
    motion = _recorded(c) if c.run.trial else ArmMotion(positions, c.base)
    arm = VirtualArm(ids, motion, mount_orientations=mountings, headings=headings)
    count, epoch_ns = 1 + max(ids_by_board(arm.ids)), steady_ns()
    links = [link and link.with_name(f'{link.name}{k + 1 if k else ""}') for k in range(count)]
    boards: list[VirtualBoard] = []
    try:
        for number, own in enumerate(links):
            boards.append(VirtualBoard(arm, number=number, epoch_ns=epoch_ns, link=own))
    except Sesa2Error:
        for board in boards:
            board.close()
        raise
    return boards


def _recorded(c: Configuration) -> Motion:
    """The true motion of a simulated trial; held at its end."""
    path = Path(c.run.trial)
    trial = Trial.load(path / TRIAL_FILE if path.is_dir() else path)
    expected, got = c.imus.positions, trial.imu_positions.tolist()
    if len(expected) != len(got) or not np.allclose(expected, got, atol=1e-6):
        raise Sesa2Error(
            f'{path}: IMUs at {got} m, expected those of the configuration at {list(expected)} m'
        )

    def motion(t: ArrayLike) -> FloatArray:
        t = np.asarray(t, dtype=float)
        links = trial.motion(t.ravel()).reshape(*t.shape, -1, 4)
        if not c.imus.base_id:
            return links
        return np.concatenate([np.broadcast_to(trial.base, (*t.shape, 1, 4)), links], axis=-2)

    return motion
