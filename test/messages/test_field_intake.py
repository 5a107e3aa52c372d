"""Fields out of messages: axes that are not there, numbers that are none, messages that are no whole ones."""

import numpy as np
from magnetic_bag import configuration, field_message

from sesa2.messages.field_intake import FieldIntake

STAMP = 1_700_000_000_123_456_789


def test_axes():
    intake = FieldIntake({1: 'z', 2: 'xyz'})
    data = field_message(STAMP, (1e-4, -2e-4, 3e-4))
    stamp_ns, field = intake.take(1, data)
    assert stamp_ns == STAMP
    np.testing.assert_array_equal(field, (np.nan, np.nan, 3e-4))
    assert intake.take(2, data).field == (1e-4, -2e-4, 3e-4)


def test_what_is_no_number_is_no_field():
    intake = FieldIntake({1: 'z', 2: 'xyz'})
    for value in (np.nan, np.inf, -np.inf):
        assert np.isnan(intake.take(1, field_message(STAMP, (1e-4, 1e-4, value))).field).all()
        assert np.isnan(intake.take(2, field_message(STAMP, (value, 1e-4, 1e-4))).field).all()


def test_damaged_ones_are_counted():
    intake = FieldIntake.of(configuration())
    whole = field_message(STAMP, (0.0, 0.0, 1e-4))
    assert intake.take(3, whole[:40]) is None
    assert intake.take(3, b'') is None
    assert intake.unreadable == {3: 2}
