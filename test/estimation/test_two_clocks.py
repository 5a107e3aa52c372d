"""Sweeps of IMUs on two boards, each with a clock of its own."""

import numpy as np
import pytest

from sesa2.estimation.sweeps import SweepAssembler

MS = 1_000_000


def samples(drift, seconds=30):
    """(time of arrival, IMU, stamp), ns, of two boards at 100 Hz whose eight samples a sweep arrive together."""
    heard = []
    for board, period in enumerate((10 * MS, 10 * MS * (1 + drift))):
        for k in range(102 * seconds):
            start = board * 4.3 * MS + k * period
            heard += [
                (int(start + 6.1 * MS), 8 * board + channel, int(start + channel * 525_000))
                for channel in range(8)
            ]
    return sorted(sample for sample in heard if sample[0] < seconds * 1000 * MS)


@pytest.mark.parametrize('interpolate', [False, True])
@pytest.mark.parametrize('drift', [0.0, 0.003, -0.003])
def test_boards_whose_clocks_drift_apart_give_whole_sweeps(drift, interpolate):
    """As ceramic resonators do: every three seconds one board has a sweep more than the other."""
    assembler = SweepAssembler([True] * 16, interpolate=interpolate)
    sweeps, delays_ns = [], []
    for arrival_ns, index, stamp_ns in samples(drift):
        for sweep in assembler.add(index, stamp_ns, 0.0, 0.0, 0.0, 1.0):
            sweeps.append(sweep)
            delays_ns.append(arrival_ns - sweep.stamp_ns)
    assert all(sweep.measured.all() for sweep in sweeps[1:])
    assert len(sweeps) > 2980 * min(1.0, 1.0 - drift)
    assert max(delays_ns) < 20 * MS
    assert 0 < np.diff([sweep.stamp_ns for sweep in sweeps]).max() < 20 * MS
