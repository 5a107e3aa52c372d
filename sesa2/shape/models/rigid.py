"""Rigid links, one per IMU (paper II-A, eq. 1–2, Table I)."""

from dataclasses import dataclass

import numpy as np

from sesa2.errors import shown
from sesa2.shape.arm import GeometryError
from sesa2.shape.chain import ChainModel
from sesa2.shape.layout import Layout
from sesa2.shape.options import ModelOptions, parameter
from sesa2.shape.rotations import FloatArray


@dataclass(frozen=True)
class RigidOptions(ModelOptions):
    """Options of the model `rigid`.

    Attributes
    ----------
    boundaries
        where one IMU's link ends and the next one's begins: `midpoint`, halfway between the IMUs (second order in
        the spacing); `endpoint`, at the IMU (Table I with 8 IMUs; first order); or n_imu − 1 arc lengths, m.
    base_link_length
        L₀ of the paper, m: a first link as the base is oriented. At 0 there is none, and the first IMU's link begins
        at the base.
    """

    boundaries: str | tuple[float, ...] = parameter(
        'midpoint', 'where links meet: midpoint or endpoint, or the arc lengths between the IMUs, m'
    )
    base_link_length: float = parameter(0.0, 'L₀, length of a first link oriented as the base, m', low=0.0)


class Rigid(ChainModel):
    """Straight links, one per IMU, oriented as it is."""

    name = 'rigid'
    Options = RigidOptions

    def __init__(self, layout: Layout, options: RigidOptions):
        super().__init__(layout, options)
        boundaries, base_link_length = options.boundaries, options.base_link_length
        at = np.array(layout.imu_positions)
        if isinstance(boundaries, str):
            if boundaries not in ('midpoint', 'endpoint'):
                raise GeometryError(
                    f"boundaries = {shown(boundaries)}, expected 'midpoint', 'endpoint' or a list of arc lengths"
                )
            inner = 0.5 * (at[:-1] + at[1:]) if boundaries == 'midpoint' else at[:-1]
        else:
            inner = np.asarray(boundaries, dtype=float)
            if inner.shape != (len(at) - 1,):
                raise GeometryError(
                    f'boundaries has {inner.size} entries, expected {len(at) - 1}: one between each IMU and the next'
                )
        self._has_base_link = base_link_length > 0.0
        ends = np.array(
            [*([0.0] if self._has_base_link else []), base_link_length, *inner, layout.arm.length]
        )
        short = np.flatnonzero(np.diff(ends) <= 0.0)
        if base_link_length < 0.0 or short.size:
            raise GeometryError(
                f'links would end at {", ".join(f"{s:g}" for s in ends[1:])} m, expected increasing arc lengths'
                ' (base_link_length, boundaries, arm length)'
            )
        self._set_link_ends(ends)

    def _orient_links(self, stations: FloatArray) -> FloatArray:
        return stations if self._has_base_link else stations[..., 1:, :]
