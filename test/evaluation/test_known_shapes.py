"""Truths in the frame of the clamp, poses, and markers that do not do."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.bags.magnetometer_log import MagnetometerLog
from sesa2.configuration import files
from sesa2.errors import Sesa2Error
from sesa2.evaluation.known_shapes import in_clamp, shapes_of_truth
from sesa2.evaluation.trajectory import Trajectory

TURN = Rotation.from_rotvec([0.3, -1.1, 0.4])


def turned(output_frame):
    c = files.load_configuration('magnetic_3')
    return replace(
        c, arm=replace(c.arm, base_orientation=tuple(TURN.as_quat().tolist()), output_frame=output_frame)
    )


@pytest.mark.parametrize(
    ('output_frame', 'frame', 'turns'),
    [('base', '', False), ('world', '', True), ('base', 'world', True), ('world', 'base_link', False)],
)
def test_a_truth_in_the_world_is_turned_with_the_base(output_frame, frame, turns):
    p = np.random.default_rng(0).normal(size=(3, 1, 3))
    seen = TURN.apply(p[:, 0])[:, None] if turns else p
    found = in_clamp(Trajectory(np.arange(3.0), seen, ('tip',)), frame, turned(output_frame))
    np.testing.assert_allclose(found.positions, p, atol=1e-12)


def test_a_truth_in_another_frame():
    truth = Trajectory(np.arange(2.0), np.zeros((2, 1, 3)), ('tip',))
    with pytest.raises(Sesa2Error, match='the truth is in frame mocap, expected base_link or world'):
        in_clamp(truth, 'mocap', turned('base'))


def recorded(c, n=200):
    """Readings of motion, and the markers of it."""
    predictor = c.create_model('magnetic').predictor
    limits, times = predictor.limits, np.arange(n) / 40.0
    q = np.tile(limits.kinematics.rest, (n, 1))
    q[:, ::3] += 0.5 * np.sin(times[:, None] * [1.0, 1.3, 1.7])
    q[:, 1::3] += 0.5 * np.sin(times[:, None] * [1.1, 0.7, 1.9])
    u = predictor.predict(q).readings
    ids = c.magnetometers.ids
    fields = {i: np.column_stack([np.full((n, 2), np.nan), u[:, k]]) for k, i in enumerate(ids)}
    log = MagnetometerLog(dict.fromkeys(ids, times), fields, ())
    positions = limits.kinematics.backbone(q).positions(np.array(c.markers.positions))
    return predictor, log, Trajectory(times, positions, c.markers.names), q


def test_coordinates_of_markers():
    c = files.load_configuration('magnetic_3')
    predictor, log, truth, q = recorded(c)
    shapes = shapes_of_truth(log, c, predictor, truth, 1e-4, 0.0)
    nearest = np.abs(shapes.coordinates[:, None] - q).max(axis=-1).argmin(axis=1)
    np.testing.assert_allclose(shapes.coordinates, q[nearest], atol=1e-4)
    np.testing.assert_allclose(shapes.readings, predictor.predict(shapes.coordinates).readings, atol=1e-6)
    assert len(shapes.coordinates) > 20
    assert (shapes.coordinate_errors[:, 0] > 1e-4).all()


def test_markers_that_do_not_tell():
    c = files.load_configuration('magnetic_3')
    predictor, log, truth, _ = recorded(c)
    with pytest.raises(Sesa2Error, match=r'the markers tip do not tell segment_1_length, segment_2'):
        shapes_of_truth(log, c, predictor, truth.select(('tip',)), 1e-3, 0.0)


def test_markers_in_another_frame():
    c = files.load_configuration('magnetic_3')
    predictor, log, truth, _ = recorded(c)
    away = Trajectory(truth.times, truth.positions + np.array([0.1, 0.0, 0.3]), truth.names)
    with pytest.raises(Sesa2Error, match='positions in the frame of the clamp'):
        shapes_of_truth(log, c, predictor, away, 1e-4, 0.0)
