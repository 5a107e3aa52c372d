"""Steering through the graph: the services of `sesa2 run`, its calibration and its estimator."""

import threading
from typing import Any

from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.publisher import Publisher
from rclpy.task import Future
from std_srvs.srv import Trigger

from sesa2.messages.topic_names import TARGET
from sesa2.ros.qos import STREAM
from sesa2.shape.rotations import FloatArray
from sesa2.viewer.steering import SteeringError

_PATIENCE_S = 15.0  # a start brings up nodes and a port; reading eight chips' offsets takes 5 s
_SERVICES = {
    'start': 'system/start',
    'stop': 'system/stop',
    'record': 'system/record',
    'stop_record': 'system/stop_record',
    'align': 'estimator/align',
    'align_headings': 'estimator/align_headings',
    'save_calibration': 'calibration/save',
    'read_offsets': 'serial_bridge/read_offsets',
    'start_control': 'tip_controller/start',
    'stop_control': 'tip_controller/stop',
}


class GraphSteering:
    """See `sesa2.viewer.steering.Steering`; its calls wait, so they must not come from the executor's thread.

    Parameters
    ----------
    node
        on an executor that spins.
    """

    def __init__(self, node: Node):
        self._triggers = {
            action: node.create_client(Trigger, service) for action, service in _SERVICES.items()
        }
        self._parameters = AsyncParameterClient(node, 'system')
        self._node = node
        self._targets: Publisher | None = None

    @property
    def available(self) -> bool:
        """Whether `sesa2 run` is there."""
        return self._triggers['start'].service_is_ready() and self._parameters.services_are_ready()

    def can(self, action: str) -> bool:
        """Whether somebody offers this action."""
        return self._triggers[action].service_is_ready()

    def start(self, configuration: str) -> str:
        """Start with this configuration; what runs is stopped first."""
        self._plan(configuration)
        return self.act('start')

    def record(self, configuration: str) -> str:
        """Record into the file that this configuration names."""
        self._plan(configuration)
        return self.act('record')

    def _plan(self, configuration: str) -> None:
        """Give the system the configuration that its next start will take."""
        future = self._parameters.set_parameters([Parameter('configuration', value=configuration)])
        [result] = self._answer(future, 'system').results
        if not result.successful:
            raise SteeringError(result.reason or 'the configuration was refused')

    def act(self, action: str) -> str:
        """Do one of ACTIONS."""
        client, service = self._triggers[action], _SERVICES[action]
        if not client.service_is_ready():
            raise SteeringError(f'{service} is not there: nothing runs that could do it')
        response = self._answer(client.call_async(Trigger.Request()), service)
        if not response.success:
            raise SteeringError(response.message or f'{service} failed and did not say why')
        return response.message

    def aim(self, target: FloatArray, frame: str) -> bool:
        """Publish a target; for the executor's thread. False: nobody listens yet, and nothing was said."""
        if self._targets is None:  # not before there is something to say: two that may are complained about
            self._targets = self._node.create_publisher(PointStamped, TARGET, STREAM)
        if not self._targets.get_subscription_count():
            return False
        message = PointStamped()
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.header.frame_id = frame
        message.point.x, message.point.y, message.point.z = target.tolist()
        self._targets.publish(message)
        return True

    def configuration(self) -> Future:
        """Ask for the configuration that the next start takes; for the executor's thread."""
        return self._parameters.get_parameters(['configuration'])

    @staticmethod
    def _answer(future: Future, who: str) -> Any:
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        if not done.wait(_PATIENCE_S):
            future.cancel()
            raise SteeringError(f'{who} did not answer within {_PATIENCE_S:g} s')
        return future.result()
