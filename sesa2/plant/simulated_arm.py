"""The simulated arm: racks, slip, weight and uneven curvature make its shape; encoders and IMUs say what they see."""

import numpy as np
from numpy.typing import ArrayLike

from sesa2.plant.own_weight import OwnWeight
from sesa2.plant.plant_options import PlantOptions
from sesa2.plant.racks import Racks
from sesa2.plant.recent_past import RecentPast
from sesa2.plant.uneven_segments import UnevenSegments
from sesa2.sensing.imu.error_model import Bno055Errors
from sesa2.sensing.imu.error_process import ErrorProcess
from sesa2.sensing.lengths import BackboneLengths
from sesa2.shape.arm import GeometryError
from sesa2.shape.rotations import IDENTITY, FloatArray, multiply

_GIVE_S = 0.1  # in which the arm gives way to a load
_RADIUS = 0.03  # m, of racks of which the configuration knows nothing
_KEPT = 512  # steps: seconds of them, as somebody may ask for the past
_ROUNDS = 30  # until the weight of the arm at the start has bent it


class Plant:
    """An arm of segments with three racks each, from the clamp to the tip; everything is drawn from the seed.

    `step` takes it on, everything else can be asked at any time and costs when it is asked. The same seed, options and
    commands give the same arm. With `slip`, `sag`, `affine`, `hollow`, `lag`, `encoder_step` 0 and `rate` large its
    shape is that of constant curvature by the command.

    Parameters
    ----------
    options
        how large everything is that it gets wrong.
    segment_lengths : (m,)
        at rest, base to tip, m.
    backbones
        those whose lengths are measured, n. Where those beside the axis are three that tell each segment, racks drive
        them, and their encoders say what they know; of all others the true length is said. Otherwise the arm has racks
        of its own that nobody hears of.
    imu_positions : (n_imu,)
        material arc lengths of the IMUs, m.
    base : (4,)
        q_WB, x y z w.
    base_imu
        whether one more IMU sits on the base; it comes last.
    errors
        of the IMUs; by default those of a BNO055, `options.imu_errors` times.

    Attributes
    ----------
    time
        since the start, s.
    home : (m,)
        lengths of the segments at the start, m.
    racks
        where the racks run, three a segment.
    driven : (3 m,) or (0,)
        places of the racks among `backbones`.
    push : (2,)
        bend by which somebody pushes the arm now, shared by its segments, rad; may be set.
    imus
        errors of the IMUs, as they are now.

    Raises
    ------
    GeometryError
        these racks do not drive these segments; a list has the wrong length.
    """

    def __init__(
        self,
        options: PlantOptions,
        *,
        segment_lengths: ArrayLike,
        backbones: BackboneLengths,
        imu_positions: ArrayLike,
        base: ArrayLike = IDENTITY,
        base_imu: bool = False,
        errors: Bno055Errors | None = None,
    ):
        self.options = options
        rest = np.array(segment_lengths, dtype=float)
        m = len(rest)
        if len(options.push) != 2:
            raise GeometryError(f'push has {len(options.push)} numbers, expected 2: bend_x and bend_y')
        drive_seed, shape_seed, error_seed, noise_seed = np.random.SeedSequence(options.seed).spawn(4)
        self.segment_lengths, self.base, self._base_imu = rest, np.asarray(base, dtype=float), base_imu
        self._backbones = backbones
        beside = np.flatnonzero(backbones.radii > 0.0)
        known = len(beside) > 0 and backbones.chosen(beside.tolist()).drives
        self.driven = beside if known else beside[:0]
        self.racks = backbones.chosen(beside.tolist()) if known else _three_each(m)
        self._racks = Racks(self.racks, rest, options, np.random.default_rng(drive_seed))
        self.home = self._racks.home
        rng = np.random.default_rng(shape_seed)
        self.affine = options.affine + options.affine_spread * rng.standard_normal(m)
        self._hollow = np.full(m, options.hollow)
        self._imu_places, self._tip_place = self.places(imu_positions), self.places([rest.sum()])
        self._weight = OwnWeight(rest, options.sag, self.base)
        self._shares = rest[:, None] / rest.sum()
        self.push = np.array(options.push)
        errors = Bno055Errors().times(options.imu_errors) if errors is None else errors
        self.latency = errors.latency
        rng, n_imu = np.random.default_rng(error_seed), len(np.atleast_1d(imu_positions))
        self.imus = ErrorProcess(errors, n_imu + base_imu, rng)
        twist = options.imu_errors * options.mounting_twist
        self.imus.mountings[:n_imu, 2] += twist * rng.standard_normal(n_imu)
        self._noise = np.random.default_rng(noise_seed)
        self.time = 0.0
        self._reading = self.racks.read(self._racks.engaged)
        self._given = np.zeros((m, 2))
        for _ in range(_ROUNDS):
            self._given = self._load()
        self._past = RecentPast(_KEPT, self.time, self.coordinates)

    # What is done to it

    def step(self, command: ArrayLike, dt: float) -> None:
        """Let time pass.

        Parameters
        ----------
        command : (3 m,)
            wanted lengths of the racks, in their order, m.
        dt
            s; above 0.02 the slip is that of large strides.
        """
        self._racks.move(command, dt, self.bends)
        self._reading = self.racks.read(self._racks.engaged)
        self._given = self._given + (1.0 - np.exp(-dt / _GIVE_S)) * (self._load() - self._given)
        self.imus.advance(dt)
        self.time += dt
        self._past.append(self.time, self.coordinates)

    def _load(self) -> FloatArray:
        """Bends that weight and push would give, were they given the time; (m, 2), rad."""
        load = self._shares * self.push
        return load + self._weight.bends(self.bends, self.lengths) if self.options.sag > 0.0 else load

    # What its sensors say

    @property
    def encoders(self) -> FloatArray:
        """Lengths of the racks as their encoders say, (3 m,), m: what slips they do not see."""
        step = self.options.encoder_step
        return np.round(self._racks.travelled / step) * step if step > 0.0 else self._racks.travelled.copy()

    @property
    def said_lengths(self) -> FloatArray:
        """What is said of all backbones, (n,), m, before scale and offset; new noise at each call."""
        lengths = self._backbones.backbones(self.lengths, self.bends)
        lengths += self.options.length_noise * self._noise.standard_normal(len(lengths))
        if len(self.driven):
            lengths[self.driven] = self.encoders
        return self._backbones.uncalibrated(lengths)

    def commanded(self, said: ArrayLike) -> FloatArray:
        """Lengths that a driver goes to when it is told these, (3 m,), m: its own, as it says them of the backbones."""
        own = np.zeros(self._backbones.n_backbones)
        own[self.driven] = said
        return self._backbones.calibrated(own)[self.driven]

    @property
    def imu_orientations(self) -> FloatArray:
        """What the IMUs measure, (n_imu, 4) or one more with that on the base: q_WL with all errors, x y z w."""
        return self.imu_orientations_at(self.time)

    def imu_orientations_at(self, time: float | FloatArray) -> FloatArray:
        """The same where they are read at times that have passed, s, (...) + (n_imu, 4); new noise at each call."""
        return self.imus.measured(self.link_orientations_at(time - self.latency))

    # The truth

    @property
    def lengths(self) -> FloatArray:
        """True length of each segment on its axis, (m,), m."""
        return self._reading.lengths

    @property
    def bends(self) -> FloatArray:
        """True bend of each segment, bend_x and bend_y, (m, 2), rad."""
        return self._reading.bends + self._given

    @property
    def coordinates(self) -> FloatArray:
        """Of the true shape: bend_x, bend_y, length of each segment, (3 m,), rad and m."""
        return np.column_stack([self.bends, self.lengths]).ravel()

    def coordinates_at(self, time: float | FloatArray) -> FloatArray:
        """The same at times of the last steps, s, (...) + (3 m,); held before the first and after the last of them."""
        return self._past.at(time)

    @property
    def tip(self) -> FloatArray:
        """True position of the tip in base_link, (3,), m."""
        return self.shape(self._tip_place)[0][0]

    def tip_at(self, time: float) -> FloatArray:
        """The same at a time of the last steps, s."""
        return self.shape(self._tip_place, self.coordinates_at(time))[0][..., 0, :]

    def link_orientations_at(self, time: float | FloatArray) -> FloatArray:
        """True q_WL where the IMUs are at times of the last steps, s, (...) + (n_imu, 4), x y z w; on the base last."""
        return self.link_orientations_of(self.coordinates_at(time))

    def link_orientations_of(self, coordinates: FloatArray) -> FloatArray:
        """The same of shapes by their coordinates, batch + (3 m,); batch + (n_imu, 4)."""
        q = multiply(self.base, self.shape(self._imu_places, coordinates)[1])
        if not self._base_imu:
            return q
        return np.concatenate([q, np.broadcast_to(self.base, (*q.shape[:-2], 1, 4))], axis=-2)

    def places(self, s: ArrayLike) -> UnevenSegments:
        """What `shape` needs to know of material arc lengths, (n,), m."""
        return UnevenSegments(self.segment_lengths, self.affine, self._hollow, s)

    def shape(
        self, places: UnevenSegments, coordinates: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """True positions, batch + (n, 3), m, and orientations, batch + (n, 4), x y z w, in base_link.

        Parameters
        ----------
        places
            from `places`.
        coordinates : batch + (3 m,)
            of the shape; default: now.
        """
        q = self.coordinates if coordinates is None else np.asarray(coordinates, dtype=float)
        each = q.reshape(*q.shape[:-1], -1, 3)
        return places.poses(each[..., :2], each[..., 2])


def _three_each(m: int) -> BackboneLengths:
    """Three racks on each of m segments."""
    ends, turns = np.repeat(np.arange(1, m + 1), 3), 2.0 * np.pi / 3.0 * np.arange(3)
    return BackboneLengths(m, 3 * m, ends.tolist(), ends.tolist(), np.tile(turns, m).tolist(), [_RADIUS])
