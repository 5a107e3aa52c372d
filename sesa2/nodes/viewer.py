"""The viewer: shows in the browser what is on the graph, and steers `sesa2 run` where that is there.

A process of its own: it may be killed and started again without harm to anything else.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces.msg import IntegerRange, ParameterDescriptor
from rclpy.task import Future
from std_msgs.msg import String

from sesa2.configuration import Configuration, ConfigurationError, files
from sesa2.configuration.chosen_files import ChosenFiles
from sesa2.messages.topic_names import CONFIGURATION
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.graph_listening import Listener
from sesa2.ros.graph_steering import GraphSteering
from sesa2.ros.lifeline import end_with_parent
from sesa2.ros.qos import LATCHED
from sesa2.ros.spinning import run_alone
from sesa2.viewer.page import Page
from sesa2.viewer.server import address, open_server
from sesa2.viewer.web_port import LOOPBACK

_FRAME_S = 1.0 / 30.0
_ASK_S = 1.0


class Viewer(ConfinedNode):
    """Draws the newest of everything thirty times a second, as long as somebody looks.

    What it cannot show it tells and counts; the rest of the page goes on.

    Attributes
    ----------
    address
        of the page.
    """

    GOES_ON = True

    def __init__(self, **options: Any):
        super().__init__('viewer', **options)
        host = self.declare_parameter(
            'host',
            LOOPBACK,
            ParameterDescriptor(
                description='address of the page; others than 127.0.0.1 let others steer', read_only=True
            ),
        ).value
        port = self.declare_parameter(
            'port',
            8080,
            ParameterDescriptor(
                description='port of the page; 0: any that is free',
                read_only=True,
                integer_range=[IntegerRange(from_value=0, to_value=65535, step=1)],
            ),
        ).value
        folder = self.declare_parameter(
            'files',
            '',
            ParameterDescriptor(
                description='folder under which files may be chosen on the page; empty: where it was started',
                read_only=True,
            ),
        ).value
        self._server = open_server(host, port)
        self.address = address(self._server)
        # On no executor: what comes often waits here until a frame is drawn.
        self._streams = rclpy.create_node(
            'viewer_streams',
            namespace=self.get_namespace(),
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._listener = Listener(self, self._streams)
        self._steering = GraphSteering(self)
        chosen = ChosenFiles(folder or Path.cwd())
        self.page = Page(self._server, self._listener.live, self._steering, chosen)
        self._shown: Configuration | None = None
        # The configuration of the next start, as the system has it.
        self._planned: Configuration | None = None
        self._planned_text = ''
        self._asked: Future | None = None
        self.create_subscription(String, CONFIGURATION, self._take_configuration, LATCHED)
        self._frame_timer = self.create_timer(_FRAME_S, self._draw)
        self._ask_timer = self.create_timer(_ASK_S, self._ask)
        print(f'the arm is shown on {self.address}', flush=True)

    def close(self) -> None:
        """Close the page."""
        self._server.stop()
        self._streams.destroy_node()

    def _draw(self) -> None:
        self._listener.update()
        self.page.draw()

    def _ask(self) -> None:
        """Ask the system for its configuration; in calibrate mode no estimator publishes one."""
        if self._steering.available and (self._asked is None or self._asked.done()):
            self._asked = self._steering.configuration()
            self._asked.add_done_callback(self.confined(self._take_planned))

    def _take_planned(self, future: Future) -> None:
        values = future.result().values if future.result() else []
        text = values[0].string_value if values else ''
        if text and text != self._planned_text:
            self._planned_text = text
            if c := self._parse(text):
                before, self._planned = self._planned, c
                if before and c == _aligned(before, c):
                    self.page.take_alignment(c)
                else:
                    self.page.fill_in(c)
                    self._show(c)

    def _take_configuration(self, message: String) -> None:
        c = self._parse(message.data)
        if c is None:
            return
        if self._planned is None:
            self.page.fill_in(c)
        self._show(c)

    def _parse(self, text: str) -> Configuration | None:
        try:
            return files.parse(text, 'configuration')
        except ConfigurationError as error:
            self.get_logger().error(str(error))
            return None

    def _show(self, c: Configuration) -> None:
        # A port or a source changes nothing in the picture, and a new picture costs.
        before = self._shown
        if before is not None and c == replace(
            before, run=c.run, serial=c.serial, calibration=c.calibration, record=c.record
        ):
            self._listener.live.configuration = c
            return
        self._shown = c
        self._listener.listen_to(c)
        self.page.configure(c)


def _aligned(c: Configuration, like: Configuration) -> Configuration:
    imus = replace(c.imus, mount_orientations=like.imus.mount_orientations, headings=like.imus.headings)
    return replace(c, imus=imus)


def main() -> int:
    """`ros2 run sesa2 viewer`."""
    tell_start = end_with_parent()

    def make() -> Viewer:
        viewer = Viewer()
        tell_start()
        return viewer

    return run_alone(make)


if __name__ == '__main__':
    raise SystemExit(main())
