"""Rounds of samples that are whole and in order, recognised many at once: nearly all of any recording."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sesa2.shape.rotations import FloatArray


class Rounds(NamedTuple):
    """Consecutive rounds, in each of which every IMU has measured once, in the same order.

    Attributes
    ----------
    indices : (m,)
        of the IMUs, in the order in which they measure.
    stamps_ns : (n, m)
        ns.
    orientations : (n, m, 4)
        unit norm.
    """

    indices: np.ndarray
    stamps_ns: np.ndarray
    orientations: FloatArray


def whole_rounds(
    indices: np.ndarray,
    stamps_ns: np.ndarray,
    orientations: FloatArray,
    *,
    imus: Sequence[int],
    timeout_ns: int,
    norm_tolerance: float,
    turn_rate: float,
    turn_slack: float,
) -> Rounds | None:
    """The rounds that the samples begin with, as far as nothing about them needs a second look.

    What is asked here is more than what a sweep needs; who fails is looked at sample by sample. From the second round
    on each is compared with the one before, so the first has to be known to be good.

    Parameters
    ----------
    indices : (n,)
        of the samples' IMUs.
    stamps_ns : (n,)
        ns.
    orientations : (n, 4)
        as measured.
    imus
        the IMUs that a round consists of.
    timeout_ns
        the longest a round and a period may be, ns.
    norm_tolerance, turn_rate : rad/s, turn_slack : rad
        of a measurement that is believed.
    """
    m = len(imus)
    n = len(indices) // m
    if n < 2 or sorted(indices[:m].tolist()) != sorted(imus):
        return None
    order = indices[:m]
    stamps = stamps_ns[: n * m].reshape(n, m)
    q = orientations[: n * m].reshape(n, m, 4)
    x, y, z, w = np.moveaxis(q, -1, 0)
    norm2 = x * x + y * y + z * z + w * w
    with np.errstate(all='ignore'):  # of what is not finite
        scale = 1.0 / np.sqrt(norm2)
        unit = q * scale[..., None]
        good = (indices[: n * m].reshape(n, m) == order).all(axis=1)
        good &= (np.abs(norm2 - 1.0) < 1.9 * norm_tolerance).all(axis=1)
        spans = stamps[:, -1] - stamps[:, 0]
        good &= (np.diff(stamps, axis=1) > 0).all(axis=1)
        good &= spans <= timeout_ns
        periods = np.diff(stamps, axis=0)
        good[1:] &= (stamps[1:, 0] > stamps[:-1, -1]) & (periods <= timeout_ns).all(axis=1)
        good[1:] &= 2 * spans[1:] <= periods.min(axis=1)
        cosines = np.abs((unit[1:] * unit[:-1]).sum(axis=-1))
        turns = 2.0 * np.arccos(np.minimum(cosines, 1.0))
        good[1:] &= (turns < 0.9 * (turn_slack + turn_rate * 1e-9 * periods)).all(axis=1)
    n_good = n if good.all() else int(np.argmin(good))
    return Rounds(order, stamps[:n_good], unit[:n_good]) if n_good else None
