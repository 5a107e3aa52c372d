"""Missing IMUs, filled from their neighbours."""

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from sesa2.shape.arm import Arm
from sesa2.shape.layout import Layout
from sesa2.shape.missing import fill_missing
from sesa2.shape.rotations import normalize

LAYOUT = Layout(Arm(0.7), (0.1, 0.15, 0.3, 0.6))


def matrices(q):
    return Rotation.from_quat(q.reshape(-1, 4)).as_matrix()


def test_every_pattern_against_scipys_slerp():
    rng = np.random.default_rng(1)
    base = normalize(rng.normal(size=4))
    for pattern in range(1, 16):
        measured = np.array([pattern >> k & 1 for k in range(4)], dtype=bool)
        q = normalize(rng.normal(size=(4, 4)))
        there = np.concatenate([[True], measured])
        at, known = LAYOUT.stations[there], np.vstack([base, q])[there]
        slerp = Slerp(at, Rotation.from_quat(known))
        expected = slerp(np.minimum(LAYOUT.imu_positions, at[-1])).as_matrix()
        q[~measured] = np.nan  # must not be looked at
        np.testing.assert_allclose(matrices(fill_missing(q, measured, LAYOUT, base)), expected, atol=1e-12)


def test_a_batch_of_mixed_patterns_is_its_members():
    rng = np.random.default_rng(2)
    base, q = normalize(rng.normal(size=(20, 4))), normalize(rng.normal(size=(20, 4, 4)))
    measured = rng.random((20, 4)) < 0.6
    filled = fill_missing(q, measured, LAYOUT, base)
    for i in range(20):
        np.testing.assert_array_equal(filled[i], fill_missing(q[i], measured[i], LAYOUT, base[i]))


def test_nothing_missing_is_the_input_itself():
    q = np.tile([0.0, 0.0, 0.0, 1.0], (4, 1))
    assert fill_missing(q, np.ones(4, bool), LAYOUT, q[0]) is q
