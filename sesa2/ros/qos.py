"""Qualities of service: reliable, and deep enough that a burst is not lost.

A reliable publisher serves reliable and best-effort subscribers alike; a best-effort one never reaches a reliable
subscriber, and says nothing.
"""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

STREAM = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
# A subscriber that also hears the best-effort publishers of other people's drivers.
ANY_STREAM = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
# Hears every message of a latched topic; a depth of 1 loses all but the last of those that come at once.
EVERY_LATCHED = QoSProfile(
    depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
