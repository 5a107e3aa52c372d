"""/diagnostics, once a second (REP-107)."""

from collections.abc import Callable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from sesa2.messages.topic_names import DIAGNOSTICS
from sesa2.ros.confined_node import ConfinedNode

# What a node says of one of its parts: name, level, message and values.
Part = tuple[str, bytes, str, Mapping[str, Any]]

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Diagnostics:
    """Publishes what a node says about its parts.

    Parameters
    ----------
    node
        the node.
    hardware_id
        what the parts belong to.
    report
        called once a second; gives for each part its name, level, message and values.
    """

    def __init__(
        self,
        node: ConfinedNode,
        hardware_id: str,
        report: Callable[[], list[Part]],
    ):
        self._node, self._hardware_id, self._report = node, hardware_id, report
        self._publisher = node.create_publisher(DiagnosticArray, DIAGNOSTICS, 10)
        self._timer = node.create_timer(1.0, self.publish)

    def publish(self) -> None:
        """Publish now."""
        message = DiagnosticArray()
        node = self._node.get_fully_qualified_name().lstrip('/')  # as in left/estimator
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.status = [
            DiagnosticStatus(
                name=f'{node}: {part}',
                level=level,
                message=text,
                hardware_id=self._hardware_id,
                values=[KeyValue(key=str(k), value=str(v)) for k, v in values.items()],
            )
            for part, level, text, values in [*self._report(), *self._faults()]
        ]
        self._publisher.publish(message)

    def _faults(self) -> list[tuple[str, bytes, str, Mapping[str, Any]]]:
        n = self._node.n_faults
        text = f'{n} callbacks or requests failed in a way that nobody foresaw; the log says how'
        return [('faults', ERROR, text, {'faults': n})] if n else []
