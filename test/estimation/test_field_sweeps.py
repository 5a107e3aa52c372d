"""Sweeps of magnetometers: whole, interpolated, with one that is silent, and with a base that has to be heard."""

import numpy as np
import pytest

from sesa2.estimation.field_sweeps import NO_FIELD, FieldSweepAssembler
from sesa2.estimation.sweeps import NO_BASE

MS = 1_000_000
NAN = float('nan')


def field(t_ms, index):
    return (NAN, NAN, 1e-4 * (index + 1) + 1e-6 * t_ms)


def fed(assembler, times, *, without=()):
    sweeps = []
    for t in times:
        for index in range(3):
            at = t + index
            if (t, index) not in without:
                sweeps += assembler.take(index, at * MS, field(at, index))
    return sweeps


def test_whole_sweeps():
    sweeps = fed(FieldSweepAssembler([True] * 3), [0, 10, 20])
    assert [s.stamp_ns for s in sweeps] == [2 * MS, 12 * MS, 22 * MS]
    for t, sweep in zip((0, 10, 20), sweeps, strict=True):
        np.testing.assert_array_equal(sweep.fields, [field(t + i, i) for i in range(3)])
        assert sweep.orientations.shape == (0, 4)
        assert sweep.measured.all()


def test_interpolated_to_the_first():
    sweeps = fed(FieldSweepAssembler([True] * 3, interpolate=True), [0, 10, 20])
    assert [s.stamp_ns for s in sweeps] == [0, 10 * MS, 20 * MS]
    for t, sweep in zip((10, 20), sweeps[1:], strict=True):
        np.testing.assert_allclose(sweep.fields[:, 2], [field(t, i)[2] for i in range(3)], atol=1e-12)


def test_one_that_is_not_used_or_silent_is_nan():
    [sweep] = fed(FieldSweepAssembler([True, False, True]), [0])
    assert sweep.measured.tolist() == [True, False, True]
    assert np.isnan(sweep.fields[1]).all()
    times = range(0, 200, 10)
    assembler = FieldSweepAssembler([True] * 3)
    sweeps = fed(assembler, times, without={(t, 1) for t in times if t >= 50}) + assembler.flush()
    assert len(sweeps) == len(times)
    assert [s.measured[1] for s in sweeps] == [t < 50 for t in times]
    assert np.isnan(sweeps[-1].fields[1]).all()


def test_a_field_of_no_number_is_counted_and_not_waited_for():
    assembler = FieldSweepAssembler([True] * 3)
    assembler.take(0, 0, field(0, 0))
    assembler.take(1, MS, (NAN, NAN, NAN))
    assembler.take(2, 2 * MS, field(2, 2))
    [sweep] = assembler.flush()
    assert assembler.dropped == {NO_FIELD: 1}
    assert sweep.measured.tolist() == [True, False, True]


@pytest.mark.parametrize('q', [(0.0, 0.0, 0.0, 0.0), (NAN, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.2)])
def test_the_base_is_heard_before_there_is_a_sweep(q):
    assembler = FieldSweepAssembler([True] * 3, wants_base=True)
    assembler.hear_base(q)
    assert fed(assembler, [0]) == []
    assert assembler.dropped == {NO_BASE: 3}
    assembler.hear_base((0.0, 0.6, 0.0, 0.81))
    [sweep] = fed(assembler, [10])
    assert np.linalg.norm(sweep.base) == pytest.approx(1.0, abs=1e-12)
