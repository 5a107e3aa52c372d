"""Where the tip is driven from: its target as a ball in the scene, Start, Stop, and what the controller says."""

import time
from collections.abc import Callable
from typing import Any

import viser

from sesa2.configuration import Configuration
from sesa2.errors import Sesa2Error
from sesa2.shape.rotations import FloatArray
from sesa2.viewer.live import Live
from sesa2.viewer.readings import tip_control_html
from sesa2.viewer.steering import Steering
from sesa2.viewer.target_ball import TargetBall

_SEND_PERIOD_S = 0.05
_WORDS_PERIOD_S = 0.2
_START, _STOP = 'Start the tip', 'Stop the tip'


class TipPanel:
    """Shown for an arm with a controller.

    Parameters
    ----------
    server
        the page's.
    live
        what is known.
    steering
        what the buttons and the ball do.
    do
        does what a button says, and tells how it went; one thing at a time unless it is `at_once`.
    """

    def __init__(self, server: viser.ViserServer, live: Live, steering: Steering, do: Callable[..., None]):
        self.ball = TargetBall(server)
        self._live, self._steering = live, steering
        self._frame = ''
        self._unsent: FloatArray | None = None
        self._heard: FloatArray | None = None
        self._send_due = self._words_due = 0.0
        self._folder = server.gui.add_folder('Tip control', visible=False)
        with self._folder:
            self._words = server.gui.add_html('')
            buttons = server.gui.add_button_group(
                'Control', (_START, _STOP), hint='the tip goes where the ball is; Stop holds the arm as it is'
            )

        @buttons.on_click
        def _(_: Any) -> None:
            if buttons.value == _START:
                do(lambda: self._told('start_control'))
            else:  # whatever else goes on: the arm moves
                do(lambda: self._told('stop_control'), at_once=True)

    def _told(self, action: str) -> str:
        try:
            return f'tip controller: {self._steering.act(action)}'
        except Sesa2Error as error:
            raise Sesa2Error(f'tip controller: {error}') from None

    def configure(self, c: Configuration) -> None:
        """Another arm from now on, whose scene has been drawn."""
        self._frame = c.frame('base_link')
        self._unsent = self._heard = None
        self.ball.configure(c)
        self._folder.visible = c.has_controller

    def send(self) -> None:
        """Send on where the ball was dragged to, twenty times a second at most, and where it stays in any case."""
        target, now = self._live.target, time.monotonic()
        if target is not None and target is not self._heard:
            self._heard = target
            self.ball.hear(target)
        if now < self._send_due:
            return
        if (moved := self.ball.dragged()) is not None:
            self._unsent = moved if moved[2] > 0.0 else None  # the controller refuses what is below the clamp
        if self._unsent is not None and self._steering.aim(self._unsent, self._frame):
            self._unsent, self._send_due = None, now + _SEND_PERIOD_S

    def draw(self) -> None:
        """Draw what is known now."""
        if not self._folder.visible:
            return
        self.ball.draw(self._live.truth_tip)
        now = time.monotonic()
        if now >= self._words_due:
            self._words_due = now + _WORDS_PERIOD_S
            words = tip_control_html(self._live, self.ball.position)
            if words != self._words.content:
                self._words.content = words
