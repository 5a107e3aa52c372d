"""A trial of an arm that grows: the plant moves by itself, its IMUs and the lengths of its backbones are measured."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sesa2.configuration import Configuration
from sesa2.plant.own_motion import OwnMotion
from sesa2.sensing.imu.error_model import Bno055Errors
from sesa2.shape.rotations import FloatArray, rotate
from sesa2.twin.simulation import SHORTEST_TRIAL, measured_sweeps
from sesa2.twin.trial import Trial, TrialError

_STEP_S = 0.005
_LENGTHS_EVERY = 2
_TRUTH_EVERY = 2
_BACKBONE_EVERY = 20
_NODES = 31


class GrowingTrial(NamedTuple):
    """A trial, and what was measured besides orientations.

    Attributes
    ----------
    trial
        the trial; nothing is known of its energy (NaN).
    length_times : (n,)
        s, 100 Hz.
    lengths : (n, n_backbones)
        what was said of the backbones, in the order of the configuration, m.
    coordinates : (n, 3 m)
        the truth at these times: bend_x, bend_y, rad, and length, m, of each segment.
    """

    trial: Trial
    length_times: FloatArray
    lengths: FloatArray
    coordinates: FloatArray


def simulate_growing(
    configuration: Configuration,
    seconds: float,
    seed: int,
    progress: Callable[[float], None] | None = None,
    *,
    errors: Bno055Errors | None = None,
) -> GrowingTrial:
    """Simulate a trial of the arm of the section `plant`: straight first, then growing, shrinking, bending, circling.

    About 30 ms of computing for each second.

    Parameters
    ----------
    configuration
        arm, segments, backbones, IMUs (rate: `serial.rate_hz`), markers.
    seconds
        duration of the trial, s, at least 1.
    seed
        of the arm, its motion and the sensors' errors, each on its own; that of the section does not count.
    progress
        called with the fraction done, now and then.
    errors
        how large the IMUs' errors are; default: those of a BNO055.

    Returns
    -------
    The trial.

    Raises
    ------
    TrialError
        the trial is too short, or no length is measured.
    """
    if not seconds >= SHORTEST_TRIAL:
        raise TrialError(f'a trial of {seconds} s, expected at least {SHORTEST_TRIAL} s')
    if not configuration.has_lengths:
        raise TrialError('lengths.names is missing, expected an arm whose lengths are measured')
    motion_seed, error_seed = np.random.SeedSequence(seed).spawn(2)
    plant = configuration.create_plant(seed=seed)
    rest = plant.segment_lengths
    longest = configuration.segments.stretch[1] * rest
    motion = OwnMotion(
        plant.home, longest, configuration.segments.bend_max, np.random.default_rng(motion_seed)
    )
    times = _STEP_S * np.arange(int(np.ceil(seconds / _STEP_S)) + 1, dtype=float)
    wanted = motion.coordinates(times).reshape(len(times), -1, 3)
    commands = plant.racks.backbones(wanted[..., 2], wanted[..., :2])
    coordinates = np.empty((len(times), 3 * len(rest)))
    lengths = []
    for k in range(len(times)):
        coordinates[k] = plant.coordinates
        if k % _LENGTHS_EVERY == 0:
            lengths.append(plant.said_lengths)
        if k % 1000 == 0 and progress is not None:
            progress(k / len(times))
        plant.step(commands[k], _STEP_S)
    if progress is not None:
        progress(1.0)
    c = configuration
    imus, markers = np.array(c.imus.positions), np.array(c.markers.positions)
    nodes = np.linspace(0.0, rest.sum(), _NODES)
    links = plant.link_orientations_of(coordinates)
    measurement = measured_sweeps(c, times, links, errors or Bno055Errors(), error_seed)
    truth, backbone = coordinates[::_TRUTH_EVERY], coordinates[::_BACKBONE_EVERY]
    trial = Trial(
        base=c.base,
        times=times,
        imu_positions=imus,
        orientations=links[:, : len(imus)],
        sensor_ids=np.array(c.imus.all_ids),
        stamps=measurement.stamps,
        measured=measurement.orientations,
        mountings=measurement.mountings,
        headings=measurement.headings,
        truth_times=times[::_TRUTH_EVERY],
        marker_names=np.array(c.markers.names, dtype=str),
        marker_positions=markers,
        markers=rotate(c.base, plant.shape(plant.places(markers), truth)[0]),
        backbone_times=times[::_BACKBONE_EVERY],
        backbone_positions=nodes,
        backbone=rotate(c.base, plant.shape(plant.places(nodes), backbone)[0]),
        energies=np.full(len(times), np.nan),
    )
    at = slice(None, None, _LENGTHS_EVERY)
    return GrowingTrial(trial, times[at], np.array(lengths), coordinates[at])
