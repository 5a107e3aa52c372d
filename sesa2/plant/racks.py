"""Racks that drive the backbones of an arm: motors that lag, teeth that slip the more the arm bends."""

import numpy as np
from numpy.typing import ArrayLike

from sesa2.plant.plant_options import PlantOptions
from sesa2.sensing.lengths import BackboneLengths
from sesa2.shape.arm import GeometryError
from sesa2.shape.rotations import FloatArray

# More than that could not be driven against.
_MOST = 0.9
_TRAVEL = (0.3, 2.2)  # of the length at rest


class Racks:
    """A rack and its motor for each backbone.

    An encoder sits on the motor and sees how far it has gone. Of each motion a backbone takes all but the share that
    slips: slip · (1 − exp(−|bend| / slip_bend)), less where the load of the bent arm helps. So what was lost depends on
    the way, and the encoders know nothing of it.

    Parameters
    ----------
    backbones
        where the driven backbones run.
    segment_lengths : (m,)
        at rest, m.
    options
        of the simulated arm.
    rng
        source of chance: how the racks differ.

    Attributes
    ----------
    travelled : (n,)
        where the motors are: the lengths if nothing had slipped, m.
    engaged : (n,)
        true lengths of the backbones, m.
    limits : (2, n)
        shortest and longest, m.

    Raises
    ------
    GeometryError
        the backbones do not determine all segments, or more than that; `home` or `travel` does not fit.
    """

    def __init__(
        self,
        backbones: BackboneLengths,
        segment_lengths: FloatArray,
        options: PlantOptions,
        rng: np.random.Generator,
    ):
        n, m = backbones.n_backbones, len(segment_lengths)
        if not backbones.drives:
            raise GeometryError(
                f'{n} racks on {m} segments, expected three that tell length and bend of each'
            )
        if len(options.home) not in (0, 1, m):
            raise GeometryError(f'home has {len(options.home)} entries, expected 1 or {m}')
        if len(options.travel) not in (0, 2) or (
            options.travel and not options.travel[0] < options.travel[1]
        ):
            raise GeometryError(f'travel = {list(options.travel)} m, expected the shortest and the longest')
        self._backbones, self._options = backbones, options
        self._through = backbones.through.astype(float)
        self.home = np.broadcast_to(np.array(options.home or segment_lengths), (m,))
        if options.travel:
            self.limits = np.outer(options.travel, backbones.through.sum(axis=1))
        else:
            self.limits = np.outer(_TRAVEL, backbones.through @ segment_lengths)
        self.engaged = self._at_home()
        for i, at in enumerate(self.engaged):
            low, high = self.limits[:, i]
            if not low <= at <= high:
                raise GeometryError(
                    f'home: backbone {i} begins at {at:g} m, and its travel is {low:g} to {high:g} m'
                )
        self.travelled = self.engaged.copy()
        self._slip = np.minimum(options.slip * np.exp(options.slip_spread * rng.standard_normal(n)), _MOST)

    def _at_home(self) -> FloatArray:
        return self._backbones.backbones(self.home, np.zeros((len(self.home), 2)))

    def move(self, command: ArrayLike, dt: float, bends: FloatArray) -> None:
        """Let the motors run towards a command.

        Parameters
        ----------
        command : (n,)
            lengths of the backbones, m; what is beyond the travel stops at its end.
        dt
            for how long, s.
        bends : (m, 2)
            of the segments now, rad.
        """
        o, (low, high) = self._options, self.limits
        left = np.minimum(np.maximum(command, low), high) - self.travelled
        step = left * (1.0 - np.exp(-dt / o.lag)) if o.lag > 0.0 else left
        furthest = o.rate * dt
        step = np.minimum(np.maximum(step, -furthest), furthest)
        slip = self._share_lost(np.sign(step), bends) * step if o.slip > 0.0 else 0.0
        self.travelled = self.travelled + step
        self.engaged = np.minimum(np.maximum(self.engaged + step - slip, low), high)

    def _share_lost(self, direction: FloatArray, bends: FloatArray) -> FloatArray:
        o = self._options
        bend: FloatArray = self._through @ np.hypot(bends[:, 0], bends[:, 1])
        room = 1.0 - direction * (self.travelled - self.engaged) / o.slip_reach
        return np.clip(self._slip * (1.0 - np.exp(-bend / o.slip_bend)) * room, 0.0, _MOST)
