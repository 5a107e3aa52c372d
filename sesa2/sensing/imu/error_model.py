"""What a BNO055 on a soft arm gets wrong, source by source: for simulated recordings and for the error budget."""

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from sesa2.errors import Sesa2Error
from sesa2.shape.rotations import IDENTITY, FloatArray, from_rotation_vector, multiply, normalize, slerp

# The fields of `Bno055Errors` behind each source of error that people speak of.
SOURCES: dict[str, tuple[str, ...]] = {
    'noise': ('white',),
    'mounting': ('mounting',),
    'heading': ('heading', 'heading_wander'),
    'tilt': ('tilt',),
    'latency': ('latency', 'read_interval'),
    'quantisation': ('step',),
}
_TIME_CONSTANTS = ('heading_time', 'tilt_time')
_ANGLES = ('mounting', 'heading', 'heading_wander', 'tilt', 'white')


class ErrorModelError(Sesa2Error):
    """An error model that cannot be, or nothing to apply it to."""


@dataclass(frozen=True)
class Bno055Errors:
    """How large each error is; 0 turns it off. Angles are standard deviations.

    Attributes
    ----------
    mounting
        the sensor in its link against its nominal mounting, rad about each axis, constant.
    heading
        constant part of the heading error (magnetic surroundings), rad about the vertical.
    heading_wander, heading_time
        part of the heading error that comes and goes, rad, and its correlation time, s (Gauss–Markov).
    tilt, tilt_time
        slow error of the vertical (acceleration taken for gravity), rad about each horizontal axis, and its correlation
        time, s (Gauss–Markov).
    white
        noise of each sample, rad about each axis.
    latency
        age of an orientation when it is read, s.
    read_interval
        time from reading one IMU to reading the next within a sweep, s; 4 ms for eight at 400 kHz.
    step
        resolution of the quaternion's components; the chip's is 2⁻¹⁴.
    """

    mounting: float = np.deg2rad(1.0)
    heading: float = np.deg2rad(2.0)
    heading_wander: float = np.deg2rad(2.0)
    heading_time: float = 60.0
    tilt: float = np.deg2rad(0.8)
    tilt_time: float = 2.0
    white: float = np.deg2rad(0.2)
    latency: float = 0.020
    read_interval: float = 0.004 / 7
    step: float = 2.0**-14

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not (np.isfinite(value) and value >= 0.0):
                raise ErrorModelError(f'{item.name} = {value}, expected 0 or a positive number')
            if item.name in _TIME_CONSTANTS and value == 0.0:
                raise ErrorModelError(f'{item.name} = 0 s, expected a positive number')

    def only(self, *sources: str) -> 'Bno055Errors':
        """The same model with every other source turned off.

        Parameters
        ----------
        sources
            keys of SOURCES; none at all gives a perfect sensor.
        """
        unknown = [name for name in sources if name not in SOURCES]
        if unknown:
            raise ErrorModelError(f'source {unknown[0]!r} is not known, expected one of {", ".join(SOURCES)}')
        off = {field: 0.0 for name, those in SOURCES.items() if name not in sources for field in those}
        return replace(self, **off)

    def times(self, factor: float) -> 'Bno055Errors':
        """The same model with all angles so many times as large; times and resolution stay."""
        return replace(self, **{name: factor * getattr(self, name) for name in _ANGLES})


class Measurement(NamedTuple):
    """What the sensors say, and what was wrong with it.

    Attributes
    ----------
    stamps : (n, n_imu)
        times at which the samples were read, s.
    orientations : (n, n_imu, 4)
        measured q_WS, x y z w, unit norm.
    mountings : (n_imu, 3)
        injected μ, rotation vectors in the link's frame, rad: the true q_LS is exp(μ) ⊗ the nominal one.
    headings : (n, n_imu)
        injected ψ, rad: the true heading error is the nominal one and this.
    tilts : (n, n_imu, 2)
        injected tilt about the world's x and y, rad.
    """

    stamps: FloatArray
    orientations: FloatArray
    mountings: FloatArray
    headings: FloatArray
    tilts: FloatArray


