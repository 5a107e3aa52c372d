"""A trial of a configured arm: hand, rod and sensors put together."""

from collections.abc import Callable

import numpy as np

from sesa2.configuration import Configuration
from sesa2.sensing.imu.error_model import Bno055Errors, Measurement, measure
from sesa2.shape.rotations import FloatArray, rotate
from sesa2.twin.hand import hand_path
from sesa2.twin.trial import Trial, TrialError

# Where the hand holds the arm, as a fraction of its length: 480 of 660 mm in the thesis.
HAND_FRACTION = 48.0 / 66.0
SHORTEST_TRIAL = 1.0
_FIRST_SWEEP = 0.1
_TRUTH_EVERY = 2
_TWIST_PERIODS = (6.0, 15.0)


def simulate(
    configuration: Configuration,
    seconds: float,
    seed: int,
    progress: Callable[[float], None] | None = None,
    *,
    errors: Bno055Errors | None = None,
    twist: float = 0.0,
) -> Trial:
    """Simulate a trial: a straight pose, then the three motions of the thesis, drawn from the seed.

    The rod is of the paper's silicone, and as long and thick as the configuration says. About 0.6 s of computing for
    each second, and half a minute at the first use after installation, when numba compiles PyElastica.

    Parameters
    ----------
    configuration
        arm, IMUs (rate: `serial.rate_hz`), markers.
    seconds
        duration of the trial, s, at least 1; the thesis's lasted 250 s.
    seed
        of motion and sensor errors, each on its own, so that other errors leave the motion as it is.
    progress
        called with the fraction done, now and then.
    errors
        how large the sensors' errors are; default: those of a BNO055.
    twist
        amplitude of a slow twist of the arm that the hand applies besides, rad between base and hand.

    Returns
    -------
    The trial.

    Raises
    ------
    TrialError
        PyElastica is not installed, the trial is too short, or the rod's motion became unstable.
    """
    try:
        from sesa2.twin.rod import NODES_EVERY, Rod, simulate_rod
    except ImportError as error:
        raise TrialError(f"the twin needs PyElastica ({error}): pip install 'sesa2[sim]'") from None
    if not seconds >= SHORTEST_TRIAL:
        raise TrialError(f'a trial of {seconds} s, expected at least {SHORTEST_TRIAL} s')
    motion_seed, twist_seed, error_seed = np.random.SeedSequence(seed).spawn(3)
    length, base = configuration.arm.length, configuration.base
    rod = Rod(length, configuration.arm.radius, HAND_FRACTION * length)
    times, path = hand_path(seconds, np.random.default_rng(motion_seed))
    torque = None
    if twist != 0.0:
        wave = _slow_wave(np.random.default_rng(twist_seed))
        torque = lambda t: twist * rod.twisting_stiffness / rod.hand_position * wave(t)  # noqa: E731
    imus, markers = np.array(configuration.imus.positions), np.array(configuration.markers.positions)
    states = simulate_rod(
        rod,
        base,
        seconds,
        (times, rotate(base, rod.hand_position * path)),
        orientations_at=imus,
        points_at=markers,
        torque=torque,
        progress=progress,
    )
    links = states.orientations
    if configuration.imus.base_id:
        links = np.concatenate([links, np.broadcast_to(base, (len(links), 1, 4))], axis=1)
    measurement = measured_sweeps(configuration, states.times, links, errors or Bno055Errors(), error_seed)
    return Trial(
        base=base,
        times=states.times,
        imu_positions=imus,
        orientations=states.orientations,
        sensor_ids=np.array(configuration.imus.all_ids),
        stamps=measurement.stamps,
        measured=measurement.orientations,
        mountings=measurement.mountings,
        headings=measurement.headings,
        truth_times=states.times[::_TRUTH_EVERY],
        marker_names=np.array(configuration.markers.names, dtype=str),
        marker_positions=markers,
        markers=states.points[::_TRUTH_EVERY],
        backbone_times=states.times[::NODES_EVERY],
        backbone_positions=np.linspace(0.0, length, rod.n_elements + 1),
        backbone=states.nodes,
        energies=states.energies,
    )


def measured_sweeps(
    configuration: Configuration,
    times: FloatArray,
    links: FloatArray,
    errors: Bno055Errors,
    seed: np.random.SeedSequence,
) -> Measurement:
    """Sweeps over the IMUs of a motion.

    Parameters
    ----------
    configuration
        mountings, headings and rate of the IMUs.
    times : (n_times,)
        s.
    links : (n_times, n_sensors, 4)
        true q_WL in the order of `imus.all_ids`: that of the base, which is read last, is the last.
    errors
        how large the errors are.
    seed
        of the errors.

    Returns
    -------
    What was measured.
    """
    mountings, headings = configuration.mountings, configuration.headings
    if configuration.imus.base_id:
        mountings = np.vstack([mountings, configuration.base_mounting])
        headings = np.append(headings, 0.0)
    last = times[-1] - errors.read_interval * links.shape[1]
    sweeps = np.arange(_FIRST_SWEEP, last, 1.0 / configuration.serial.rate_hz)
    return measure(times, links, sweeps, errors, np.random.default_rng(seed), mountings, headings)


def _slow_wave(rng: np.random.Generator) -> Callable[[float], float]:
    """Two sines whose sum stays within ±1 and begins at 0 with the straight pose."""
    f, phase = 1.0 / rng.uniform(*_TWIST_PERIODS, 2), rng.uniform(0.0, 2.0 * np.pi, 2)

    def wave(t: float) -> float:
        start = min(t / 5.0, 1.0)
        return float(start * start * np.mean(np.sin(2.0 * np.pi * f * t + phase)))

    return wave
