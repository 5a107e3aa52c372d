"""The skin of the arm, as geometry."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sesa2.shape.arm import Arm
from sesa2.shape.layout import Layout
from sesa2.shape.measured import Measured
from sesa2.shape.models import create_model
from sesa2.viewer.tube import SIDES, tube_faces, tube_vertices

RADIUS = 0.0125
LAYOUT = Layout(Arm(0.66), (0.22, 0.44, 0.66))


def bent(name='pcc_exact', seed=0):
    rng = np.random.default_rng(seed)
    turns = [Rotation.from_rotvec(v) for v in rng.normal(size=(3, 3))]
    q = np.array(
        [turns[0].as_quat(), (turns[0] * turns[1]).as_quat(), (turns[0] * turns[1] * turns[2]).as_quat()]
    )
    model = create_model(name, LAYOUT)
    fit = model.fit(Measured(q))
    return np.concatenate([fit.positions(model.link_ends), fit.orientations(model.link_ends)], axis=1)


@pytest.mark.parametrize('name', ['rigid', 'pcc_exact'])
def test_every_point_is_on_the_skin(name):
    backbone = bent(name)
    rings = tube_vertices(backbone, RADIUS)[:-2].reshape(len(backbone), SIDES, 3)
    np.testing.assert_allclose(rings.mean(axis=1), backbone[:, :3], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(rings - backbone[:, None, :3], axis=-1), RADIUS, rtol=1e-9)


def test_the_mesh_is_closed_and_seen_from_outside():
    backbone = bent()
    vertices, faces = tube_vertices(backbone, RADIUS), tube_faces(len(backbone))
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    there, back = {tuple(e) for e in edges}, {tuple(e[::-1]) for e in edges}
    assert len(there) == len(edges)
    assert there == back  # each edge is shared by two triangles, once in each direction
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = np.einsum('ni,ni->', a, np.cross(b, c)) / 6.0
    polygon = 0.5 * SIDES * np.sin(2.0 * np.pi / SIDES) * RADIUS**2
    assert volume == pytest.approx(polygon * LAYOUT.arm.length, rel=0.02)


def test_a_cage_is_part_of_the_tube():
    whole = {tuple(f) for f in tube_faces(9)}
    bars = {tuple(f) for f in tube_faces(9, cage=True)}
    assert bars < whole


def test_a_truth_with_any_orientation_and_repeated_points_has_a_skin():
    backbone = np.zeros((4, 7))
    backbone[:, 0] = [0.0, 0.1, 0.1, 0.2]  # along x, one point twice
    backbone[:, 6] = 1.0
    along_y = backbone[:, [1, 0, 2, 3, 4, 5, 6]]
    for lying in (backbone, along_y):
        vertices = tube_vertices(lying, RADIUS)
        assert np.isfinite(vertices).all()
        np.testing.assert_allclose(np.linalg.norm(vertices[:SIDES] - lying[0, :3], axis=1), RADIUS, rtol=1e-9)