def measure(
    times: FloatArray,
    orientations: FloatArray,
    sweep_times: FloatArray,
    errors: Bno055Errors,
    rng: np.random.Generator,
    mountings: FloatArray | None = None,
    headings: FloatArray | None = None,
) -> Measurement:
    """Measure a motion with BNO055s, sweep by sweep.

    The same generator state draws the same errors, only scaled, whichever sources are turned off.

    Parameters
    ----------
    times : (n_times,)
        s, increasing, fine against the motion.
    orientations : (n_times, n_imu, 4)
        true q_WL, x y z w.
    sweep_times : (n,)
        s, increasing; when the first IMU of each sweep is read.
    errors
        how large the errors are.
    rng
        source of chance.
    mountings : (n_imu, 4)
        nominal q_LS, x y z w; default identity.
    headings : (n_imu,)
        nominal heading errors, rad; default 0.

    Returns
    -------
    The samples. A latency that reaches back before the first time gives the first orientation.

    Raises
    ------
    ErrorModelError
        the sweeps go beyond the motion, or shapes do not fit.
    """
    times, sweep_times = np.asarray(times, dtype=float), np.asarray(sweep_times, dtype=float)
    if orientations.shape[:1] != times.shape or orientations.ndim != 3 or orientations.shape[2] != 4:
        raise ErrorModelError(
            f'orientations of shape {orientations.shape}, expected ({len(times)}, n_imu, 4)'
        )
    n, n_imu = len(sweep_times), orientations.shape[1]
    stamps = sweep_times[:, None] + errors.read_interval * np.arange(n_imu)
    if n == 0 or sweep_times[0] < times[0] or stamps[-1, -1] > times[-1]:
        span = f'{sweep_times[0]:.3f} to {stamps[-1, -1]:.3f} s' if n else 'no sweep'
        raise ErrorModelError(
            f'{span} to measure, but the motion lasts from {times[0]:.3f} to {times[-1]:.3f} s'
        )
    mu = errors.mounting * rng.standard_normal((n_imu, 3))
    psi = errors.heading * rng.standard_normal(n_imu) + errors.heading_wander * gauss_markov(
        sweep_times, errors.heading_time, (n_imu,), rng
    )
    tilt = errors.tilt * gauss_markov(sweep_times, errors.tilt_time, (n_imu, 2), rng)
    disturbance = errors.white * rng.standard_normal((n, n_imu, 3))
    disturbance[..., :2] += tilt
    true = orientations_at(times, orientations, stamps - errors.latency)
    turned = psi if headings is None else psi + headings
    measured = distort(true, mu, turned, disturbance, errors.step, mountings)
    return Measurement(stamps, measured, mu, psi, tilt)


def distort(
    links: FloatArray,
    mounting: FloatArray,
    heading: FloatArray,
    disturbance: FloatArray,
    step: float,
    nominal: FloatArray | None = None,
) -> FloatArray:
    """What a sensor says: q_WS = Rz(ψ) ⊗ exp(δ) ⊗ q_WL ⊗ exp(μ) ⊗ q_LS, rounded.

    Parameters
    ----------
    links : (..., 4)
        true q_WL, x y z w.
    mounting : (..., 3)
        μ, rotation vector in the link's frame, rad.
    heading : (...)
        ψ, rad.
    disturbance : (..., 3)
        δ, tilt and noise, rotation vector in world axes, rad.
    step
        resolution of the components; 0: none.
    nominal : (..., 4)
        q_LS, x y z w; default identity.

    Returns
    -------
    (..., 4), q_WS, x y z w, unit norm (whoever reads a chip normalizes what it rounded).
    """
    turn = np.zeros((*np.shape(heading), 3))
    turn[..., 2] = heading
    true_mounting = multiply(from_rotation_vector(mounting), IDENTITY if nominal is None else nominal)
    world = multiply(from_rotation_vector(turn), from_rotation_vector(disturbance))
    q = multiply(multiply(world, links), true_mounting)
    return normalize(np.round(q / step) * step) if step > 0.0 else q


def gauss_markov(
    times: FloatArray, time_constant: float, shape: tuple[int, ...], rng: np.random.Generator
) -> FloatArray:
    """Stationary first-order Gauss–Markov processes (Ornstein–Uhlenbeck) of unit variance.

    Parameters
    ----------
    times : (n,)
        s, increasing.
    time_constant
        after which the correlation has fallen to 1/e, s.
    shape
        of the processes, which are independent of one another.
    rng
        source of chance.

    Returns
    -------
    (n,) + shape.
    """
    x = rng.standard_normal((len(times), *shape))
    keep = np.exp(-np.diff(times) / time_constant)
    renew = np.sqrt(1.0 - keep * keep)
    for i, (a, b) in enumerate(zip(keep, renew, strict=True), start=1):
        x[i] = a * x[i - 1] + b * x[i]
    return x


def orientations_at(times: FloatArray, orientations: FloatArray, at: FloatArray) -> FloatArray:
    """Orientations of a motion at other times, each body at its own.

    Parameters
    ----------
    times : (n_times,)
        s, increasing, at least two.
    orientations : (n_times, n_bodies, 4)
        x y z w.
    at : (..., n_bodies)
        s; before the first and after the last time the orientation is held.

    Returns
    -------
    (..., n_bodies, 4), x y z w.
    """
    at = np.clip(at, times[0], times[-1])
    i = np.clip(np.searchsorted(times, at, side='right') - 1, 0, len(times) - 2)
    body = np.arange(orientations.shape[1])
    fraction = (at - times[i]) / (times[i + 1] - times[i])
    return slerp(orientations[i, body], orientations[i + 1, body], fraction)
