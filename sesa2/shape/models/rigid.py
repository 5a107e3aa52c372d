"""Rigid links, one per IMU (paper II-A, eq. 1–2, Table I)."""

from collections.abc import Sequence

import numpy as np

from sesa2.shape.arm import Arm, GeometryError
from sesa2.shape.chain import ChainModel
from sesa2.shape.model import with_base
from sesa2.shape.rotations import FloatArray


class Rigid(ChainModel):
    """Straight links, one per IMU, oriented as it is.

    Parameters
    ----------
    arm
        the arm.
    boundaries
        where one IMU's link ends and the next one's begins: `midpoint`, halfway between the IMUs (second order in
        the spacing); `endpoint`, at the IMU (Table I with 8 IMUs; first order); or n_imu − 1 arc lengths, m.
    base_link_length
        L₀ of the paper, m: a first link as the base is oriented. At 0 there is none, and the
        first IMU's link begins at the base.
    """

    name = 'rigid'

    def __init__(
        self, arm: Arm, boundaries: str | Sequence[float] = 'midpoint', base_link_length: float = 0.0
    ):
        at = np.array(arm.imu_positions)
        if isinstance(boundaries, str):
            if boundaries not in ('midpoint', 'endpoint'):
                raise GeometryError(
                    f"boundaries = {boundaries!r}, expected 'midpoint', 'endpoint' or a list of arc lengths"
                )
            inner = 0.5 * (at[:-1] + at[1:]) if boundaries == 'midpoint' else at[:-1]
        else:
            inner = np.asarray(boundaries, dtype=float)
            if inner.shape != (len(at) - 1,):
                raise GeometryError(
                    f'boundaries has {inner.size} entries, expected {len(at) - 1}: one between each IMU and the next'
                )
        self._has_base_link = base_link_length > 0.0
        ends = np.array([*([0.0] if self._has_base_link else []), base_link_length, *inner, arm.length])
        short = np.flatnonzero(np.diff(ends) <= 0.0)
        if base_link_length < 0.0 or short.size:
            raise GeometryError(
                f'links would end at {", ".join(f"{s:g}" for s in ends[1:])} m, expected increasing arc lengths'
                ' (base_link_length, boundaries, arm length)'
            )
        super().__init__(arm, ends)

    def _orient_links(self, orientations: FloatArray, base: FloatArray) -> FloatArray:
        return with_base(orientations, base) if self._has_base_link else orientations
