"""The arm in 3D: a tube for each model, markers, IMUs, magnets, the base, and the truth as a ghost."""

from typing import Any

import numpy as np
import trimesh.creation
import viser

from sesa2.configuration import Configuration
from sesa2.messages.colours import Colour, model_colours
from sesa2.sensing.imu.mounting import Mounting
from sesa2.shape.rotations import FloatArray, conjugate, multiply, rotate
from sesa2.viewer.live import Live
from sesa2.viewer.magnet_drawing import MagnetDrawing
from sesa2.viewer.tube import SIDES, tube_faces, tube_vertices

_MARKER: Colour = (25, 175, 60)
_GREY: Colour = (150, 150, 150)
_GHOST: Colour = (70, 70, 90)


class Scene:
    """Draws an arm; each kind of thing is one node of the scene, since viser's cost is per node.

    Parameters
    ----------
    server
        the page's.
    imus
        whether the IMUs' axes are drawn.
    """

    def __init__(self, server: viser.ViserServer, imus: bool = True):
        self._server = server
        self._with_imus = imus
        self._scene = server.scene
        self._configuration: Configuration | None = None
        self.shown: dict[str, bool] = {}
        self._scene.set_background_image(np.full((2, 2, 3), 248, np.uint8))

    def configure(self, c: Configuration) -> None:
        """Draw another arm from now on.

        Parameters
        ----------
        c
            the arm, its markers, IMUs and models.
        """
        before, self._configuration = self._configuration, c
        self.shown = {name: self.shown.get(name, True) for name in c.models}
        if not any(self.shown.values()):  # somebody hid the only model that is left
            self.shown = dict.fromkeys(c.models, True)
        self._tubes: dict[str, viser.MeshHandle] = {}
        self._drawn: set[str] = set()
        self._ghost: viser.MeshHandle | None = None
        self._markers: viser.BatchedMeshHandle | None = None
        self._truth_markers: viser.BatchedMeshHandle | None = None
        self._labels: list[viser.LabelHandle] = []
        self._colours = model_colours(c.models)
        self._link_ends = {name: c.create_model(name).link_ends for name in c.models}
        self._mounting = Mounting(np.tile([0.0, 0.0, 0.0, 1.0], (len(c.imus.ids), 1)), c.headings)
        self._base_mounting = Mounting(c.base_mounting[None], np.zeros(1))
        with self._server.atomic():
            if before is not None:
                self._scene.remove_by_name('/arm')
            self._add_surroundings(c)
            self._magnets = MagnetDrawing(self._scene, c, self._link_ends)
            for name in c.models:
                self._add_tube(name, len(self._link_ends[name]), c.arm.radius)
        if before is None or before.arm != c.arm:
            self._look_at(c)

    def draw(self, live: Live) -> None:
        """Draw what is known now."""
        c = self._configuration
        if c is None:
            return
        with self._server.atomic():
            base = self._base(c, live)
            self._base_axes.wxyz = _wxyz(base)
            self._arm.wxyz = _wxyz(base) if c.arm.output_frame == 'base' else (1.0, 0.0, 0.0, 0.0)
            for name, backbone in live.backbones.items():
                if name in self._tubes and len(backbone) > 1:
                    self._draw_tube(name, backbone, c.arm.radius)
            self._draw_markers(c, live)
            if self._with_imus and c.imus.ids:
                self._draw_imus(c, live, base)
            self._magnets.draw(live)
            self._draw_truth(c, live)
        self._server.flush()

    def show(self, model: str, visible: bool) -> None:
        """Show or hide a model's tube and markers."""
        self.shown[model] = visible
        for name, tube in self._tubes.items():
            tube.visible = self.shown[name] and name in self._drawn
            _, tube.opacity, cage = self._nesting(name)
            tube.faces = tube_faces(self._points(name), cage)

    def _points(self, model: str) -> int:
        return (len(self._tubes[model].vertices) - 2) // SIDES

    def _nesting(self, model: str) -> tuple[float, float | None, bool]:
        """Part of the arm's radius, opacity, and whether as a cage: models lie in one another, and all are to be seen.

        The innermost is solid, the one about it translucent; browsers do not sort two translucent ones, so those
        further out are cages. About magnets all are.
        """
        nested = [name for name, shown in self.shown.items() if shown]
        if model not in nested:
            return 1.0, None, False
        depth, last = nested.index(model), len(nested) - 1
        part = 1.0 - 0.6 * depth / max(last, 1)
        if self._magnets.drawn:
            return part, None, True
        return part, 0.4 if depth == last - 1 else None, depth < last - 1

    def _add_surroundings(self, c: Configuration) -> None:
        r, n = c.arm.radius, len(c.imus.ids)
        cell = 10.0 ** np.floor(np.log10(c.arm.length))
        self._scene.add_grid(
            '/grid',
            width=4.0 * c.arm.length,
            height=4.0 * c.arm.length,
            cell_size=cell,
            section_size=cell,
            section_color=(205, 205, 212),
            cell_color=(205, 205, 212),
            shadow_opacity=0.15,
        )
        self._arm = self._scene.add_frame('/arm', show_axes=False)
        self._base_axes = self._scene.add_frame(
            '/base', axes_length=0.12 * c.arm.length, axes_radius=0.25 * r, origin_radius=0.5 * r
        )
        self._scene.add_cylinder(
            '/base/clamp',
            radius=2.2 * r,
            height=1.2 * r,
            color=(90, 90, 100),
            position=(0.0, 0.0, -0.6 * r),
        )
        zeros, unit = np.zeros((n, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
        self._imus = self._scene.add_batched_axes(
            '/arm/imus', unit, zeros, np.zeros(n), axes_length=2.6 * r, axes_radius=0.14 * r
        )
        grey = trimesh.creation.axis(origin_size=0.28 * r, axis_radius=0.14 * r, axis_length=2.6 * r)
        self._missing = self._scene.add_batched_meshes_simple(
            '/arm/missing_imus',
            grey.vertices,
            grey.faces,
            unit,
            zeros,
            batched_scales=np.zeros(n),
            batched_colors=_GREY,
            lod='off',
        )

    def _look_at(self, c: Configuration) -> None:
        """The whole arm in view however it bends: it stays within its length of the clamp."""
        along = rotate(c.base, [0.0, 0.0, 1.0])
        length = c.arm.length * (c.segments.stretch[1] if c.has_lengths else 1.0)
        target = 0.5 * length * along
        aside = np.array([1.0, -1.0, 0.0]) if abs(along[2]) > 0.7 else np.array([-along[1], along[0], 0.0])
        position = target + length * (1.3 * aside / np.linalg.norm(aside) + [0.0, 0.0, 0.35])
        cameras: list[Any] = [
            self._server.initial_camera,
            *(k.camera for k in self._server.get_clients().values()),
        ]
        for camera in cameras:
            camera.position = position
            camera.look_at = target

    def _base(self, c: Configuration, live: Live) -> FloatArray:
        """q_WB, measured where an IMU sits on the base."""
        measured = live.sensors.get(c.imus.base_id) if c.imus.base_id else None
        return c.base if measured is None else self._base_mounting.link_orientations(measured[None, :])[0]

    def _add_tube(self, name: str, n: int, radius: float) -> None:
        """A tube of n points, hidden until it is known how it lies."""
        _, opacity, cage = self._nesting(name)
        straight = np.zeros((n, 7))
        straight[:, 2], straight[:, 6] = np.linspace(0.0, radius, n), 1.0
        self._tubes[name] = self._scene.add_mesh_simple(
            f'/arm/{name}',
            tube_vertices(straight, radius),
            tube_faces(n, cage),
            color=self._colours[name],
            side='double',
            opacity=opacity,
            visible=False,
        )

    def _draw_tube(self, name: str, backbone: FloatArray, radius: float) -> None:
        vertices = tube_vertices(backbone, self._nesting(name)[0] * radius)
        if len(self._tubes[name].vertices) != len(vertices):  # an estimator with another configuration
            self._add_tube(name, len(backbone), radius)
            self._drawn.discard(name)
        self._tubes[name].vertices = vertices.astype(np.float32)
        if name not in self._drawn:
            self._drawn.add(name)
            self._tubes[name].visible = self.shown[name]

    def _draw_markers(self, c: Configuration, live: Live) -> None:
        shown = [live.markers[name] for name in c.models if self.shown[name] and name in live.markers]
        markers = np.concatenate([np.empty((0, 7)), *shown])
        self._markers = self._draw_balls(
            self._markers, '/arm/markers', markers[:, :3], self._about(c, 0.45), _MARKER, None
        )
        named = shown[0] if shown else markers
        if len(named) != len(c.markers.names):
            return
        if len(self._labels) != len(named):
            self._labels = [
                self._scene.add_label(f'/arm/marker_name_{i}', name, anchor='center-left')
                for i, name in enumerate(c.markers.names)
            ]
        for label, position in zip(self._labels, named[:, :3], strict=True):
            label.position = position

    def _draw_balls(
        self,
        balls: viser.BatchedMeshHandle | None,
        name: str,
        positions: FloatArray,
        radius: float,
        colour: Colour,
        opacity: float | None,
    ) -> viser.BatchedMeshHandle | None:
        if balls is not None and len(balls.batched_positions) == len(positions):
            balls.batched_positions = positions.astype(np.float32)
            return balls
        if balls is not None:
            balls.remove()
        if not len(positions):
            return None
        ball = trimesh.creation.icosphere(subdivisions=2, radius=radius)
        return self._scene.add_batched_meshes_simple(
            name,
            ball.vertices,
            ball.faces,
            np.tile([1.0, 0.0, 0.0, 0.0], (len(positions), 1)),
            positions,
            batched_colors=colour,
            opacity=opacity,
            lod='off',
        )

    def _about(self, c: Configuration, more: float) -> float:
        """Radius of a ball about the arm, by more of the arm's; it hides neither a thick arm nor what is in one."""
        r = c.arm.radius
        return 0.7 * more * r if self._magnets.drawn else r + min(more * r, 0.1 * more * c.arm.length)

    def _draw_imus(self, c: Configuration, live: Live, base: FloatArray) -> None:
        """Each sensor's own axes where it sits; grey and as its link where it is missing."""
        backbone = next((live.backbones[name] for name in c.models if name in live.backbones), None)
        model = next((name for name in c.models if name in live.backbones), None)
        if backbone is None or model is None or len(backbone) != len(self._link_ends[model]):
            return
        ends, at = self._link_ends[model], np.array(c.imus.positions)
        positions = np.stack([np.interp(at, ends, backbone[:, k]) for k in range(3)], axis=-1)
        link = backbone[np.searchsorted(ends, at), 3:]
        measured = np.array([live.sensors.get(i, _MISSING) for i in c.imus.ids])
        alive = np.isfinite(measured[:, 0]) & np.array(c.imus.enabled)
        orientations = self._mounting.link_orientations(np.where(alive[:, None], measured, link))
        if c.arm.output_frame == 'base':
            orientations = multiply(conjugate(base), orientations)
        orientations = np.where(alive[:, None], orientations, link)
        for axes, scales in ((self._imus, alive), (self._missing, ~alive)):
            axes.batched_positions = positions.astype(np.float32)
            axes.batched_wxyzs = _wxyz(orientations).astype(np.float32)
            axes.batched_scales = scales.astype(np.float32)

    def _draw_truth(self, c: Configuration, live: Live) -> None:
        positions = np.empty((0, 3)) if live.truth_markers is None else live.truth_markers[:, :3]
        self._truth_markers = self._draw_balls(
            self._truth_markers, '/arm/truth_markers', positions, self._about(c, 0.7), _GHOST, 0.35
        )
        backbone = live.truth_backbone
        if backbone is None or len(backbone) < 2:
            if self._ghost is not None:
                self._ghost.remove()
                self._ghost = None
            return
        vertices = tube_vertices(backbone, 1.15 * c.arm.radius)
        if self._ghost is None or len(self._ghost.vertices) != len(vertices):
            self._ghost = self._scene.add_mesh_simple(
                '/arm/truth',
                vertices,
                tube_faces(len(backbone)),
                color=_GHOST,
                opacity=0.25,
                cast_shadow=False,
            )
        else:
            self._ghost.vertices = vertices.astype(np.float32)


_MISSING = np.full(4, np.nan)


def _wxyz(q: FloatArray) -> FloatArray:
    """The order of components that viser wants, scalar first."""
    return q[..., [3, 0, 1, 2]]
