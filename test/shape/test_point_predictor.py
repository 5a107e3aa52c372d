"""Markers as readings, against scipy's arcs and differences."""

import numpy as np
from paper_arm import PaperArm
from scipy.spatial.transform import Rotation

from sesa2.shape.coordinate_fit import CoordinateFit
from sesa2.shape.point_predictor import PointPredictor

S = np.array([0.11, 0.2, 0.33])


def test_positions_and_their_derivatives():
    arm, rng = PaperArm(3), np.random.default_rng(0)
    points = PointPredictor(arm.limits, ('a', 'b', 'c'), S, 1e-4)
    q, base = arm.limits.draw(20, rng), Rotation.random(20, random_state=1)
    found = points.predict(q, base.as_quat())
    for k, s in enumerate(S):
        expected = base.apply(arm._pose(q, s)[0])
        np.testing.assert_allclose(found.readings[:, 3 * k : 3 * k + 3], expected, atol=1e-12)
    for i in range(9):
        step = 1e-6 * np.eye(9)[i]
        there, back = (points.predict(q + sign * step, base.as_quat()).readings for sign in (1, -1))
        np.testing.assert_allclose(found.jacobian[..., i], (there - back) / 2e-6, atol=1e-8)


def test_a_marker_at_the_end_of_each_segment_tells_the_shape():
    arm, rng = PaperArm(3), np.random.default_rng(1)
    points = PointPredictor(arm.limits, ('a', 'b', 'c'), [0.11, 0.22, 0.33], 1e-5)
    q = arm.limits.draw(50, rng)
    seen = np.stack([arm._pose(q, s)[0] for s in (0.11, 0.22, 0.33)], axis=1)
    found = CoordinateFit(points).fit(points.readings_of(seen))
    assert found.converged.all()
    np.testing.assert_allclose(found.coordinates, q, atol=1e-5)
