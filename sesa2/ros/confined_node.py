"""What every node of the package is: one whose callbacks cannot end the process with what they raise."""

import functools
from collections import Counter
from collections.abc import Callable
from typing import Any

import rclpy.node
from std_srvs.srv import Trigger

from sesa2.errors import Sesa2Error
from sesa2.faults import fault_line


class ConfinedNode(rclpy.node.Node):
    """A node that catches what its callbacks raise, tells it in one line of its log, and counts it.

    After a request that went wrong it goes on: the request has failed. After a message or a timer it is done for, since
    nobody knows in what state it is, and says so by `failure`; unless its class says that it goes on.

    Attributes
    ----------
    failure
        why it cannot go on; None while it can.
    finished
        whether it has ended for good.
    n_faults
        number of callbacks that raised.
    """

    GOES_ON = False
    _ended_by: Sesa2Error | None = None
    _ended = False

    def __init__(self, name: str, **options: Any):
        self.n_faults = 0
        self._fault_lines = Counter[str]()
        self._left_halfway = False  # a callback was left halfway
        super().__init__(name, **options)

    @property
    def failure(self) -> Sesa2Error | None:  # noqa: D102
        return self._ended_by

    @property
    def finished(self) -> bool:  # noqa: D102
        return self._ended

    def fail(self, error: Exception) -> None:
        """End for good: by what was foreseen as it is, by anything else with its type and place."""
        if not isinstance(error, Sesa2Error):
            error = Sesa2Error(f'{self.get_name()}: {self._note(error)}')
        self._ended_by, self._ended = error, True

    def confined(self, callback: Callable[..., Any]) -> Callable[..., None]:
        """A callback that raises nothing. Those of subscriptions, timers and services are so without asking."""

        @functools.wraps(callback)
        def call(*arguments: Any) -> None:
            if self._left_halfway:
                return
            try:
                callback(*arguments)
            except Exception as error:
                if self.GOES_ON:
                    self._note(error)
                else:
                    self._left_halfway = True
                    self.fail(error)

        return call

    def create_subscription(
        self, msg_type: type, topic: str, callback: Callable[..., Any], *rest: Any, **options: Any
    ) -> Any:
        """As rclpy's, confined."""
        return super().create_subscription(msg_type, topic, self.confined(callback), *rest, **options)

    def create_timer(
        self, timer_period_sec: float, callback: Callable[..., Any], *rest: Any, **options: Any
    ) -> Any:
        """As rclpy's, confined."""
        return super().create_timer(timer_period_sec, self.confined(callback), *rest, **options)

    def create_service(
        self, srv_type: Any, srv_name: str, callback: Callable[..., Any], *rest: Any, **options: Any
    ) -> Any:
        """As rclpy's, confined; who asked gets an answer all the same."""

        @functools.wraps(callback)
        def answer(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except Exception as error:
                line = self._note(error)
                if isinstance(response, Trigger.Response):
                    response.success, response.message = False, line
                return response

        return super().create_service(srv_type, srv_name, answer, *rest, **options)

    def _note(self, error: Exception) -> str:
        line = str(error) if isinstance(error, Sesa2Error) else fault_line(error)
        self.n_faults += 1
        self._fault_lines[line] += 1
        if self._fault_lines[line] == 1:  # a drawing that fails would say so thirty times a second
            self.get_logger().error(line)
        return line
