"""Qualities of service: reliable, and deep enough that a burst is not lost.

A reliable publisher serves reliable and best-effort subscribers alike; a best-effort one never reaches a reliable
subscriber.
"""

from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_policy_name_from_kind

STREAM = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
# A subscriber of what a link may bring all at once, after a cut: as much as publishers keep, and what is measured then.
BURSTS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
# One that also hears the best-effort publishers of other people's drivers.
ANY_BURSTS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
# Hears every message of a latched topic; a depth of 1 loses all but the last of those that come at once.
EVERY_LATCHED = QoSProfile(
    depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


def telling_why_unheard(node: Node, topic: str) -> SubscriptionEventCallbacks:
    """Has a node log where a publisher is not heard for its qualities of service, and what to do."""

    def tell(event: Any) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        node.get_logger().warning(
            f'{node.resolve_topic_name(topic)}: a publisher is not heard, its {policy} does not match; '
            'drivers are heard whatever they offer with run.source: external'
        )

    return SubscriptionEventCallbacks(incompatible_qos=tell)
