"""The tip's target in the scene: a ball that is dragged, grey where the arm cannot reach it."""

from collections import deque
from typing import Any

import numpy as np
import viser

from sesa2.configuration import Configuration
from sesa2.control.reach import Reach, Reached
from sesa2.messages.colours import Colour
from sesa2.shape.rotations import FloatArray

_BALL: Colour = (200, 25, 160)
_OUT: Colour = (150, 150, 150)
_TRUE: Colour = (70, 70, 90)
# What lacks more than so much is out of reach, m: as the controller has it.
_LEFT = 1e-4
_KEPT = 100  # as many points as are sent in five seconds


class TargetBall:
    """A ball with handles, where it may go, and where the tip truly is; positions are in base_link.

    The handles are moved by viser's threads; whoever draws asks `dragged` for what is new.

    Parameters
    ----------
    server
        the page's.

    Attributes
    ----------
    position : (3,) or None
        of the target, m; None while nobody has said one.
    reached
        the nearest that the tip comes to it; None without a target, or with one that is not above the clamp.
    """

    def __init__(self, server: viser.ViserServer):
        self._server, self._scene = server, server.scene
        self._reach: Reach | None = None
        self._clear()

    def _clear(self) -> None:
        self.position: FloatArray | None = None
        self.reached: Reached | None = None
        self._held = False
        self._moved: deque[FloatArray] = deque(maxlen=1)
        self._own: deque[tuple[float, ...]] = deque(maxlen=_KEPT)

    def configure(self, c: Configuration) -> None:
        """Another arm from now on, whose scene has been drawn; one without a controller has no ball."""
        self._clear()
        self._reach = c.create_controller().reach if c.has_controller else None
        if self._reach is None:
            return
        r = 0.6 * c.arm.radius
        with self._server.atomic():
            # Until somebody drags it, it waits at the tip of the straight arm.
            self._handles = self._scene.add_transform_controls(
                '/arm/target',
                scale=0.35 * c.arm.length,
                disable_rotations=True,
                depth_test=False,
                position=self._reach.tip(self._reach.straight),
            )
            self._ball = self._scene.add_icosphere('/arm/target/ball', radius=r, color=_OUT)
            self._clipped = self._scene.add_icosphere(
                '/arm/reached', radius=0.6 * r, color=_BALL, visible=False
            )
            self._true_tip = self._scene.add_icosphere(
                '/arm/true_tip', radius=0.7 * r, color=_TRUE, visible=False
            )
        self._handles.on_update(self._drag)

    async def _drag(self, event: Any) -> None:
        """In the order of what was done, since nothing is waited for."""
        self._held = event.phase != 'end'
        if event.phase != 'start':
            self._moved.append(np.array(event.target.position, dtype=float))

    def dragged(self) -> FloatArray | None:
        """Where it has been dragged to since the last call, (3,), m; None: it was not."""
        if not self._moved:
            return None
        moved = self._moved.pop()
        self._own.append(tuple(moved))
        self._aim(moved)
        return moved

    def hear(self, target: FloatArray) -> None:
        """Take what was published on the graph; what it said itself, and what comes while it is held, moves nothing."""
        if self._reach is None or self._held or self._moved or tuple(target) in self._own:
            return
        self._handles.position = target
        self._aim(target)

    def draw(self, true_tip: FloatArray | None) -> None:
        """Show where the tip truly is, (3,), m; None: nobody knows."""
        if self._reach is None:
            return
        if true_tip is not None:
            self._true_tip.position = true_tip
        if self._true_tip.visible != (true_tip is not None):
            self._true_tip.visible = true_tip is not None

    def _aim(self, target: FloatArray) -> None:
        assert self._reach is not None
        self.position = target
        # The controller refuses what is not above the clamp.
        self.reached = self._reach.nearest(target) if target[2] > 0.0 else None
        clipped = self.reached is not None and self.reached.left > _LEFT
        self._ball.color = _OUT if clipped or self.reached is None else _BALL
        if clipped and self.reached is not None:
            self._clipped.position = self.reached.point
        self._clipped.visible = clipped
