"""The virtual boards that belong to a configuration."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from sesa2.bags.trial_bag import TRIAL_FILE
from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.link.virtual.configured_boards import configured_boards
from sesa2.link.virtual.motion import ArmMotion, Motion
from sesa2.link.virtual.virtual_board import VirtualBoard
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
    links = _recorded(c) if c.run.trial else ArmMotion(c.imus.positions, c.base)
    return configured_boards(c, _with_base(links, c.base) if c.imus.base_id else links, link=link)


def _with_base(links: Motion, base: FloatArray) -> Motion:
    """The motion of links and, last, of a base that stands still."""

    def motion(t: ArrayLike) -> FloatArray:
        t = np.asarray(t, dtype=float)
        return np.concatenate([links(t), np.broadcast_to(base, (*t.shape, 1, 4))], axis=-2)

    return motion


def _recorded(c: Configuration) -> Motion:
    """The true motion of a simulated trial; held at its end."""
    if c.has_lengths:
        raise Sesa2Error(
            'run.trial: a board plays no lengths, and this arm needs them; expected its bag with the source bag'
        )
    path = Path(c.run.trial)
    trial = Trial.load(path / TRIAL_FILE if path.is_dir() else path)
    expected, got = c.imus.positions, trial.imu_positions.tolist()
    if len(expected) != len(got) or not np.allclose(expected, got, atol=1e-6):
        raise Sesa2Error(
            f'{path}: IMUs at {got} m, expected those of the configuration at {list(expected)} m'
        )

    def motion(t: ArrayLike) -> FloatArray:
        t = np.asarray(t, dtype=float)
        return trial.motion(t.ravel()).reshape(*t.shape, -1, 4)

    return motion
