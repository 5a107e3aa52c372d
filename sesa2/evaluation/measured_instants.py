"""What was measured at some instants, and the shape of an arm then by a configuration that is being corrected."""

from typing import NamedTuple

import numpy as np

from sesa2.bags.recorded_sweeps import RecordedSweeps
from sesa2.configuration import Configuration
from sesa2.evaluation.trajectory import EvaluationError, Trajectory
from sesa2.sensing.imu.mounting import Mounting
from sesa2.shape.measured import Measured
from sesa2.shape.missing import fill_missing
from sesa2.shape.rotations import FloatArray, conjugate, multiply, rotate, slerp
from sesa2.time import NS

LONGEST_GAP = 0.25  # s between sweeps that an instant may lie in
_MOST = 120  # distinct instants; more tell nothing new


class MeasuredInstants(NamedTuple):
    """What was measured.

    Attributes
    ----------
    orientations : (n, n_imu, 4)
        q_WS, x y z w.
    measured : (n, n_imu)
        true where the IMU has measured.
    base : (n, 4)
        q_WS of the IMU on the base where there is one, else q_WB; x y z w.
    lengths : (n, n_backbones) or None
        of the backbones as they are said, m.
    points : (n, m, 3)
        true positions of the markers, m; NaN where one was not seen. Empty where there is no truth.
    times : (n,)
        s.
    """

    orientations: FloatArray
    measured: np.ndarray
    base: FloatArray
    lengths: FloatArray | None
    points: FloatArray
    times: FloatArray

    @classmethod
    def of(cls, sweeps: RecordedSweeps, c: Configuration) -> 'MeasuredInstants':
        """All sweeps of a recording that was read with this configuration."""
        base = multiply(sweeps.base, c.base_mounting) if c.imus.base_id else sweeps.base
        times = sweeps.stamps_ns / NS
        points = np.zeros((len(times), 0, 3))
        return cls(sweeps.orientations, sweeps.measured, base, sweeps.lengths, points, times)

    def chosen(self, which: np.ndarray) -> 'MeasuredInstants':
        """Some of them."""
        return self._replace(
            **{name: values[which] for name, values in self._asdict().items() if values is not None}
        )

    def usable(self, c: Configuration) -> np.ndarray:
        """Those with an orientation and all lengths, (n,), bool.

        Raises
        ------
        EvaluationError
            the configuration has lengths, and these have none.
        """
        usable = self.measured.any(axis=1)
        if not c.has_lengths:
            return usable
        if self.lengths is None:
            raise EvaluationError(
                'the recording has no lengths of backbones, and the configuration has lengths'
            )
        return np.asarray(usable & (c.backbones.read(self.lengths).lengths > 0.0).all(axis=1))


def shape_at(
    c: Configuration, model: str, instants: MeasuredInstants, s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The arm by a model of a configuration.

    Parameters
    ----------
    c
        may differ from that of the recording in what is learnt about sensors.
    model
        its name.
    instants
        n of them.
    s : (m,)
        arc lengths, m.

    Returns
    -------
    Points, (n, m, 3), m, and the orientations there, (n, m, 4), in the frame of the results.
    """
    links = Mounting(c.mountings, c.headings).link_orientations(instants.orientations)
    base = instants.base
    if c.imus.base_id:
        base = multiply(base, conjugate(c.base_mounting))
    links = fill_missing(links, instants.measured, c.layout, base)
    lengths = bends = None
    if instants.lengths is not None:
        lengths, bends = c.backbones.read(instants.lengths)
    backbone = c.create_model(model).fit(Measured(links, base, lengths, bends))
    p, q = backbone.positions(s), backbone.orientations(s)
    if c.arm.output_frame == 'world':
        return p, q
    to_base = conjugate(base)[:, None]
    return rotate(to_base, p), multiply(to_base, q)


def at_truth(whole: MeasuredInstants, truth: Trajectory, offset: float) -> MeasuredInstants:
    """What was measured at the truth's instants, interpolated between the sweeps beside them."""
    seen = truth.seen.any(axis=1)
    t, points = truth.times[seen] - offset, truth.positions[seen]
    last = len(whole.times) - 1
    after = np.clip(np.searchsorted(whole.times, t), 0, last)
    before = np.clip(after - 1, 0, last)
    # Beyond the ends, and exactly on a sweep, that sweep itself.
    before = np.where((whole.times[after] <= t) | (after == 0), after, before)
    gap = whole.times[after] - whole.times[before]
    beyond = np.maximum(whole.times[before] - t, t - whole.times[after])
    near = (gap <= LONGEST_GAP) & (beyond <= 0.5 * LONGEST_GAP)
    before, after, gap, t = before[near], after[near], gap[near], t[near]
    fraction = np.clip((t - whole.times[before]) / np.where(gap > 0.0, gap, 1.0), 0.0, 1.0)
    measured = whole.measured[before] & whole.measured[after]
    there = measured.any(axis=1)
    lengths = None
    if whole.lengths is not None:
        lengths = whole.lengths[before] + fraction[:, None] * (whole.lengths[after] - whole.lengths[before])
    return MeasuredInstants(
        slerp(whole.orientations[before], whole.orientations[after], fraction[:, None]),
        measured,
        slerp(whole.base[before], whole.base[after], fraction),
        lengths,
        points[near],
        t,
    ).chosen(there)


def distinct(points: FloatArray, apart: float) -> np.ndarray:
    """Instants at which some marker is elsewhere than at each of the others; in the order of a fixed shuffle."""
    chosen: list[int] = []
    for i in np.random.default_rng(0).permutation(len(points)):
        off = np.linalg.norm(points[chosen] - points[i], axis=-1)
        if not chosen or (np.nanmax(np.where(np.isnan(off), 0.0, off), axis=1) > apart).all():
            chosen.append(int(i))
            if len(chosen) == _MOST:
                break
    return np.sort(chosen)
