"""Many samples at once give to the last bit what they give one by one, whatever is wrong with them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sesa2.estimation.rounds import whole_rounds
from sesa2.estimation.sweeps import SweepAssembler
from sesa2.shape.rotations import from_rotation_vector, multiply, normalize

MS = 1_000_000
T0 = 1_700_000_000_000 * MS


def recording(rng, n, n_imu, *, order=None, period=10 * MS, scan=4 * MS):
    """Healthy samples: indices, stamps, orientations, arrivals."""
    order = rng.permutation(n_imu) if order is None else order
    stamps = T0 + period * np.arange(n)[:, None] + (scan * np.arange(n_imu) // n_imu)
    q = normalize(rng.normal(size=(1, n_imu, 4)))
    turns = from_rotation_vector(np.cumsum(rng.normal(size=(n, n_imu, 3)) * 0.01, axis=0))
    measured = multiply(turns, q) * (1.0 + rng.normal(size=(n, n_imu, 1)) * 1e-4)
    indices = np.tile(order, n)
    return indices, stamps.ravel(), measured.reshape(-1, 4), stamps.ravel() + rng.integers(0, MS, n * n_imu)


def spoiled(rng, columns, faults):
    """With faults of all kinds, at places of chance."""
    indices, stamps, q, arrivals = (column.copy() for column in columns)
    keep = np.ones(len(indices), dtype=bool)
    for kind in faults:
        k = int(rng.integers(len(indices)))
        match kind:
            case 'lost':
                keep[k] = False
            case 'silent':
                keep[k : k + int(rng.integers(400))] = False
            case 'one silent':
                until = k + int(rng.integers(2000))
                keep[k:until] &= indices[k:until] != indices[k]
            case 'zero':
                q[k] = 0.0
            case 'nan':
                q[k, 1] = np.nan
            case 'norm':
                q[k] *= 1.05
            case 'turned':
                q[k] = q[k][[1, 0, 3, 2]]
            case 'swapped':
                for column in (indices, stamps, q):
                    column[[k - 1, k]] = column[[k, k - 1]]
            case 'repeated':
                stamps[k] = stamps[k - 1]
            case 'decades back':
                stamps[k : k + 30] -= 44 * 365 * 86_400 * 10**9
            case 'ahead':
                stamps[k] += 1000 * 10**9
            case 'looped':
                stamps[k:] -= 5 * 10**9
            case 'pause':
                stamps[k:] += 60 * 10**9
                arrivals[k:] += 60 * 10**9
            case 'burst':
                part = slice(k, k + 300)
                by_topic = np.argsort(indices[part], kind='stable')
                for column in (indices, stamps, q):
                    column[part] = column[part][by_topic]
    return tuple(column[keep] for column in (indices, stamps, q, arrivals))


FAULTS = [
    'lost', 'silent', 'one silent', 'zero', 'nan', 'norm', 'turned', 'swapped', 'repeated', 'decades back', 'ahead',
    'looped', 'pause', 'burst',
]  # fmt: skip


def one_by_one(assembler, columns):
    sweeps = []
    for i, t, q, now in zip(*(column.tolist() for column in columns), strict=True):
        sweeps += assembler.add(i, t, *q, now)
    return sweeps + assembler.flush()


def many(assembler, columns, block):
    sweeps, at_once = [], 0
    for begin in range(0, len(columns[0]), block):
        part = [column[begin : begin + block] for column in columns]
        at = 0
        while at < len(part[0]):
            got, taken = assembler.add_many(*(column[at:] for column in part))
            sweeps += got
            at += taken
            at_once += taken
            for i, t, q, now in zip(*(column[at : at + 16].tolist() for column in part), strict=True):
                sweeps += assembler.add(i, t, *q, now)
            at += 16
    return sweeps + assembler.flush(), at_once


def assert_same(expected, got, assemblers):
    assert [s.stamp_ns for s in got] == [s.stamp_ns for s in expected]
    for one, other in zip(expected, got, strict=True):
        np.testing.assert_array_equal(other.orientations, one.orientations)
        np.testing.assert_array_equal(other.measured, one.measured)
        np.testing.assert_array_equal(other.base, one.base)
    slow, fast = assemblers
    assert fast.dropped == slow.dropped
    assert (fast.resets, fast.alive, fast.newest_ns) == (slow.resets, slow.alive, slow.newest_ns)
    assert fast.arrivals.lags == slow.arrivals.lags


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    n_imu=st.integers(1, 5),
    has_base=st.booleans(),
    latency=st.sampled_from([0.0, 0.02]),
    scan=st.sampled_from([2, 4, 9]),
    faults=st.lists(st.sampled_from(FAULTS), max_size=5),
    block=st.sampled_from([37, 512, 10_000]),
)
def test_many_at_once_are_the_same_as_one_by_one(seed, n_imu, has_base, latency, scan, faults, block):
    rng = np.random.default_rng(seed)
    columns = spoiled(rng, recording(rng, 1200, n_imu + has_base, scan=scan * MS), faults)
    options = {'has_base': has_base, 'latency': latency, 'patience': 5.0}
    slow, fast = (SweepAssembler([True] * n_imu, **options) for _ in range(2))
    expected = one_by_one(slow, columns)
    got, _ = many(fast, columns, block)
    assert_same(expected, got, (slow, fast))


def test_of_a_healthy_recording_nearly_all_are_taken_at_once():
    rng = np.random.default_rng(0)
    columns = recording(rng, 3000, 8)
    sweeps, at_once = many(SweepAssembler([True] * 8, patience=5.0), columns, 2048)
    assert len(sweeps) == 3000
    assert at_once > 0.97 * 24_000


def test_lags_are_told_across_the_windows_too():
    rng = np.random.default_rng(1)
    indices, stamps, q, arrivals = recording(rng, 6000, 4, order=np.arange(4))
    stamps = stamps - 150 * MS * (indices == 2)
    order = np.argsort(arrivals, kind='stable')
    columns = indices[order], stamps[order], q[order], arrivals[order]
    slow, fast = (SweepAssembler([True] * 4, patience=5.0) for _ in range(2))
    assert_same(one_by_one(slow, columns), many(fast, columns, 2048)[0], (slow, fast))
    assert fast.arrivals.lags == {2: pytest.approx(0.15, abs=1e-3)}


def test_rounds_end_where_something_needs_a_second_look():
    rng = np.random.default_rng(2)
    indices, stamps, q, _ = recording(rng, 50, 3)
    limits = {'timeout_ns': 50 * MS, 'norm_tolerance': 0.02, 'turn_rate': 35.0, 'turn_slack': 0.5}
    rounds = whole_rounds(indices, stamps, q, imus=[0, 1, 2], **limits)
    assert rounds.stamps_ns.shape == (50, 3)
    np.testing.assert_allclose(np.linalg.norm(rounds.orientations, axis=-1), 1.0, atol=1e-15)
    q[3 * 20 + 1] = 0.0
    assert len(whole_rounds(indices, stamps, q, imus=[0, 1, 2], **limits).stamps_ns) == 20
    assert whole_rounds(indices, stamps, q, imus=[0, 1, 3], **limits) is None
    assert whole_rounds(indices[:5], stamps[:5], q[:5], imus=[0, 1, 2], **limits) is None
    slow_scan = recording(rng, 50, 3, scan=9 * MS)[:3]  # a round that takes most of its period
    assert len(whole_rounds(*slow_scan, imus=[0, 1, 2], **limits).stamps_ns) == 1


def test_an_imu_that_has_died_does_not_slow_the_rest():
    rng = np.random.default_rng(3)
    columns = recording(rng, 3000, 4)
    there = (columns[0] != 2) | (columns[1] < T0 + 500 * MS)
    columns = tuple(column[there] for column in columns)
    slow, fast = (SweepAssembler([True] * 4, patience=5.0) for _ in range(2))
    sweeps, at_once = many(fast, columns, 2048)
    assert_same(one_by_one(slow, columns), sweeps, (slow, fast))
    assert len(sweeps) == 3000
    assert at_once > 6000
