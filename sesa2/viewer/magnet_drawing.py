"""Magnets and magnetometers in the scene: rings and discs on the backbone, small boxes with arrows around it."""

import numpy as np
import trimesh
import viser

from sesa2.configuration import Configuration
from sesa2.messages.colours import Colour
from sesa2.messages.topic_names import magnetometer_name
from sesa2.shape.model import MODELS
from sesa2.shape.rotations import FloatArray
from sesa2.viewer.live import Live
from sesa2.viewer.magnet_poses import UNUSED, MagnetPoses, magnetometer_colour

_NORTH: Colour = (200, 40, 30)
_SOUTH: Colour = (30, 60, 190)
# Turns by which an arrow along z points along x, y and z.
_TURNS = {
    'x': trimesh.transformations.rotation_matrix(0.5 * np.pi, [0.0, 1.0, 0.0]),
    'y': trimesh.transformations.rotation_matrix(-0.5 * np.pi, [1.0, 0.0, 0.0]),
    'z': np.eye(4),
}


class MagnetDrawing:
    """Of all that are alike there is one node of the scene; they move with the model that magnetometers feed.

    Parameters
    ----------
    scene
        that has the node `/arm`.
    c
        the arm; without magnetometers, or without such a model, nothing is drawn.
    link_ends
        of each model, m.
    """

    def __init__(self, scene: viser.SceneApi, c: Configuration, link_ends: dict[str, FloatArray]):
        self._model = next(
            (name for name in c.models if c.magnetometers.ids and 'fields' in MODELS[name].needs), None
        )
        self._magnets: list[tuple[np.ndarray, viser.BatchedMeshHandle]] = []
        self._magnetometers: list[tuple[np.ndarray, viser.BatchedMeshHandle]] = []
        if self._model is None:
            return
        self._ids, self._masked = c.magnetometers.ids, c.magnetometers.masked
        self._n_ends = len(link_ends[self._model])
        self._poses = MagnetPoses(c, link_ends[self._model])
        segment_ends = c.layout.segment_ends
        rings = [
            (m.inner_diameter, m.outer_diameter, m.height, m.remanence > 0.0)
            for m in c.magnets.places(segment_ends).magnets
        ]
        for k, (ring, places) in enumerate(_alike(rings).items()):
            for pole, mesh in zip(('north', 'south'), _ring_halves(*ring), strict=True):
                colour = _NORTH if pole == 'north' else _SOUTH
                node = _add(scene, f'/arm/magnets_{k}_{pole}', mesh, len(places), colour)
                self._magnets.append((places, node))
        axes = c.magnetometers.axes * (len(self._ids) if len(c.magnetometers.axes) == 1 else 1)
        for of, places in _alike(axes).items():
            mesh = _box_with_arrows(of, c.arm.radius)
            self._magnetometers.append(
                (places, _add(scene, f'/arm/magnetometers_{of}', mesh, len(places), UNUSED))
            )

    @property
    def drawn(self) -> bool:
        """Whether there is something within the arm that is to be seen."""
        return self._model is not None

    def draw(self, live: Live) -> None:
        """Move them to where they are now, and colour the magnetometers as the estimator speaks of them."""
        backbone = live.backbones.get(self._model) if self._model else None
        if backbone is None or len(backbone) != self._n_ends:  # an estimator with another configuration
            return
        for poses, nodes in (
            (self._poses.magnets(backbone), self._magnets),
            (self._poses.magnetometers(backbone), self._magnetometers),
        ):
            for places, node in nodes:
                node.batched_positions = poses[places, :3].astype(np.float32)
                node.batched_wxyzs = poses[places][:, [6, 3, 4, 5]].astype(np.float32)
                if not node.visible:
                    node.visible = True
        said = live.heard('estimator')
        colours = np.array(
            [magnetometer_colour(said.get(magnetometer_name(i)), i in self._masked) for i in self._ids],
            np.uint8,
        )
        for places, node in self._magnetometers:
            if not np.array_equal(node.batched_colors, colours[places]):
                node.batched_colors = colours[places]


def _alike(kinds: list | tuple) -> dict:
    """Indices of each kind, by kind."""
    return {kind: np.array([i for i, of in enumerate(kinds) if of == kind]) for kind in dict.fromkeys(kinds)}


def _add(
    scene: viser.SceneApi, name: str, mesh: trimesh.Trimesh, n: int, colour: Colour
) -> viser.BatchedMeshHandle:
    """Hidden until it is known where they are."""
    return scene.add_batched_meshes_simple(
        name,
        mesh.vertices,
        mesh.faces,
        np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        np.zeros((n, 3)),
        batched_colors=np.tile(np.array(colour, np.uint8), (n, 1)),
        lod='off',
        flat_shading=True,
        visible=False,
    )


def _ring_halves(inner: float, outer: float, height: float, to_tip: bool) -> list[trimesh.Trimesh]:
    """North and south half of a magnet about the origin, magnetised along z or against it; sizes in m."""
    halves = []
    for side in (1.0, -1.0) if to_tip else (-1.0, 1.0):
        half = (
            trimesh.creation.annulus(0.5 * inner, 0.5 * outer, 0.5 * height, sections=32)
            if inner
            else trimesh.creation.cylinder(0.5 * outer, 0.5 * height, sections=32)
        )
        half.apply_translation([0.0, 0.0, 0.25 * side * height])
        halves.append(half)
    return halves


def _box_with_arrows(axes: str, radius: float) -> trimesh.Trimesh:
    """A chip about the origin, flat along z, and an arrow along each axis that it measures along.

    Its size suits the arm's radius, m.
    """
    parts = [trimesh.creation.box((0.3 * radius, 0.3 * radius, 0.12 * radius))]
    for axis in axes:
        shaft = trimesh.creation.cylinder(0.04 * radius, 0.4 * radius, sections=12)
        shaft.apply_translation([0.0, 0.0, 0.2 * radius])
        head = trimesh.creation.cone(0.1 * radius, 0.2 * radius, sections=12)
        head.apply_translation([0.0, 0.0, 0.4 * radius])
        for part in (shaft, head):
            part.apply_transform(_TURNS[axis])
            parts.append(part)
    return trimesh.Trimesh(*trimesh.util.append_faces([p.vertices for p in parts], [p.faces for p in parts]))
